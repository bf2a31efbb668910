"""The command `rivals`: Keygraph and OpenCV on the same frames, in one run, on one thread each.

Rivals: OpenCV's SIFT and ORB (1,000 features; ratio test, RANSAC homography), its
goodFeaturesToTrack, triangulation and colour conversions. Each frame is taken --passes
times by each in turn, and its median counts; the table has medians over the frames.
Decoding is left out everywhere.
"""

import json
import os
import statistics
import subprocess
import sys
import time

import cv2
import tables
from detectors import Refused, check_command
from opencv import Rival
from pictures import picture_paths, read_picture

CORNERS = 400


def rivals(args, folder):
    """Prints the table; gives all numbers."""
    check_command(args.keygraph)
    frames = picture_paths([args.frames])
    ours = {p: bench(args.keygraph, args.object, frames, args.passes, p, folder) for p in args.presets}
    try:
        times, found = time_opencv(read_picture(args.object), frames, args.passes)
    except Refused as e:
        sys.exit(str(e))
    numbers = {
        "opencv": cv2.__version__,
        "frames": len(frames),
        "passes": args.passes,
        "points": CORNERS,
        "keygraph": ours,
        "opencv_ms": times,
        "opencv_found": found,
    }
    print("\n".join([*tables.times(numbers), "", *tables.stages(numbers)]))
    return numbers


def bench(command, picture, frames, passes, preset, folder):
    """What `keygraph bench` says of the frames with a model of this preset."""
    model = os.path.join(folder, f"{preset}.kgm")
    subprocess.run([command, "train", picture, "-o", model, "--preset", preset], check=True, stdout=subprocess.DEVNULL)
    run = [command, "bench", "-m", model, *frames, "--json", "--track", "--passes", str(passes)]
    run += ["--frames", str(len(frames))]
    told = json.loads(subprocess.run(run, check=True, stdout=subprocess.PIPE).stdout)
    del told["each_ms"]
    return told


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
