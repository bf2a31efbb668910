"""Looks for memory that calls leave behind: `python leaks.py [CALLS]`, 100,000 unless given.

Each call searches a small frame, follows an object, reads all of the results, and passes what is
refused. The numbers are those of the process (Linux) and of Python's own objects.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import pickle
import sys
from collections.abc import Callable
from pathlib import Path

import keygraph
import numpy as np

ROOT = Path(__file__).resolve().parents[3]


class Mallinfo(ctypes.Structure):
    """What glibc's allocator says of itself (mallinfo2)."""

    _fields_ = [
        (name, ctypes.c_size_t) for name in "arena ordblks smblks hblks hblkhd usmblks fsmblks use free keep".split()
    ]


def allocated() -> int:
    """Bytes that the process has allocated and not freed, but for Python's small objects."""
    mallinfo = ctypes.CDLL(None).mallinfo2
    mallinfo.restype = Mallinfo
    info = mallinfo()
    return int(info.use) + int(info.hblkhd)


def resident() -> int:
    """Memory of the process, bytes."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096


class Caller:
    """Calls everything that is cheap to call."""

    def __init__(self) -> None:
        picture = keygraph.imread(ROOT / "assets/pictures/astronaut.jpg")
        self.small = keygraph.train(picture, "a", "compact", max_bytes=60_000)
        self.detector = keygraph.Detector(self.small, "qqvga")
        self.tracker = keygraph.Tracker(self.small, "qqvga")
        large = keygraph.imread(ROOT / "assets/sequence/0005.jpg")
        self.frame = np.ascontiguousarray(large[::4, ::4])
        self.data = self.frame.tobytes()

    def __call__(self) -> None:
        for found in (
            self.detector.detect(self.frame),
            self.detector.detect(self.frame[..., ::-1], order="bgr"),
            self.detector.detect(self.data, format="rgb", size=(160, 120)),
            self.tracker.track(self.frame),
        ):
            _ = (found.to_dict(), found.xyxy, found.corners, found.ids, found.time_ms, found.lost)
            for d in found:
                _ = (d.corners, d.homography, d.rivals, d.to_dict(), d._repr_html_(), repr(d))
                _ = keygraph.pose(d, (150, 150, 80, 60), 200)
        with contextlib.suppress(TypeError):
            self.detector.detect(self.frame.astype(np.float32))
        with contextlib.suppress(ValueError):
            self.detector.detect(self.data, format="yuyv", size=(160, 120))


class Rare:
    """Calls what takes longer, now and then."""

    def __init__(self, caller: Caller) -> None:
        self.caller = caller
        self.picture = np.random.default_rng(1).integers(0, 255, (48, 64, 3), np.uint8)

    def __call__(self) -> None:
        keygraph.Detector([self.caller.small, self.caller.small], "qqvga").detect(self.caller.frame)
        pickle.loads(pickle.dumps(self.caller.small))
        keygraph.imread(ROOT / "assets/sequence/0005.jpg")
        self.caller.detector.detect(self.caller.frame)._repr_png_()


def growth(call: Callable[[], object], calls: int, windows: int = 8) -> tuple[int, int]:
    """Bytes that are allocated, and blocks of Python, that `calls` calls leave behind."""
    # What is made once is made here, that of the measuring too.
    for _ in range(50):
        call()
    allocated()
    gc.collect()
    grown = []
    for _ in range(windows):
        blocks, before = sys.getallocatedblocks(), allocated()
        for _ in range(calls):
            call()
        gc.collect()
        grown.append((allocated() - before, sys.getallocatedblocks() - blocks))
    # What is left behind by each call is in every window; what Python keeps for later is in the first few.
    return min(grown for grown, _ in grown), min(blocks for _, blocks in grown)


def main() -> None:
    calls = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    caller = Caller()
    print(f"{len(caller.detector.detect(caller.frame))} object in a frame of 160x120 px")
    for name, call, times in (("detect and track", caller, calls // 4), ("load and draw", Rare(caller), calls // 500)):
        before = resident()
        grown, blocks = growth(call, times // 8)
        each = 4 if call is caller else 1
        print(
            f"{name}: {each * (times // 8)} frames leave {grown} bytes and {blocks} blocks of Python; "
            f"the process grew by {(resident() - before) // 1024} KB"
        )


if __name__ == "__main__":
    main()
