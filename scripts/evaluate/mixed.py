"""The command `mixed`: how long a frame takes, by what it shows.

A camera sees the object plainly, in a bad light or not at all. A third of the frames each shows it plainly, shows it
under two hard conditions at once, and does not show it. Each detector searches all frames, on one thread.
"""

import random
import statistics

from commands import detectors_of, open_studio
from detectors import try_search
from frames import hard_factors
from pictures import read_pictures
from progress import Progress
from scoring import is_found

KINDS = ("plain", "hard", "absent")


def mixed(args, folder):
    """Prints the table of times; gives its numbers."""
    objects = read_pictures(args.objects, 2, "objects")
    detectors = [d for d in detectors_of(args, folder) if d.label != "Keygraph luma"]
    times = {d.label: {kind: [] for kind in KINDS} for d in detectors}
    found = {d.label: dict.fromkeys(KINDS, 0) for d in detectors}
    progress = Progress(len(objects) * len(KINDS) * args.frames * len(detectors), "searches")
    with open_studio(args, folder) as studio:
        for i, picture in enumerate(objects):
            rng = random.Random(f"{args.seed}-{i}")
            stranger = objects[(i + 1) % len(objects)]
            shot = {
                "plain": [studio.shoot(picture, {}, "mixed plain", n) for n in range(args.frames)],
                "hard": [studio.shoot(picture, hard_factors(rng), "mixed hard", n) for n in range(args.frames)],
                "absent": strange_frames(studio, stranger, picture, rng, args.frames),
            }
            for detector in detectors:
                for kind, frames in shot.items():
                    for frame, search in try_search(detector, picture, frames):
                        times[detector.label][kind].append(search.ms)
                        found[detector.label][kind] += is_found(search.detections, frame.quads.get(picture.digest))
                    progress.add(len(frames))
            for frames in shot.values():
                studio.clear(frames)
    return table(times, found)


def strange_frames(studio, shown, picture, rng, count):
    """Frames of another object, in none of which `picture` may be seen."""
    frames, n = [], 0
    while len(frames) < count:
        frame = studio.shoot(shown, hard_factors(rng), "mixed absent", n)
        n += 1
        if picture.digest in frame.may_show:
            studio.clear([frame])
        else:
            frames.append(frame)
    return frames


def table(times, found):
    """Prints medians and 99th percentiles, ms; gives all numbers."""
    print("| median, 99th percentile, ms | plain | hard | absent | all |\n| --- | --- | --- | --- | --- |")
    numbers = {"frames": len(next(iter(times.values()))["plain"]), "detectors": {}}
    for label, by_kind in times.items():
        rows = {**by_kind, "all": [ms for kind in KINDS for ms in by_kind[kind]]}
        numbers["detectors"][label] = {
            kind: {"median_ms": statistics.median(ms), "p99_ms": percentile(ms, 0.99), "found": found[label].get(kind)}
            for kind, ms in rows.items()
        }
        cells = [f"{r['median_ms']:.1f}, {r['p99_ms']:.1f}" for r in numbers["detectors"][label].values()]
        print(f"| {label} | {' | '.join(cells)} |")
    return numbers


def percentile(values, part):
    """The value that `part` of the values do not exceed."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(part * len(ordered)))]
