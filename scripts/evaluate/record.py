"""The records of what was measured: one JSON file a part, each with the build that it measured.

A record is of the present build when the digests of all stages over the shipped sequence are those of the record.
tests/tests/record.rs compares them.
"""

import datetime
import functools
import json
import os
import platform
import subprocess
import tempfile

from places import DOCS, PICTURES, RECORDS, ROOT, SEQUENCE

PRESETS = ("large", "standard", "compact")
# Records that are the numbers of a figure lie beside it.
FIGURES = ("curves", "economy", "growth", "look-alikes")


def record_path(part):
    """The file of a part's record."""
    return os.path.join(DOCS if part in FIGURES else RECORDS, f"{part}.json")


def read_record(part):
    """The record of a part."""
    with open(record_path(part), encoding="utf-8") as f:
        return json.load(f)


def write_record(part, numbers, keygraph):
    """Writes what was measured of the program `keygraph` as the record of a part."""
    path = record_path(part)
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "w", encoding="utf-8") as f:
        json.dump({**numbers, "build": build(keygraph)}, f, indent=1)
        f.write("\n")
    print(f"wrote {os.path.relpath(path, ROOT)}", flush=True)


@functools.cache
def build(keygraph):
    """What a record says of its build: the digests by preset, the commit, the day and the processor."""
    return {
        "digests": {preset: digest(keygraph, preset) for preset in PRESETS},
        "commit": git("rev-parse", "--short", "HEAD"),
        "date": datetime.date.today().isoformat(),
        "processor": processor(),
    }


def digest(keygraph, preset):
    """The digest of all stages over the shipped sequence, with a model of astronaut.jpg."""
    with tempfile.TemporaryDirectory() as folder:
        model = os.path.join(folder, "m.kgm")
        train = [keygraph, "train", os.path.join(PICTURES, "astronaut.jpg"), "--preset", preset, "-o", model]
        subprocess.run(train, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        run = [keygraph, "bench", "-m", model, SEQUENCE, "--passes", "1", "--json"]
        return json.loads(subprocess.run(run, check=True, stdout=subprocess.PIPE).stdout)["digest"]


def git(*arguments):
    """What git says in the repository; nothing where there is no git."""
    done = subprocess.run(["git", *arguments], cwd=ROOT, check=False, capture_output=True, text=True)
    return done.stdout.strip()


def processor():
    """The processor's name, where the system tells it."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as f:
            return next(line.split(":", 1)[1].strip() for line in f if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or "unknown"
