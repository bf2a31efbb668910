#!/usr/bin/env python3
"""Tests of scripts/release: what it takes from the changelog, and which versions it refuses.

python3 scripts/test_release.py
"""

import os
import shutil
import subprocess
import tarfile
import tempfile
import types
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def load() -> types.ModuleType:
    """Returns scripts/release as a module, although its name has no ending."""
    module = types.ModuleType("release")
    module.__file__ = str(ROOT / "scripts/release")
    code = compile((ROOT / "scripts/release").read_text(encoding="utf-8"), module.__file__, "exec")
    exec(code, module.__dict__)
    return module


release = load()

CHANGELOG = """# Changelog

## Unreleased

## 1.3.0 - 2030-01-02

### Added
- A new thing.

## 1.2.0 - 2029-01-02

- An old thing.
"""


class Changelog(unittest.TestCase):
    def test_the_newest_entry_is_the_release(self):
        self.assertEqual(release.newest(CHANGELOG), ("1.3.0", "2030-01-02"))
        self.assertEqual(release.notes(CHANGELOG), "### Added\n- A new thing.\n")
        self.assertIsNone(release.newest("# Changelog\n\n## Unreleased\n\n- A thing.\n"))

    def test_changes_in_no_release_are_seen(self):
        self.assertEqual(release.unreleased(CHANGELOG), "")
        open_change = CHANGELOG.replace("## Unreleased\n", "## Unreleased\n\n### Fixed\n- A fault.\n")
        self.assertEqual(release.unreleased(open_change), "### Fixed\n- A fault.")


class Versions(unittest.TestCase):
    """A copy of the files that name versions, in which one of them is changed."""

    @classmethod
    def setUpClass(cls):
        text = (ROOT / "Cargo.toml").read_text(encoding="utf-8")
        cls.version = text.split('\nversion = "')[1].split('"')[0]
        listed = subprocess.run(["git", "ls-files"], cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True)
        cls.files = [name for name in listed.stdout.splitlines() if release.patterns(name)]
        cls.filled = [f"bindings/c/packages/{name}" for name in release.FILLED]

    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.root = Path(self.folder.name)
        for name in [*self.files, *self.filled, "bindings/python/pyproject.toml"]:
            (self.root / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, self.root / name)

    def differing(self):
        return release.differing(self.root, self.files, self.version)

    def change(self, name: str, old: str, new: str):
        path = self.root / name
        text = path.read_text(encoding="utf-8")
        self.assertIn(old, text)
        path.write_text(text.replace(old, new, 1), encoding="utf-8")

    def test_all_files_agree(self):
        self.assertEqual(self.differing(), [])

    def test_another_version_anywhere_is_named(self):
        short = self.version.rpartition(".")[0]
        for name, old, new in [
            ("Cargo.toml", f'\nversion = "{self.version}"', '\nversion = "0.0.0"'),
            ("Cargo.toml", f'path = "core", version = "{self.version}"', 'path = "core", version = "9.9.9"'),
            ("Cargo.lock", f'name = "keygraph"\nversion = "{self.version}"', 'name = "keygraph"\nversion = "9.9.9"'),
            ("bindings/c/tools/Cargo.toml", self.version, "9.9.9"),
            ("bindings/python/Cargo.toml", self.version, "9.9.9"),
            ("bindings/web/package.json", self.version, "9.9.9"),
            ("bindings/c/README.md", f"Keygraph {short}", "Keygraph 9.9"),
            ("bindings/c/examples/desktop/CMakeLists.txt", f"Keygraph {short}", "Keygraph 9.9"),
            ("examples/published/Cargo.toml", f'keygraph-core = "{self.version}"', 'keygraph-core = "9.9.9"'),
            ("boards/Cargo.toml", self.version, "9.9.9"),
        ]:
            with self.subTest(name):
                self.change(name, old, new)
                (line,) = self.differing()
                self.assertTrue(line.startswith(f"{name}:"), line)
                self.change(name, new, old)

    def test_a_manifest_that_names_none_is_named(self):
        self.change("bindings/web/package.json", '  "version"', '  "revision"')
        self.assertEqual(self.differing(), ["bindings/web/package.json names no version"])
        self.change("bindings/c/packages/arduino/library.properties", "@VERSION@", self.version)
        self.assertEqual(len(self.differing()), 2)


class Archives(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.out = Path(folder.name)
        (self.out / "made/lib").mkdir(parents=True)
        (self.out / "made/lib/libkeygraph.so.1").write_text("library")
        (self.out / "made/lib/libkeygraph.so").symlink_to("libkeygraph.so.1")

    def test_one_folder_gives_one_archive(self):
        first = release.pack(self.out / "a.tar.gz", self.out / "made", "keygraph-1.3.0")
        os.utime(self.out / "made/lib/libkeygraph.so.1", (0, 0))
        second = release.pack(self.out / "b.tar.gz", self.out / "made", "keygraph-1.3.0")
        self.assertEqual(first.read_bytes(), second.read_bytes())
        with tarfile.open(first) as tar:
            self.assertIn("keygraph-1.3.0/lib/libkeygraph.so", tar.getnames())
            self.assertTrue(tar.getmember("keygraph-1.3.0/lib/libkeygraph.so").issym())

    def test_what_is_wanted_stays(self):
        (self.out / "made/a.whl").write_text("wheel")
        kept = release.keep(self.out, "made", ["*.whl", "*.tar.gz"])
        self.assertEqual(kept, [self.out / "a.whl"])
        self.assertFalse((self.out / "made").exists())


if __name__ == "__main__":
    unittest.main()
