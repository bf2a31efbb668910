"""The command `rivals`: Keygraph and OpenCV on the same frames, in one run, on one thread each.

Rivals: OpenCV's SIFT and ORB (1,000 features; ratio test, RANSAC homography), its
goodFeaturesToTrack, triangulation and colour conversions. Each frame is taken --passes
times by each in turn, and its median counts; the table has medians over the frames.
Decoding is left out everywhere.
"""

import datetime
import json
import os
import platform
import statistics
import subprocess
import sys
import time

import cv2
import numpy as np
from detectors import Refused, check_command
from opencv import Rival
from pictures import picture_paths, read_picture

CORNERS = 400


def rivals(args, folder):
    """Prints the table; with --record, leaves it and all numbers as DATE.md and DATE.json."""
    check_command(args.keygraph)
    frames = picture_paths([args.frames])
    ours = {p: bench(args.keygraph, args.object, frames, args.passes, p, folder) for p in args.presets}
    try:
        times, found = time_opencv(read_picture(args.object), frames, args.passes)
    except Refused as e:
        sys.exit(str(e))
    text = table(ours, times, found, len(frames))
    print(text)
    if args.record:
        record(args.record, text, about(ours, len(frames), args.passes), ours, times, found)


def bench(command, picture, frames, passes, preset, folder):
    """What `keygraph bench` says of the frames with a model of this preset."""
    model = os.path.join(folder, f"{preset}.kgm")
    subprocess.run([command, "train", picture, "-o", model, "--preset", preset], check=True, stdout=subprocess.DEVNULL)
    run = [command, "bench", "-m", model, *frames, "--json", "--track", "--passes", str(passes)]
    run += ["--frames", str(len(frames))]
    return json.loads(subprocess.run(run, check=True, stdout=subprocess.PIPE).stdout)


class Stopwatch:
    """Median times of a few passes, by what was timed."""

    def __init__(self, passes):
        self.passes, self.times = passes, {}

    def time(self, label, work, *args):
        """Calls `work(*args)` a few times, notes its median time, and gives its result."""
        times = []
        for _ in range(self.passes):
            start = time.perf_counter()
            result = work(*args)
            times.append(1e3 * (time.perf_counter() - start))
        self.times.setdefault(label, []).append(statistics.median(times))
        return result


def time_opencv(picture, paths, passes):
    """Median ms by what was timed, and in how many frames SIFT and ORB say they found it."""
    features = {label: Rival(label) for label in ("ORB", "SIFT")}
    watch, found = Stopwatch(passes), dict.fromkeys(features, 0)
    for path in paths:
        pixels = cv2.imread(path, cv2.IMREAD_COLOR)
        for label, rival in features.items():
            corners = watch.time(label, rival.outline, pixels, rival.model(picture), picture.size)
            found[label] += corners is not None
        gray = watch.time("gray", cv2.cvtColor, pixels, cv2.COLOR_BGR2GRAY)
        watch.time("HSV", cv2.cvtColor, pixels, cv2.COLOR_BGR2HSV)
        watch.time("copy of gray and RGB", copy, gray, pixels)
        points = watch.time("goodFeaturesToTrack", cv2.goodFeaturesToTrack, gray, CORNERS, 0.0005, 5)
        watch.time("Subdiv2D", triangulate, points, gray.shape)
    return {label: statistics.median(t) for label, t in watch.times.items()}, found


def copy(*arrays):
    """Copies of all arrays."""
    return [array.copy() for array in arrays]


def triangulate(points, shape):
    """The triangles of the points in a picture of `shape`."""
    mesh = cv2.Subdiv2D((0, 0, shape[1], shape[0]))
    mesh.insert(points.reshape(-1, 2))
    return mesh.getTriangleList()


def table(ours, times, found, frames):
    """The results as Markdown."""
    rows = ["| | ms, median | frames found |", "| --- | --- | --- |"]
    for preset, b in ours.items():
        rows.append(f"| keygraph {preset} | {b['total']['median_ms']:.1f} | {b['detections']} of {frames} |")
    for label, n in found.items():
        rows.append(f"| OpenCV {label} | {times[label]:.1f} | {n} of {frames} |")
    first = next(iter(ours.values()))
    stages = {stage: v["median_ms"] for stage, v in first["stages"].items()}
    beside = {  # stage -> what it is called in the table, and OpenCV's time
        "convert": ("luma and chroma (OpenCV: gray; HSV)", f"{times['gray']:.2f}; {times['HSV']:.2f}"),
        "corners": (
            "corners, of the levels searched (OpenCV: goodFeaturesToTrack, of the frame)",
            f"{times['goodFeaturesToTrack']:.2f}",
        ),
        "delaunay": (
            f"triangulation, nested, of the levels searched (OpenCV: Subdiv2D of {CORNERS} points)",
            f"{times['Subdiv2D']:.2f}",
        ),
    }
    rows += ["", "| stage | ours, ms | OpenCV, ms |", "| --- | --- | --- |"]
    rows.append(f"| a plain copy of gray and RGB | | {times['copy of gray and RGB']:.3f} |")
    rows += [f"| {title} | {stages[stage]:.2f} | {theirs} |" for stage, (title, theirs) in beside.items()]
    rows += [f"| {stage} | {ms:.2f} | |" for stage, ms in stages.items() if stage not in beside]
    rows.append(f"| followed, not searched | {first['tracking']['times']['median_ms']:.2f} | |")
    return "\n".join(rows)


def about(ours, frames, passes):
    """What a record says of its run."""
    return {
        "date": datetime.date.today().isoformat(),
        "machine": platform.machine(),
        "processor": processor(),
        "opencv": cv2.__version__,
        "numpy": np.__version__,
        "frames": frames,
        "passes": passes,
        "digests": {preset: b["digest"] for preset, b in ours.items()},
    }


def record(folder, text, about, ours, times, found):
    """Writes the table and all numbers as DATE.md and DATE.json."""
    os.makedirs(folder, exist_ok=True)
    head = f"# {about['date']}\n\n" + "\n".join(f"- {k}: {v}" for k, v in about.items())
    with open(os.path.join(folder, f"{about['date']}.md"), "w", encoding="utf-8") as f:
        f.write(f"{head}\n\n{text}\n")
    with open(os.path.join(folder, f"{about['date']}.json"), "w", encoding="utf-8") as f:
        json.dump({"about": about, "keygraph": ours, "opencv_ms": times, "opencv_found": found}, f, indent=1)
        f.write("\n")


def processor():
    """The processor's name, where the system tells it."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as f:
            return next(line.split(":", 1)[1].strip() for line in f if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or "unknown"
