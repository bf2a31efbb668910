"""Frames a second of the example with one worker and with two, as JSON. `scripts/test-cluster --measure` runs it.

The frames are those of assets/sequence, again and again. Counted are those of all chunks but the first to end, over
the time from its end to that of the last: the start of Ray is left out. Beside two workers Ray itself needs time.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import keygraph
import pyarrow.parquet as pq

ROOT = Path(__file__).parents[2]
SEQUENCE = sorted((ROOT / "assets/sequence").glob("*.jpg"))
FRAMES = 4000


def frames_a_second(rows):
    """Frames a second of a run, by when its files were whole."""
    parts = sorted((path.stat().st_mtime, path) for path in rows.glob("part-*.parquet"))
    counted = sum(pq.read_metadata(path).num_rows for _, path in parts[1:])
    return counted / (parts[-1][0] - parts[0][0])


with tempfile.TemporaryDirectory(prefix="keygraph-cluster-") as folder:
    frames, model = Path(folder, "frames"), Path(folder, "object.kgm")
    frames.mkdir()
    for i in range(FRAMES):
        (frames / f"{i:04}.jpg").symlink_to(SEQUENCE[i % len(SEQUENCE)])
    keygraph.train(ROOT / "assets/pictures/astronaut.jpg").save(model)
    told = {"frames": FRAMES, "frame_bytes": sum(p.stat().st_size for p in SEQUENCE) // len(SEQUENCE), "workers": {}}
    for workers in ("1", "2"):
        rows = Path(folder, f"rows-{workers}")
        search = [sys.executable, Path(__file__).with_name("search.py"), "-m", model, "--out", rows]
        subprocess.run([*search, "--workers", workers, frames], check=True, stdout=sys.stderr)
        told["workers"][workers] = round(frames_a_second(rows), 1)
print(json.dumps(told))
