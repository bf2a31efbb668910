"""The command `tilt`: what is found from far to the side, plainly and with `--wide`, beside OpenCV.

Each object is tilted by more and more, along any direction. Frames of other objects tell what a wide search costs
where it searches all, and whether it finds what is not there.
"""

import random

from commands import detectors_of, median_time, open_studio
from detectors import Keygraph, try_search
from mixed import strange_frames
from pictures import read_pictures
from progress import Progress
from scoring import judge
from tables import tilt as table

TILTS = (50, 60, 65, 70, 75, 80)
# Longer side of the object seen from the front, in units of frames.UNIT: 420 to 590 px.
SCALE = (1.0, 1.4)


def tilt(args, folder):
    """Prints the table of found frames; gives its numbers."""
    objects = read_pictures(args.objects, 2, "objects")
    wide = Keygraph("Keygraph large, --wide", args.keygraph, folder)
    wide.options = ["--wide"]
    chosen = ("Keygraph large", "SIFT", "ORB")
    detectors = [wide, *(d for d in detectors_of(args, folder) if d.label in chosen)]
    shown = len(objects) * args.frames
    found = {d.label: dict.fromkeys(TILTS, 0) for d in detectors}
    misplaced, alarms = ({d.label: 0 for d in detectors} for _ in range(2))
    times = {d.label: [] for d in detectors}
    progress = Progress(shown * (len(TILTS) + 1) * len(detectors), "searches")
    with open_studio(args, folder) as studio:
        for i, picture in enumerate(objects):
            for angle in TILTS:
                factors = {"tilt": angle, "scale": SCALE}
                frames = [studio.shoot(picture, factors, "tilt", angle, n) for n in range(args.frames)]
                for detector in detectors:
                    for frame, search in try_search(detector, picture, frames):
                        verdicts = judge(search.detections, frame.quads[picture.digest])
                        right = sum(verdict.right for verdict in verdicts)
                        found[detector.label][angle] += right
                        misplaced[detector.label] += len(verdicts) - right
                    progress.add(len(frames))
                studio.clear(frames)
            rng = random.Random(f"{args.seed}-{i}")
            frames = strange_frames(studio, objects[(i + 1) % len(objects)], picture, rng, args.frames)
            for detector in detectors:
                for _, search in try_search(detector, picture, frames):
                    times[detector.label].append(search.ms)
                    alarms[detector.label] += len(search.detections)
                progress.add(len(frames))
            studio.clear(frames)
    numbers = {
        label: {
            "found": line,
            "misplaced": misplaced[label],
            "absent_ms": median_time(times[label]),
            "false_alarms": alarms[label],
        }
        for label, line in found.items()
    }
    told = {"frames": shown, "detectors": numbers}
    print(*table(told), sep="\n")
    return told
