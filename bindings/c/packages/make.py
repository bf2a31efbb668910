#!/usr/bin/env python3
"""Makes the packages for boards of the libraries that scripts/package-c made.

make.py FOLDER     FOLDER has a folder for each target; the packages go into FOLDER/packages

A package whose libraries are not all there is left out, which is said.
"""

import re
import shutil
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]

# Folders of `Lib` for STM32: library, core as CMSIS names it, and its float ABI.
STM32 = {
    "cortex-m0": ("thumbv6m-none-eabi", "Cortex-M0", "soft"),
    "cortex-m3": ("thumbv7m-none-eabi", "Cortex-M3", "soft"),
    "cortex-m4-soft": ("thumbv7em-none-eabi", "Cortex-M4", "soft"),
    "cortex-m4-hard": ("thumbv7em-none-eabihf", "Cortex-M4", "hard"),
    "cortex-m7-softfp": ("cortex-m7-softfp", "Cortex-M7", "softfp"),
    "cortex-m33-hard": ("thumbv8m.main-none-eabihf", "Cortex-M33", "hard"),
    "cortex-m55-hard": ("cortex-m55", "Cortex-M55", "hard"),
}
ZEPHYR = [library for library, _, _ in STM32.values()]
ESP = {"riscv32imac": "riscv32imac-unknown-none-elf", "riscv32imafc": "riscv32imafc-unknown-none-elf"}


def field(manifest: Path, name: str) -> str:
    """A text of a manifest, which stands there once."""
    found = re.search(f'^{name} = "(.*)"$', manifest.read_text(), re.MULTILINE)
    if not found:
        sys.exit(f"{manifest} has no {name}")
    return found[1]


def filled(folder: Path, values: dict[str, str]) -> None:
    """Replaces @NAMES@ in the texts of a folder."""
    for path in (p for p in folder.rglob("*") if p.is_file() and p.suffix != ".a"):
        text = path.read_text()
        path.write_text(re.sub(r"@([A-Z]+)@", lambda found: values[found[1]], text))


def pdsc(stm32: dict[str, tuple[str, str, str]]) -> dict[str, str]:
    """The conditions and the files of the description."""
    conditions = [
        f'    <condition id="{folder}"><accept Dcore="{core}"/></condition>' for folder, (_, core, _) in stm32.items()
    ]
    files = [
        f'        <file category="library" name="Lib/{folder}/libkeygraph.a" condition="{folder}"/>' for folder in stm32
    ]
    return {"CONDITIONS": "\n".join(conditions), "FILES": "\n".join(files)}


def main() -> None:
    made = Path(sys.argv[1])
    out = made / "packages"
    shutil.rmtree(out, ignore_errors=True)
    version = field(HERE.parent / "Cargo.toml", "version")
    url = field(ROOT / "Cargo.toml", "repository")
    values = {"VERSION": version, "URL": url, **pdsc(STM32)}
    header = HERE.parent / "include/keygraph.h"
    for name, source, top, include, libraries in (
        ("arduino", "arduino", "Keygraph", "src", {"src/cortex-m7/fpv5-d16-softfp": "cortex-m7-softfp"}),
        ("zephyr", "zephyr", "keygraph", "include", {f"lib/{library}": library for library in ZEPHYR}),
        ("esp-idf", "esp-idf", "keygraph", "include", {f"lib/{folder}": library for folder, library in ESP.items()}),
        ("stm32", "stm32cube", "Keygraph", "Include", {f"Lib/{f}": library for f, (library, _, _) in STM32.items()}),
    ):
        missing = [library for library in libraries.values() if not (made / library / "lib/libkeygraph.a").is_file()]
        if missing:
            print(f"no package for {name}: {', '.join(missing)} was not built")
            continue
        folder = out / name / top
        shutil.copytree(HERE / source, folder)
        filled(folder, values)
        shutil.copy(ROOT / "LICENSE-MIT", folder)
        (folder / include).mkdir(exist_ok=True)
        shutil.copy(header, folder / include)
        for place, library in libraries.items():
            (folder / place).mkdir(parents=True)
            shutil.copy(made / library / "lib/libkeygraph.a", folder / place)
        archive = shutil.make_archive(str(out / f"keygraph-{name}-{version}"), "zip", out / name, top)
        print(f"{Path(archive).name}: {Path(archive).stat().st_size / 1e6:.1f} MB")


main()
