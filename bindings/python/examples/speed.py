"""Times a call, and stands beside OpenCV's SIFT and ORB on the same frames.

    python speed.py [PASSES [EVERY]]      one thread; needs Python 3.10 and opencv-python (or -headless) for the rivals

PASSES (5) is how often the frames are searched, and EVERY (1) takes every second, third, ... of the 48 frames.

The overhead of a call is its time without that of the core's stages. Everything is median, ms. A machine that
does other work at the same time gives other numbers.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import keygraph
import numpy as np
from numpy.typing import NDArray

Frame = NDArray[np.uint8]
Outline = NDArray[np.float32]

ASSETS = Path(__file__).resolve().parents[3] / "assets"
PICTURE = keygraph.imread(ASSETS / "pictures/astronaut.jpg")
PASSES = int(sys.argv[1]) if len(sys.argv) > 1 else 5
EVERY = int(sys.argv[2]) if len(sys.argv) > 2 else 1
FRAMES = [keygraph.imread(path) for path in sorted((ASSETS / "sequence").glob("*.jpg"))[::EVERY]]


def overhead(
    detector: keygraph.Detector, frames: list[Frame], passes: int, **reading: Any
) -> tuple[float, float, float]:
    """Time of a call, its time outside of the stages, and the least of the latter, ms."""
    calls, outside = [], []
    for frame in frames * passes:
        start = time.perf_counter()
        found = detector.detect(frame, **reading)
        calls.append(1e3 * (time.perf_counter() - start))
        stages = [ms for stage, ms in found.time_ms.items() if stage != "total"]
        outside.append(calls[-1] - sum(stages))
    return statistics.median(calls), statistics.median(outside), min(outside)


def rival(kind: str) -> Callable[[Frame], Outline | None]:
    """Keypoints, brute-force matches, the ratio test and RANSAC: what a program with OpenCV does."""
    import cv2

    cv2.setNumThreads(1)
    finder = cv2.SIFT_create() if kind == "SIFT" else cv2.ORB_create(2000)  # type: ignore[attr-defined]
    matcher = cv2.BFMatcher(cv2.NORM_L2 if kind == "SIFT" else cv2.NORM_HAMMING)
    known, described = finder.detectAndCompute(cv2.cvtColor(PICTURE, cv2.COLOR_RGB2GRAY), None)
    height, width = PICTURE.shape[:2]
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)

    def find(frame: Frame) -> Outline | None:
        seen, descriptors = finder.detectAndCompute(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), None)
        if descriptors is None or len(seen) < 2:
            return None
        pairs = [p for p in matcher.knnMatch(described, descriptors, k=2) if len(p) == 2]
        good = [a for a, b in pairs if a.distance < 0.75 * b.distance]
        if len(good) < 8:
            return None
        source = np.array([known[m.queryIdx].pt for m in good], np.float32)
        target = np.array([seen[m.trainIdx].pt for m in good], np.float32)
        homography, inliers = cv2.findHomography(source, target, cv2.RANSAC, 3.0)
        if homography is None or inliers.sum() < 15:
            return None
        outline: Outline = cv2.perspectiveTransform(corners[None], homography)[0].astype(np.float32)
        return outline

    return find


def ours() -> Callable[[Frame], Outline | None]:
    detector = keygraph.Detector(keygraph.train(PICTURE, "astronaut"))

    def find(frame: Frame) -> Outline | None:
        found = detector.detect(frame)
        return found[0].corners if found else None

    return find


def main() -> None:
    detector = keygraph.Detector(keygraph.train(PICTURE, "astronaut"))
    wide = [np.pad(frame, ((0, 0), (20, 20), (0, 0)))[:, 20:660] for frame in FRAMES]
    blue_first = [np.ascontiguousarray(frame[..., ::-1]) for frame in FRAMES]
    print("frames of 640x480 px     a call  outside of the core's stages, median and least")
    for name, frames, reading in (
        ("RGB", FRAMES, {}),
        ("a part of a wider one", wide, {}),
        ('BGR, order="bgr"', blue_first, {"order": "bgr"}),
    ):
        call, outside, least = overhead(detector, frames, PASSES, **reading)
        print(f"{name:<24} {call:6.3f}  {outside:.3f} {least:.3f}")

    finders = {"keygraph": ours()}
    try:
        finders |= {"OpenCV ORB": rival("ORB"), "OpenCV SIFT": rival("SIFT")}
    except ModuleNotFoundError:
        print("OpenCV is not installed: pip install opencv-python-headless")
    print(f"\n{f'{len(FRAMES)} frames, one object':<24}     ms  found")
    outlines: dict[str, list[Outline | None]] = {}
    for name, find in finders.items():
        times = []
        for _ in range(max(1, PASSES // 2)):
            outlines[name] = []
            for frame in FRAMES:
                start = time.perf_counter()
                outlines[name].append(find(frame))
                times.append(1e3 * (time.perf_counter() - start))
        count = sum(outline is not None for outline in outlines[name])
        print(f"{name:<24} {statistics.median(times):6.1f}  {count}")
    for name in list(finders)[1:]:
        apart = []
        for mine, other in zip(outlines["keygraph"], outlines[name], strict=True):
            if mine is not None and other is not None:
                apart.append(float(np.linalg.norm(mine - other, axis=1).mean()))
        px = statistics.median(apart)
        print(f"corners of {name} lie {px:.1f} px from ours (median of {len(apart)} frames)")


if __name__ == "__main__":
    main()
