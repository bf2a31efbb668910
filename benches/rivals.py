#!/usr/bin/env python3
"""Time Keygraph and OpenCV on the same frames, in one run, on one thread each.

    python3 benches/rivals.py [--record benches/record]

Needs `cargo build --release`; installs numpy and opencv-python-headless into a folder of
its own (out/rivals) if they are not there. In: the repository's sequence and the picture
of one of its objects, unless others are given. Out: a table, and with --record the same
and all numbers of `keygraph bench`, as DATE.md and DATE.json.

Rivals: OpenCV's SIFT and ORB (1,000 features; ratio test, RANSAC homography), its
goodFeaturesToTrack, triangulation and colour conversions. Each frame is taken --passes
times by each in turn, and its median counts; the table has medians over the frames.
Decoding is left out everywhere.
"""

import argparse
import datetime
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))


def find_opencv():
    """Makes cv2 and numpy importable."""
    try:
        import cv2  # noqa: F401
        import numpy  # noqa: F401
    except ImportError:
        venv = os.path.join(ROOT, "out", "rivals")
        if sys.prefix == venv:
            raise  # Installed, and yet not importable: no reason to begin again.
        subprocess.run([sys.executable, "-m", "venv", venv], check=True)
        pip = os.path.join(venv, "bin", "pip")
        subprocess.run([pip, "install", "--quiet", "numpy", "opencv-python-headless"], check=True)
        python = os.path.join(venv, "bin", "python3")
        os.execv(python, [python, *sys.argv])


find_opencv()
import cv2  # noqa: E402
import numpy as np  # noqa: E402

sys.path.insert(0, os.path.join(ROOT, "scripts"))
from evaluate import Refused, Rival, read_picture  # noqa: E402

CORNERS = 400


def timed(work, passes):
    """-> median ms of `passes` runs of `work`, and what it returned."""
    times = []
    for _ in range(passes):
        start = time.perf_counter()
        result = work()
        times.append(1e3 * (time.perf_counter() - start))
    return statistics.median(times), result


def keygraph(command, picture, frames, passes, preset, folder):
    """-> what `keygraph bench` says of the frames with a model of this preset."""
    model = os.path.join(folder, f"{preset}.kgm")
    subprocess.run([command, "train", picture, "-o", model, "--preset", preset], check=True, stdout=subprocess.DEVNULL)
    run = [command, "bench", "-m", model, *frames, "--json", "--track", "--passes", str(passes),
           "--frames", str(len(frames))]
    return json.loads(subprocess.run(run, check=True, stdout=subprocess.PIPE).stdout)


def opencv(picture, paths, passes):
    """-> median ms by what was timed, and in how many frames SIFT and ORB say they found it."""
    rivals = {label: Rival(label) for label in ("ORB", "SIFT")}
    times, found = {}, dict.fromkeys(rivals, 0)

    def note(label, work):
        ms, result = timed(work, passes)
        times.setdefault(label, []).append(ms)
        return result

    for path in paths:
        pixels = cv2.imread(path, cv2.IMREAD_COLOR)
        for label, rival in rivals.items():
            model = rival.model(picture)
            corners = note(label, lambda: rival.outline(pixels, model, picture.size))
            found[label] += corners is not None
        gray = note("gray", lambda: cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY))
        note("HSV", lambda: cv2.cvtColor(pixels, cv2.COLOR_BGR2HSV))
        note("copy of gray and RGB", lambda: (gray.copy(), pixels.copy()))
        points = note("goodFeaturesToTrack", lambda: cv2.goodFeaturesToTrack(gray, CORNERS, 0.0005, 5))

        def triangulate():
            mesh = cv2.Subdiv2D((0, 0, gray.shape[1], gray.shape[0]))
            mesh.insert(points.reshape(-1, 2))
            return mesh.getTriangleList()

        note("Subdiv2D", triangulate)
    return {label: statistics.median(t) for label, t in times.items()}, found


def table(ours, rivals, found, frames):
    """The results as Markdown."""
    total = {preset: b["total"]["median_ms"] for preset, b in ours.items()}
    rows = [("| | ms, median | frames found |", "| --- | --- | --- |")]
    rows += [(f"| keygraph {p} | {total[p]:.1f} | {b['detections']} of {frames} |",) for p, b in ours.items()]
    rows += [(f"| OpenCV {label} | {rivals[label]:.1f} | {found[label]} of {frames} |",) for label in found]
    first = next(iter(ours.values()))
    stages = {s: v["median_ms"] for s, v in first["stages"].items()}
    tracked = first["tracking"]["times"]["median_ms"]
    rows += [("", "| stage | ours, ms | OpenCV, ms |", "| --- | --- | --- |"),
             (f"| a plain copy of gray and RGB | | {rivals['copy of gray and RGB']:.3f} |",),
             (f"| luma and chroma (OpenCV: gray; HSV) | {stages['convert']:.2f} | "
              f"{rivals['gray']:.2f}; {rivals['HSV']:.2f} |",),
             (f"| corners, of the levels searched (OpenCV: goodFeaturesToTrack, of the frame) | {stages['corners']:.2f} | "
              f"{rivals['goodFeaturesToTrack']:.2f} |",),
             (f"| triangulation, nested, of the levels searched (OpenCV: Subdiv2D of {CORNERS} points) | "
              f"{stages['delaunay']:.2f} | {rivals['Subdiv2D']:.2f} |",)]
    rest = [s for s in stages if s not in ("convert", "corners", "delaunay")]
    rows += [(f"| {s} | {stages[s]:.2f} | |",) for s in rest]
    rows += [(f"| followed, not searched | {tracked:.2f} | |",)]
    return "\n".join(line for row in rows for line in row)


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--keygraph", default=os.path.join(ROOT, "target", "release", "keygraph"), metavar="FILE")
    p.add_argument("--object", default=os.path.join(ROOT, "assets", "pictures", "astronaut.jpg"), metavar="PICTURE")
    p.add_argument("--frames", default=os.path.join(ROOT, "assets", "sequence"), metavar="DIR")
    p.add_argument("--passes", type=int, default=5)
    p.add_argument("--presets", nargs="+", default=["large", "standard", "compact"])
    p.add_argument("--record", metavar="DIR", help="leave DATE.md and DATE.json here")
    args = p.parse_args()
    if not os.path.exists(args.keygraph):
        sys.exit(f"{args.keygraph} is not there: `cargo build --release` makes it")
    cv2.setNumThreads(1)
    cv2.setRNGSeed(1)
    frames = [os.path.join(args.frames, n) for n in sorted(os.listdir(args.frames)) if n.endswith((".jpg", ".png"))]
    picture = read_picture(args.object)
    with tempfile.TemporaryDirectory(prefix="keygraph-") as folder:
        ours = {q: keygraph(args.keygraph, args.object, frames, args.passes, q, folder) for q in args.presets}
    try:
        rivals, found = opencv(picture, frames, args.passes)
    except Refused as e:
        sys.exit(str(e))
    text = table(ours, rivals, found, len(frames))
    print(text)
    if args.record:
        os.makedirs(args.record, exist_ok=True)
        date = datetime.date.today().isoformat()
        about = {"date": date, "machine": platform.machine(), "processor": processor(), "opencv": cv2.__version__,
                 "numpy": np.__version__, "frames": len(frames), "passes": args.passes,
                 "digests": {q: b["digest"] for q, b in ours.items()}}
        head = f"# {date}\n\n" + "\n".join(f"- {k}: {v}" for k, v in about.items())
        with open(os.path.join(args.record, f"{date}.md"), "w", encoding="utf-8") as f:
            f.write(f"{head}\n\n{text}\n")
        with open(os.path.join(args.record, f"{date}.json"), "w", encoding="utf-8") as f:
            json.dump({"about": about, "keygraph": ours, "opencv_ms": rivals, "opencv_found": found}, f, indent=1)
            f.write("\n")


def processor():
    """The processor's name, where the system tells it."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as f:
            return next(line.split(":", 1)[1].strip() for line in f if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or "unknown"


if __name__ == "__main__":
    main()
