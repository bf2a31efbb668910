"""The example on a cluster of two worker processes, one of which is killed in the middle.

In: KEYGRAPH, this machine's program, whose lines the rows are held against. `scripts/test-cluster` runs it.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

import jsonschema
import keygraph
import pyarrow.parquet as pq

ROOT = Path(__file__).parents[2]
SEQUENCE = sorted((ROOT / "assets/sequence").glob("*.jpg"))
FRAMES = 500


def search(folder, *arguments):
    """Starts the example with two workers."""
    run = [
        sys.executable,
        str(Path(__file__).with_name("search.py")),
        "-m",
        folder / "object.kgm",
        "--out",
        folder / "rows",
    ]
    return subprocess.Popen([*run, "--workers", "2", *arguments], stderr=subprocess.PIPE, text=True)


def workers():
    """The processes of actors, by Ray's own titles of them."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            title = (process / "cmdline").read_bytes()
        except OSError:
            continue
        if title.startswith(b"ray::") and b"Searcher" in title:
            found.append(int(process.name))
    return found


def rows(folder):
    """All rows, as docs/detection.md has them."""
    lines = []
    for row in pq.read_table(folder / "rows").to_pylist():
        line = {key: value for key, value in row.items() if value is not None}
        lines.append(line | {key: dict(line[key]) for key in ("stages", "time_ms") if key in line})
    return sorted(lines, key=lambda line: line["source"])


class Cluster(unittest.TestCase):
    """One run for all tests: a cluster takes seconds to start."""

    @classmethod
    def setUpClass(cls):
        cls.room = tempfile.TemporaryDirectory(prefix="keygraph-cluster-")
        cls.folder = Path(cls.room.name)
        frames = cls.folder / "frames"
        frames.mkdir()
        for i in range(FRAMES):
            (frames / f"{i:04}.jpg").symlink_to(SEQUENCE[i % len(SEQUENCE)])
        (frames / "broken.jpg").write_bytes(b"no picture")
        keygraph.train(ROOT / "assets/pictures/astronaut.jpg").save(cls.folder / "object.kgm")
        run = search(cls.folder, frames)
        cls.killed = None
        while run.poll() is None and cls.killed is None:
            if len(list((cls.folder / "rows").glob("part-*"))) >= 4 and len(pids := workers()) == 2:
                cls.killed = pids[0]
                os.kill(cls.killed, signal.SIGKILL)
            time.sleep(0.02)
        cls.told = run.communicate()[1]
        cls.status = run.returncode

    @classmethod
    def tearDownClass(cls):
        cls.room.cleanup()

    def test_a_lost_worker_costs_no_row_and_doubles_none(self):
        self.assertIsNotNone(self.killed, "a worker was killed in the middle")
        self.assertEqual(self.status, 0, self.told)
        names = [Path(line["source"]).name for line in rows(self.folder)]
        self.assertEqual(names, [*(f"{i:04}.jpg" for i in range(FRAMES)), "broken.jpg"])

    def test_rows_are_the_lines_of_the_command(self):
        command = [os.environ["KEYGRAPH"], "detect", "-m", self.folder / "object.kgm", "--json", *SEQUENCE]
        expected = [
            json.loads(line) for line in subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout.splitlines()
        ]
        for i, line in enumerate(line for line in rows(self.folder) if "error" not in line):
            same = {"source": "", "frame": 0, "time_ms": 0}
            self.assertEqual(line | same, expected[i % len(SEQUENCE)] | same)

    def test_rows_keep_to_the_schema(self):
        validator = jsonschema.Draft202012Validator(json.loads((ROOT / "docs/schema/detection.json").read_text()))
        lines = rows(self.folder)
        for line in [*lines[:: len(SEQUENCE)], lines[-1]]:
            validator.validate(line)
        self.assertIn("broken.jpg", lines[-1]["error"])

    def test_what_was_searched_is_not_searched_again(self):
        lost = sorted((self.folder / "rows").glob("part-*"))[3]
        before = {path: path.stat().st_mtime_ns for path in (self.folder / "rows").iterdir()}
        lost.unlink()
        again = search(self.folder, self.folder / "frames")
        self.assertIn("20 of them done before", again.communicate()[1])
        after = {path: path.stat().st_mtime_ns for path in (self.folder / "rows").iterdir()}
        self.assertEqual({path for path in before if before[path] != after[path]}, {lost})

    def test_mistakes_are_told(self):
        picture = self.folder / "frames/0000.jpg"
        for arguments, told in [
            ([__file__], "is no picture"),
            (["-m", "nowhere.kgm", picture], "nowhere.kgm"),
            (["--threshold", "0.5", self.folder / "frames"], "holds rows of another run"),
            ([picture], "holds rows of another run"),
        ]:
            run = search(self.folder, *arguments)
            self.assertIn(told, run.communicate()[1])
            self.assertEqual(run.returncode, 1)


if __name__ == "__main__":
    unittest.main()
