"""The stack that the C libraries can need at most, from their compiled code.

stack.py [--paths] [--most BYTES] FOLDER [LIBRARY]...

FOLDER is that of scripts/package-c; all libraries for boards in it unless given. --most ends with an error where a
bound is greater.

Each function's frame is what its instructions take from the stack pointer, all of them added. A call goes where it
says; one through a table of a trait goes to every function that stands at its place in any table, and one through
another pointer to every function whose address stands anywhere, but to none that is running: nothing in the library
runs within itself, and a finder is asked by a scene alone. A direct call that did would be an error.

The longest way through the calls is the bound. What a caller's own callback takes comes on top. Functions that only
panic are left out: they stop the program.

Needs capstone and pyelftools (pip), and Rust's linker.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import capstone
from capstone import arm_const, riscv_const
from elftools.elf.elffile import ELFFile

ENTRIES = {
    "detect": ["kg_detector_detect", "kg_detector_begin", "kg_detector_step", "kg_detector_detections"],
    "track": ["kg_tracker_track", "kg_tracker_tracks"],
    "train": ["kg_trainer_train"],
    "surface": ["kg_detector_surface"],
}
BOARDS = re.compile(r"thumb|cortex|riscv")
PANICS = re.compile(
    r"panic|unwrap_failed|expect_failed|assert_failed|slice_.*fail|_fail17|div_by_zero|rem_by_zero|abort|core3fmt"
)
# Texts are formatted for panics alone.
# A finder is asked by a scene alone, which the compiler puts into what calls it.
FINDER, ASKS = "Finder$GT$", re.compile(r"5scene|6search6Search|8detector")
# Words before the functions of a table: what drops the value, its size, its alignment.
TABLE_HEAD = 3


@dataclass
class Function:
    """A function: its frame in bytes, and where it may go."""

    name: str
    frame: int = 0
    calls: set[int] = field(default_factory=set)
    # Offsets into tables through which it calls.
    slots: set[int] = field(default_factory=set)
    # Whether it calls through a pointer whose origin is not seen.
    is_open: bool = False


class Pointers:
    """What the registers of a function hold: constants, and words that were loaded from an offset."""

    def __init__(self) -> None:
        self.now: dict[int, tuple[str, int | None]] = {}
        self.ever: dict[int, set[tuple[str, int | None]]] = defaultdict(set)
        self.spilled: dict[int, set[tuple[str, int | None]]] = defaultdict(set)
        self.calls: list[tuple[int, tuple[str, int | None] | None]] = []

    def set(self, register: int, *, constant: int | None) -> None:
        self.put(register, None if constant is None else ("constant", constant))

    def put(self, register: int, origin: tuple[str, int | None] | None) -> None:
        self.now.pop(register, None)
        if origin:
            self.now[register] = origin
            self.ever[register].add(origin)

    def constant(self, register: int) -> int | None:
        kind, value = self.now.get(register, (None, None))
        return value if kind == "constant" else None

    def move(self, to: int, register: int) -> None:
        self.ever[to] |= self.ever[register]
        self.put(to, self.now.get(register))

    def load(self, register: int, is_stack: bool, offset: int) -> None:
        if not is_stack:
            self.put(register, ("table", offset))
            return
        held = self.spilled[offset]
        self.ever[register] |= held
        self.put(register, next(iter(held)) if len(held) == 1 else None)

    def spill(self, offset: int, register: int) -> None:
        self.spilled[offset] |= {self.now[register]} if register in self.now else self.ever[register]


class Program:
    """A linked program, read."""

    def __init__(self, path: Path) -> None:
        with path.open("rb") as stream:
            elf = ELFFile(stream)
            self.is_arm = elf["e_machine"] == "EM_ARM"
            symbols = list(elf.get_section_by_name(".symtab").iter_symbols())
            self.memory = {
                s["sh_addr"]: s.data()
                for s in elf.iter_sections()
                if s["sh_flags"] & 2 and s["sh_type"] != "SHT_NOBITS"
            }
        mask = ~1 if self.is_arm else ~0
        found = [s for s in symbols if s["st_info"]["type"] == "STT_FUNC" and s["st_size"]]
        self.sizes = {s["st_value"] & mask: s["st_size"] for s in found}
        self.functions = {s["st_value"] & mask: Function(s.name) for s in found}
        self.names = {s.name: s["st_value"] & mask for s in found}
        # Where constants lie among the code.
        marks = sorted((s["st_value"], s.name[:2]) for s in symbols if s.name[:2] in ("$t", "$d", "$x", "$a"))
        self.data = [
            (at, end) for (at, kind), (end, _) in zip(marks, [*marks[1:], (1 << 40, "")], strict=True) if kind == "$d"
        ]
        mode = (capstone.CS_ARCH_ARM, capstone.CS_MODE_THUMB | capstone.CS_MODE_MCLASS | capstone.CS_MODE_V8)
        if not self.is_arm:
            mode = (capstone.CS_ARCH_RISCV, capstone.CS_MODE_RISCV32 | capstone.CS_MODE_RISCVC)
        self.decoder = capstone.Cs(*mode)
        self.decoder.detail = True
        self.decoder.skipdata = True
        self.tables = self.find_tables()
        # Functions whose address stands anywhere, for calls through pointers of which nothing is seen.
        self.anybody = {f for data in self.memory.values() for f in self.addresses(data)}
        for at, function in self.functions.items():
            (self.read_arm if self.is_arm else self.read_riscv)(at, function)

    def bytes_at(self, at: int, size: int) -> bytes:
        for start, data in self.memory.items():
            if start <= at < start + len(data):
                return data[at - start : at - start + size]
        return b""

    def is_function(self, word: int) -> bool:
        return word & 1 == 1 and word & ~1 in self.functions if self.is_arm else word in self.functions

    def addresses(self, data: bytes) -> set[int]:
        """The functions whose addresses are words of these bytes."""
        words = {int.from_bytes(data[i : i + 4], "little") for i in range(0, len(data) - 3, 4)}
        return {w & ~1 if self.is_arm else w for w in words if self.is_function(w)}

    def find_tables(self) -> list[list[int]]:
        """Tables of traits: drop, size, alignment, functions."""
        tables = []
        for data in self.memory.values():
            words = [int.from_bytes(data[i : i + 4], "little") for i in range(0, len(data) - 3, 4)]
            for i in range(len(words) - TABLE_HEAD):
                drop, size, alignment = words[i : i + TABLE_HEAD]
                if (
                    (drop == 0 or self.is_function(drop))
                    and size < 1 << 24
                    and alignment in (1, 2, 4, 8)
                    and self.is_function(words[i + TABLE_HEAD])
                ):
                    end = i + TABLE_HEAD
                    while end < len(words) and self.is_function(words[end]):
                        end += 1
                    tables.append(words[i:end])
        return tables

    def instructions(self, at: int) -> list[capstone.CsInsn]:
        """The instructions of a function, without the constants among them."""
        code = self.bytes_at(at, self.sizes[at])
        spans, start = [], at
        for low, high in self.data:
            if at < high and low < at + len(code):
                spans.append((start, max(low, start)))
                start = min(high, at + len(code))
        spans.append((start, at + len(code)))
        return [i for low, high in spans for i in self.decoder.disasm(code[low - at : high - at], low) if i.id]

    def goes_to(self, function: Function, at: int, target: int) -> None:
        """Notes a jump or a call to another function."""
        if target != at and target in self.functions:
            function.calls.add(target)

    def read_arm(self, at: int, function: Function) -> None:
        sp, size = arm_const.ARM_REG_SP, self.sizes[at]
        pointers = Pointers()
        for i in self.instructions(at):
            name, ops = i.mnemonic.split(".")[0], i.operands
            memory = next((o.mem for o in ops if o.type == arm_const.ARM_OP_MEM), None)
            immediate = ops[-1].imm if ops and ops[-1].type == arm_const.ARM_OP_IMM else None
            if name in ("push", "vpush"):
                width = 8 if name == "vpush" and i.reg_name(ops[0].reg).startswith("d") else 4
                function.frame += width * len(ops)
            elif name in ("stmdb", "vstmdb") and ops[0].reg == sp and i.writeback:
                width = 8 if name == "vstmdb" and i.reg_name(ops[1].reg).startswith("d") else 4
                function.frame += width * (len(ops) - 1)
            elif name in ("str", "strd") and i.writeback and memory and memory.base == sp:
                function.frame += max(0, -memory.disp)
            elif name in ("sub", "subw", "subs", "add") and ops and ops[0].reg == sp:
                change = immediate if immediate is not None else pointers.constant(ops[-1].reg)
                if change is None:
                    # The way back, as from a frame pointer, takes nothing.
                    if name != "add":
                        sys.exit(f"{function.name}: {i.mnemonic} {i.op_str}: a frame that is not known before")
                    change = 0
                function.frame += max(0, change if name.startswith("sub") else -change)
            elif name in ("mov", "movw", "movs") and len(ops) == 2:
                if immediate is not None:
                    pointers.set(ops[0].reg, constant=immediate)
                else:
                    pointers.move(ops[0].reg, ops[1].reg)
            elif name == "movt":
                pointers.set(ops[0].reg, constant=(pointers.constant(ops[0].reg) or 0) & 0xFFFF | immediate << 16)
            elif name in ("ldr", "ldrd") and memory and memory.base == arm_const.ARM_REG_PC:
                word = self.bytes_at((i.address & ~3) + 4 + memory.disp, 4)
                pointers.set(ops[0].reg, constant=int.from_bytes(word, "little", signed=True))
            elif name in ("ldr", "ldrd") and memory and not memory.index:
                for k, register in enumerate(o.reg for o in ops if o.type == arm_const.ARM_OP_REG):
                    pointers.load(register, memory.base == sp, memory.disp + 4 * k)
            elif name in ("str", "strd") and memory and memory.base == sp:
                for k, register in enumerate(o.reg for o in ops if o.type == arm_const.ARM_OP_REG):
                    pointers.spill(memory.disp + 4 * k, register)
            if name in ("blx", "bx") and ops[0].type == arm_const.ARM_OP_REG:
                if ops[0].reg != arm_const.ARM_REG_LR or name == "blx":
                    pointers.calls.append((ops[0].reg, pointers.now.get(ops[0].reg)))
            elif (
                (capstone.CS_GRP_JUMP in i.groups or capstone.CS_GRP_CALL in i.groups)
                and immediate is not None
                and not at <= immediate < at + size
            ):
                self.goes_to(function, at, immediate & ~1)
        self.resolve(function, at, pointers)

    def read_riscv(self, at: int, function: Function) -> None:
        sp, size = riscv_const.RISCV_REG_X2, self.sizes[at]
        pointers = Pointers()
        for i in self.instructions(at):
            name, ops = i.mnemonic.removeprefix("c."), i.operands
            regs = [o.reg if o.type == riscv_const.RISCV_OP_REG else None for o in ops]
            memory = next(((o.mem.base, o.mem.disp) for o in ops if o.type == riscv_const.RISCV_OP_MEM), None)
            immediate = ops[-1].imm if ops and ops[-1].type == riscv_const.RISCV_OP_IMM else None
            if name in ("addi", "addi16sp") and regs[0] == sp and (len(ops) < 3 or regs[1] == sp):
                function.frame += max(0, -immediate)
            elif name in ("sub", "add") and regs[0] == sp:
                change = pointers.constant(regs[-1])
                if change is None:
                    sys.exit(f"{function.name}: {i.mnemonic} {i.op_str}: a frame that is not known before")
                change = change - (1 << 32) if change & 1 << 31 else change
                function.frame += max(0, change if name == "sub" else -change)
            elif name == "lui":
                pointers.set(regs[0], constant=(immediate << 12) & 0xFFFFFFFF)
            elif name == "auipc":
                pointers.set(regs[0], constant=(i.address + (immediate << 12)) & 0xFFFFFFFF)
            elif name == "li":
                pointers.set(regs[0], constant=immediate & 0xFFFFFFFF)
            elif name == "mv":
                pointers.move(regs[0], regs[1])
            elif name == "addi" and len(ops) in (2, 3) and immediate is not None:
                base = pointers.constant(regs[-2])
                pointers.set(regs[0], constant=None if base is None else (base + immediate) & 0xFFFFFFFF)
            elif name in ("lw", "lwsp") and memory:
                pointers.load(regs[0], memory[0] == sp, memory[1])
            elif name in ("sw", "swsp") and memory and memory[0] == sp:
                pointers.spill(memory[1], regs[0])
            if name in ("jal", "j", "call", "tail") and immediate is not None:
                target = i.address + immediate
                if not at <= target < at + size:
                    self.goes_to(function, at, target)
            elif name in ("jalr", "jr"):
                base, shift = memory or (next((r for r in reversed(regs) if r is not None), None), immediate or 0)
                target = pointers.constant(base)
                if target is not None:
                    if not at <= (target + shift) & 0xFFFFFFFF < at + size:
                        self.goes_to(function, at, (target + shift) & 0xFFFFFFFF)
                elif base != riscv_const.RISCV_REG_X1 or name == "jalr":
                    pointers.calls.append((base, pointers.now.get(base)))
        self.resolve(function, at, pointers)

    def resolve(self, function: Function, at: int, pointers: Pointers) -> None:
        """Notes where the calls of a function through pointers may go."""
        for register, now in pointers.calls:
            # What the register held last in the order of the code, or else whatever it holds anywhere.
            for origin in [now] if now else pointers.ever.get(register) or {None}:
                kind, value = origin or (None, None)
                if kind == "constant" and value is not None and self.is_function(value & 0xFFFFFFFF):
                    self.goes_to(function, at, value & ~1 if self.is_arm else value)
                elif kind == "table":
                    self.through(function, value)
                elif kind is None:
                    function.is_open = True

    def through(self, function: Function, offset: int) -> None:
        """Notes a call through a pointer that was loaded from this offset of a table, or of what the caller gave."""
        place = offset // 4
        if (place >= TABLE_HEAD or place == 0) and self.at_place(place):
            function.slots.add(place)

    def at_place(self, place: int) -> set[int]:
        words = {table[place] for table in self.tables if place < len(table) and table[place]}
        return {w & ~1 if self.is_arm else w for w in words}

    def deepest(self, entry: str) -> tuple[int, list[str]]:
        """The bound of an entry, and the functions on the way."""
        known: dict[int, tuple[int, list[int]]] = {}
        running: list[int] = []
        # Whether each running function was called directly.
        direct: list[bool] = []

        def visit(at: int, is_direct: bool) -> tuple[int, list[int], int]:
            """The bound, the way, and the first of the running functions that a call was kept from (by its place)."""
            if at in known:
                return *known[at], len(running)
            function = self.functions[at]
            if PANICS.search(function.name):
                return 0, [], len(running)
            running.append(at)
            direct.append(is_direct)
            size, way, kept = 0, [], len(running)
            through = {f for place in function.slots for f in self.at_place(place)}
            if function.is_open:
                through |= self.anybody
            if not ASKS.search(function.name):
                through = {f for f in through if FINDER not in self.functions[f].name}
            for next_ in function.calls | through:
                if next_ in running:
                    place = running.index(next_)
                    kept = min(kept, place)
                    if next_ in function.calls and all(direct[place + 1 :]):
                        ring = [self.functions[f].name for f in [*running[place:], next_]]
                        sys.exit("a way that comes back to itself:\n  " + "\n  ".join(ring))
                    continue
                further, deeper, from_ = visit(next_, next_ in function.calls)
                kept = min(kept, from_)
                if further > size:
                    size, way = further, deeper
            running.pop()
            direct.pop()
            found = (size + function.frame, [at, *way])
            # What was kept from a function below holds for this way alone.
            if kept >= len(running):
                known[at] = found
            return *found, kept

        size, way, _ = visit(self.names[entry], True)
        return size, [f"{self.functions[f].frame:6} {self.functions[f].name}" for f in way]


def link(library: Path, entries: list[str], out: Path) -> None:
    root = subprocess.run(["rustc", "--print", "sysroot"], capture_output=True, text=True, check=True).stdout.strip()
    (linker,) = Path(root).glob("lib/rustlib/*/bin/rust-lld")
    keep = [f"--undefined={entry}" for entry in entries]
    flags = ["-flavor", "gnu", "--gc-sections", "--unresolved-symbols=ignore-all", "-e", entries[0]]
    subprocess.run([str(linker), *flags, *keep, str(library), "-o", str(out)], check=True, capture_output=True)


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    arguments.add_argument("--paths", action="store_true", help="print the deepest way of each entry")
    arguments.add_argument(
        "--most", type=int, metavar="BYTES", help="the greatest bound that is right; twice that for surfaces"
    )
    arguments.add_argument("folder", type=Path, help="that of scripts/package-c")
    arguments.add_argument("libraries", nargs="*", help="folders in it [default: all for boards]")
    given = arguments.parse_args()
    libraries = given.libraries or sorted(p.name for p in given.folder.iterdir() if BOARDS.match(p.name))
    print("| library | detect, bytes of stack | track | train | surface |\n| --- | --- | --- | --- | --- |")
    for library in libraries:
        bounds: dict[str, int] = defaultdict(int)
        for kind, entries in ENTRIES.items():
            with tempfile.TemporaryDirectory() as folder:
                program = Path(folder) / "linked"
                link(given.folder / library / "lib/libkeygraph.a", entries, program)
                read = Program(program)
            for entry in entries:
                size, way = read.deepest(entry)
                bounds[kind] = max(bounds[kind], size)
                if given.paths:
                    print(f"{library} {entry}: {size}", *way, sep="\n  ", file=sys.stderr)
        print(f"| {library} |", " | ".join(f"{bounds[kind]:,}" for kind in ENTRIES), "|", flush=True)
        allowed = {kind: (2 if kind == "surface" else 1) * (given.most or 0) for kind in ENTRIES}
        if given.most and any(bounds[kind] > allowed[kind] for kind in ENTRIES):
            sys.exit(f"{library}: more than {given.most} bytes of stack")


main()
