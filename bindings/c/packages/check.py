#!/usr/bin/env python3
"""Checks the packages that `make.py` made: their layout, and that their examples compile and link.

check.py FOLDER     FOLDER is that of `make.py`

Compilers and tools of the ecosystems that are missing here are named. Stand-ins of headers lie in `stubs`.
"""

import importlib.util
import re
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
STUBS = HERE / "stubs"


def fail(text: str) -> None:
    sys.exit(f"packages: {text}")


def run(*command: object, cwd: Path | None = None) -> str:
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, cwd=cwd)
    if done.returncode != 0:
        fail(f"{' '.join(map(str, command))}\n{done.stdout[-2000:]}{done.stderr[-3000:]}")
    return done.stdout + done.stderr


def has(program: str) -> bool:
    if shutil.which(program):
        return True
    print(f"NOT CHECKED: what needs {program}")
    return False


def unpacked(made: Path, name: str, work: Path) -> Path:
    """The one folder in the package of this name."""
    (archive,) = (made / "packages").glob(f"keygraph-{name}-*.zip")
    with zipfile.ZipFile(archive) as content:
        content.extractall(work / name)
    (folder,) = (work / name).iterdir()
    for path in folder.rglob("*"):
        if path.is_file() and path.suffix != ".a" and (left := re.search(r"@[A-Z]+@", path.read_text())):
            fail(f"{path}: {left[0]} was left")
    return folder


def model(folder: Path, name: str) -> Path:
    """A file in place of a model."""
    path = folder / name
    path.write_bytes(bytes(range(64)))
    return path


def linked(compiler: str, flags: list[str], source: Path, include: list[Path], library: Path, work: Path) -> None:
    """Compiles an example with all warnings, and links it with the library and stand-ins of all else."""
    program = work / "program.elf"
    includes = [f"-I{path}" for path in include]
    run(
        compiler,
        *flags,
        "-O2",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-ffunction-sections",
        *includes,
        "-c",
        source,
        "-o",
        work / "a.o",
    )
    # Debian's compiler has no libc of its own, and the library needs none.
    # In C++ the functions of a sketch have these names.
    roots = "-e,main" if compiler.endswith("gcc") else "-e,_Z5setupv,-u,_Z4loopv"
    link = ["-nostdlib", "-nostartfiles", f"-Wl,--gc-sections,-z,muldefs,{roots}"]
    run(compiler, *flags, *link, work / "a.o", library, "-lgcc", "-o", program)
    bytes_linked = int(run("size", program).splitlines()[1].split()[0])
    if bytes_linked < 50_000:
        fail(f"{source.name} uses nothing of the library: {bytes_linked} bytes")
    print(f"  {source.name}: {bytes_linked} bytes of code and constants")


def arduino(made: Path, work: Path) -> None:
    folder = unpacked(made, "arduino", work)
    lines = (folder / "library.properties").read_text().splitlines()
    properties = dict(line.split("=", 1) for line in lines)
    # The library specification of Arduino: what must be there, and what it may be.
    for field in "name version author maintainer sentence paragraph category url architectures".split():
        if not properties.get(field):
            fail(f"library.properties has no {field}")
    rules = {
        "name": r"[A-Za-z0-9][A-Za-z0-9 _.-]{0,62}",
        "version": r"\d+\.\d+\.\d+",
        "category": "Signal Input/Output",
        "url": r"https://\S+",
        "precompiled": "true|full",
        "includes": r"keygraph\.h",
    }
    for field, rule in rules.items():
        if not re.fullmatch(rule, properties[field]):
            fail(f"library.properties: {field}={properties[field]}")
    if properties["name"] != folder.name or not (folder / "src" / properties["includes"]).is_file():
        fail("the folder or the header has another name than library.properties says")
    sketches = list((folder / "examples").glob("*/*.ino"))
    if not sketches or any(sketch.stem != sketch.parent.name for sketch in sketches):
        fail("a sketch has the name of its folder")
    library = folder / "src/cortex-m7/fpv5-d16-softfp/libkeygraph.a"
    if has("arm-none-eabi-g++"):
        for board in ("ARDUINO_PORTENTA_H7_M7", "ARDUINO_NICLA_VISION"):
            place = work / board
            place.mkdir()
            (place / "model.h").write_text(
                "alignas(4) const unsigned char model[] = {1};\nunsigned int model_len = 1;\n"
            )
            source = place / "FindCover.cpp"
            source.write_text("#include <Arduino.h>\n" + sketches[0].read_text())
            flags = [
                "-mcpu=cortex-m7",
                "-mthumb",
                "-mfloat-abi=softfp",
                "-mfpu=fpv5-d16",
                "-std=gnu++14",
                f"-D{board}",
                "-fno-exceptions",
                "-fno-rtti",
                "-fno-threadsafe-statics",
            ]
            linked("arm-none-eabi-g++", flags, source, [place, folder / "src", STUBS / "arduino"], library, place)


def zephyr(made: Path, work: Path) -> None:
    folder = unpacked(made, "zephyr", work)
    module = (folder / "zephyr/module.yml").read_text()
    if "name: keygraph" not in module or not (folder / "zephyr/Kconfig").is_file():
        fail("module.yml or Kconfig is wrong")
    if importlib.util.find_spec("kconfiglib"):
        import kconfiglib

        top = work / "Kconfig"
        cores = "".join(
            f"config CPU_CORTEX_{core}\n\tbool\n\tdefault {'y' if core == 'M7' else 'n'}\n"
            for core in ("M0", "M0PLUS", "M3", "M4", "M7", "M33", "M55")
        )
        top.write_text(f'{cores}source "{folder}/zephyr/Kconfig"\n')
        options = kconfiglib.Kconfig(str(top), warn_to_stderr=False)
        options.syms["KEYGRAPH"].set_value("y")
        if options.syms["KEYGRAPH"].str_value != "y" or options.warnings:
            fail(f"Kconfig: {options.warnings}")
    else:
        print("NOT CHECKED: Kconfig (pip install kconfiglib)")
    if has("cmake"):
        chosen = set()
        for options in (
            "CPU_CORTEX_M0",
            "CPU_CORTEX_M3",
            "CPU_CORTEX_M4",
            "CPU_CORTEX_M4 FP_HARDABI",
            "CPU_CORTEX_M7 FP_SOFTABI",
            "CPU_CORTEX_M33 FP_HARDABI",
            "CPU_CORTEX_M55 FP_HARDABI ARMV8_1_M_MVEF",
            "CPU_CORTEX_M33",
        ):
            given = [f"-DCONFIG_{option}=y" for option in ["KEYGRAPH", *options.split()]]
            told = run("cmake", *given, f"-DMODULE={folder}/zephyr", "-P", STUBS / "zephyr/module.cmake")
            library = re.search(r"library (\S+)", told)
            if not library or not Path(library[1]).is_file():
                fail(f"zephyr with {options}: {told}")
            chosen.add(Path(library[1]).parent.name)
        if len(chosen) != 7:
            fail(f"zephyr links {sorted(chosen)}")
    if has("arm-none-eabi-gcc"):
        model(work, "cover.kgm.inc").write_text("1, 2, 3")
        flags = ["-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-d16", "-std=gnu11"]
        linked(
            "arm-none-eabi-gcc",
            flags,
            folder / "samples/find/src/main.c",
            [work, folder / "include", STUBS / "zephyr"],
            folder / "lib/thumbv7em-none-eabihf/libkeygraph.a",
            work,
        )


def esp_idf(made: Path, work: Path) -> None:
    folder = unpacked(made, "esp-idf", work)
    if has("cmake"):
        for target, kind in (("esp32p4", "riscv32imafc"), ("esp32c6", "riscv32imac")):
            told = run(
                "cmake", f"-DIDF_TARGET={target}", f"-DCOMPONENT={folder}", "-P", STUBS / "esp-idf/component.cmake"
            )
            library = re.search(r"library (\S+)", told)
            if not library or f"/{kind}/" not in library[1] or not Path(library[1]).is_file():
                fail(f"esp-idf for {target}: {told}")
    if has("riscv64-unknown-elf-gcc"):
        # Debian's compiler has no libc: the example is compiled, with its own stdio.h.
        run(
            "riscv64-unknown-elf-gcc",
            "-march=rv32imafc_zicsr",
            "-mabi=ilp32f",
            "-std=gnu11",
            "-Wall",
            "-Wextra",
            "-Werror",
            "-ffreestanding",
            f"-I{folder}/include",
            f"-I{STUBS}/esp-idf",
            "-c",
            folder / "examples/find/main/main.c",
            "-o",
            work / "esp.o",
        )
    if has("compote"):
        version = re.search(r'version: "(.*)"', (folder / "idf_component.yml").read_text())[1]
        run(
            "compote",
            "component",
            "pack",
            "--name",
            "keygraph",
            "--project-dir",
            folder,
            "--dest-dir",
            work / "packed",
            cwd=folder,
        )
        if not list((work / "packed").glob(f"keygraph_{version}.tgz")):
            fail("compote packed nothing")


def stm32(made: Path, work: Path) -> None:
    folder = unpacked(made, "stm32", work)
    tree = ElementTree.parse(folder / "Keygraph.pdsc")
    conditions = {c.get("id") for c in tree.iter("condition")}
    files = list(tree.iter("file"))
    for file in files:
        if not (folder / file.get("name")).exists():
            fail(f"the description names {file.get('name')}, which is not there")
        if file.get("condition") not in conditions | {None}:
            fail(f"there is no condition {file.get('condition')}")
    named = {file.get("name") for file in files}
    if any(str(p.relative_to(folder)) not in named for p in folder.rglob("*.a")) or len(conditions) != 7:
        fail("a library is not described")


def main() -> None:
    made = Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as name:
        for check in (arduino, zephyr, esp_idf, stm32):
            work = Path(name) / check.__name__
            work.mkdir()
            print(check.__name__.replace("_", "-"))
            check(made, work)
    print("packages: all checks passed")


main()
