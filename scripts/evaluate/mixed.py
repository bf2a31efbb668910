"""The command `mixed`: how long a frame takes, by what it shows.

A camera sees the object plainly, in a bad light or not at all. A third of the frames each shows it plainly, shows it
under two hard conditions at once, and does not show it. Each detector searches all frames, on one thread; Keygraph then
once more with two threads for each frame.
"""

import json
import random
import statistics
import subprocess
import sys

from commands import detectors_of, open_studio
from detectors import Refused, try_search
from frames import hard_factors
from pictures import read_pictures
from progress import Progress
from scoring import is_found

KINDS = ("plain", "hard", "absent")
THREADS = ("1", "2")


def mixed(args, folder):
    """Prints the table of times; gives its numbers."""
    objects = read_pictures(args.objects, 2, "objects")
    detectors = [d for d in detectors_of(args, folder) if d.label != "Keygraph luma"]
    times = {d.label: {kind: [] for kind in KINDS} for d in detectors}
    found = {d.label: dict.fromkeys(KINDS, 0) for d in detectors}
    together = {n: {kind: [] for kind in KINDS} for n in THREADS}
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
            for kind, frames in shot.items():
                for n in THREADS:
                    together[n][kind] += bench(detectors[0], picture, frames, n)
                studio.clear(frames)
    numbers = table(times, found)
    numbers["threads"] = {n: summary(by_kind) for n, by_kind in together.items()}
    return numbers


def bench(detector, picture, frames, threads):
    """The times of the frames, ms, when some threads search each together: medians of three passes."""
    try:
        model = detector.model(picture)[0]
    except Refused:
        return []
    run = [detector.command, "bench", "-m", model, "--threads", threads, "--passes", "3", "--json"]
    done = subprocess.run([*run, *(f.path for f in frames)], stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        sys.exit(f"`keygraph bench` ended with {done.returncode}")
    return json.loads(done.stdout)["each_ms"]


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
        numbers["detectors"][label] = {
            kind: {**row, "found": found[label].get(kind)} for kind, row in summary(by_kind).items()
        }
        cells = [f"{r['median_ms']:.1f}, {r['p99_ms']:.1f}" for r in numbers["detectors"][label].values()]
        print(f"| {label} | {' | '.join(cells)} |")
    return numbers


def summary(by_kind):
    """Median and 99th percentile of times, ms, by kind and of all."""
    rows = {**by_kind, "all": [ms for kind in KINDS for ms in by_kind[kind]]}
    return {kind: {"median_ms": statistics.median(ms), "p99_ms": percentile(ms, 0.99)} for kind, ms in rows.items()}


def percentile(values, part):
    """The value that `part` of the values do not exceed."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(part * len(ordered)))]
