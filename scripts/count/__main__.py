"""Instructions of a search on x86-64 and AArch64 side by side, by stage.

    python3 scripts/count

QEMU executes the same program for both, and counts (plugin.c): with what every processor of the kind has (SSE2,
NEON), and on x86-64 with AVX2 for everything. Per frame, of four frames of assets/sequence that show the object near,
far, in part, and not at all; large preset, 640x480. A stage is the functions of its files in core/src; what the
compiler put into a function of another stage counts there. Needs Rust, gcc, qemu-user and readelf; some minutes.
"""

from __future__ import annotations

import bisect
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FRAMES = [f"assets/sequence/{n}.jpg" for n in ("0000", "0009", "0016", "0025")]
# Mangled names begin each part with its length.
STAGES = {
    "convert": r"5image(5frame|6pixels)|load_at|8exposure",
    "pyramid": r"5image(7pyramid|5halve)",
    "corners": r"7extract(7corners|8strength|4rank)|9keypoints|find_keypoints",
    "triangles": r"7delaunay|7triples|find_triples|7extract8keygraph|find_keygraphs",
    "features": r"7extract7feature|extract_features",
    "classify": r"8classify|find_matches",
    "verify": r"6verify|cast_votes",
    "vote, pose": r"5hough|4vote|find_candidates|4pose|4grow",
    "accept": r"5align|7overlay|10appearance|5light|8scrutiny|6mosaic|7outline|6belief|8evidence|7examine",
    "what several use": r"keygraph_core|4core",
}
KINDS = {
    "x86-64, SSE2": ("x86_64", "x86_64-unknown-linux-gnu", ""),
    "x86-64, AVX2": ("x86_64", "x86_64-unknown-linux-gnu", "-Ctarget-cpu=x86-64-v3"),
    "AArch64, NEON": ("aarch64", "aarch64-unknown-linux-musl", ""),
}
# Where qemu-user puts programs that may lie anywhere, and where others lie.
BASES = (0, 0x4000000000, 0x5500000000, 0x5555555555000)


def run(*command: str, **more: object) -> str:
    return subprocess.run(command, cwd=ROOT, check=True, text=True, stdout=subprocess.PIPE, **more).stdout


def build(target: str, flags: str, folder: str) -> Path:
    environment = os.environ | {
        "CARGO_TARGET_DIR": folder,
        "CARGO_TARGET_AARCH64_UNKNOWN_LINUX_MUSL_LINKER": "rust-lld",
        "RUSTFLAGS": flags,
    }
    lean = ["--profile", "lean", "--no-default-features", "--target", target]
    run("cargo", "build", "--quiet", *lean, "-p", "keygraph", "--bin", "keygraph", env=environment)
    return Path(folder) / target / "lean" / "keygraph"


def counts(emulator: str, plugin: Path, program: Path, model: Path, passes: int, out: Path) -> Counter[int]:
    options = ["-cpu", "max", "-plugin", f"{plugin},out={out}"]
    run(emulator, *options, str(program), "bench", "-m", str(model), "--passes", str(passes), *FRAMES)
    found: Counter[int] = Counter()
    for line in out.read_text().splitlines():
        address, number = line.split()
        found[int(address, 16)] += int(number)
    return found


def by_stage(program: Path, executed: dict[int, int]) -> Counter[str]:
    symbols = []
    for line in run("readelf", "-sW", str(program)).splitlines():
        fields = line.split()
        if len(fields) >= 8 and fields[3] == "FUNC":
            symbols.append((int(fields[1], 16), int(fields[2], 0), fields[7]))
    symbols.sort()
    starts = [s[0] for s in symbols]

    def name(address: int) -> str:
        i = bisect.bisect(starts, address) - 1
        return symbols[i][2] if i >= 0 and address < symbols[i][0] + symbols[i][1] else ""

    base = max(BASES, key=lambda b: sum(n for a, n in executed.items() if "keygraph_core" in name(a - b)))
    stages: Counter[str] = Counter()
    for address, number in executed.items():
        called = name(address - base)
        stage = next((s for s, rule in STAGES.items() if re.search(rule, called)), "outside of the core")
        stages[stage] += number
    return stages


def main() -> None:
    for program in ("gcc", "qemu-aarch64", "qemu-x86_64", "readelf"):
        if not shutil.which(program):
            sys.exit(f"{program} is missing: sudo apt-get install gcc qemu-user binutils")
    target = os.environ.get("CARGO_TARGET_DIR", str(ROOT / "target"))
    tables = {}
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        plugin, model = work / "plugin.so", work / "model.kgm"
        run(
            "gcc",
            "-shared",
            "-fPIC",
            "-O1",
            "-Wall",
            "-Wextra",
            str(Path(__file__).with_name("plugin.c")),
            "-o",
            str(plugin),
        )
        for kind, (machine, triple, flags) in KINDS.items():
            program = build(triple, flags, f"{target}/count-v3" if flags else target)
            if not model.exists():
                run(str(program), "train", "assets/pictures/astronaut.jpg", "-o", str(model))
            # A second pass searches each frame once more, and does nothing else.
            one, two = (counts(f"qemu-{machine}", plugin, program, model, n, work / "counts.txt") for n in (1, 2))
            tables[kind] = by_stage(program, {a: n - one[a] for a, n in two.items() if n > one[a]})
    print("| million instructions a frame | " + " | ".join(tables) + " |")
    print("| --- |" + " --- |" * len(tables))
    rows = [*STAGES, "outside of the core"]
    for row in rows:
        print(f"| {row} | " + " | ".join(f"{t[row] / 1e6 / len(FRAMES):.2f}" for t in tables.values()) + " |")
    print("| all | " + " | ".join(f"{t.total() / 1e6 / len(FRAMES):.1f}" for t in tables.values()) + " |")


main()
