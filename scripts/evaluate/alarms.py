"""The commands that measure what a score is worth: `calibration` and `false-alarms`."""

import os
import random
import sys

from commands import open_studio
from detectors import Keygraph, try_search
from frames import hard_factors, keep
from pictures import picture_paths, read_picture, read_pictures
from progress import Progress
from scoring import THRESHOLD, Verdict, histogram, judge, mean_gap, relative_error, reliability, upper_limit
from truth import Frame, gather

BATCH = 100  # rendered frames on disk at once


# ------------------------------------------------------------------ calibration


def calibration(args, folder):
    """What the score is worth: the share of right detections in each bin of it."""
    objects, frames = gather(args.truth, read_pictures(args.objects, 2, "objects"), read_picture)
    detector = Keygraph("calibration", args.keygraph, folder, args.train, threads=2, threshold=0.0)
    given = sum(quad is not None for f in frames for quad in f.quads.values())
    scored = Scored(detector, args.keep, Progress(given + 2 * args.frames * len(objects), "searches"))
    with open_studio(args, folder) as studio:
        for i, picture in enumerate(objects):
            scored.search(picture, [f for f in frames if f.quads.get(picture.digest) is not None])
            rng = random.Random(f"{args.seed}-{i}")
            shot = [studio.shoot(picture, hard_factors(rng), "calibration", n) for n in range(args.frames)]
            scored.search(picture, shot)
            # The frames of one object are searched for the next that is not in them.
            for k in range(1, len(objects)):
                stranger = objects[(i + k) % len(objects)]
                absent = [f for f in shot if stranger.digest not in f.may_show]
                if absent:
                    scored.search(stranger, absent)
                    break
            studio.clear(shot)
    print_reliability(scored.pairs, args.bins)
    for score, where in sorted(scored.wrong, reverse=True):
        print(f"wrong: {score:.3f}, {where}")
    told = sum(score >= THRESHOLD for score, _ in scored.pairs)
    return {"detections": told, "wrong": len(scored.wrong), "wrong_where": [where for _, where in sorted(scored.wrong)]}


class Scored:
    """The detections of all searches, and which of them are right."""

    def __init__(self, detector, folder, progress):
        self.detector, self.folder, self.progress = detector, folder, progress
        self.pairs = []  # (score, right) of every detection
        self.wrong = []  # (score, where) of the wrong ones that would be reported

    def search(self, picture, frames):
        """Looks for `picture` in `frames`, and judges what is found."""
        if not frames:
            return
        for frame, search in try_search(self.detector, picture, frames):
            truth = frame.quads.get(picture.digest)
            for d, verdict in zip(search.detections, judge(search.detections, truth), strict=True):
                self.pairs.append((d.score, verdict.right))
                if d.score >= THRESHOLD and not verdict.right:
                    why = verdict.value
                    if verdict is Verdict.WRONG_PLACE:
                        why += f", off by {100 * relative_error(d.corners, truth):.0f} %"
                    self.wrong.append((d.score, f"{picture.name} in {os.path.basename(frame.path)}: {why}"))
                    keep(self.folder, picture.name, frame)
        self.progress.add(len(frames))


def print_reliability(scored, bins, weights=None):
    """Prints the table of (score, right) pairs, with weights where there are some."""
    if not scored:
        sys.exit("nothing was detected at all: there is nothing to calibrate on")
    table = reliability(scored, bins, weights)
    print("| score | detections | mean score | share right |")
    print("| --- | --- | --- | --- |")
    for b in table:
        print(f"| {b.low:.2f} to {b.high:.2f} | {b.count:,} | {b.mean_score:.3f} | {b.share_right:.3f} |")
    told = [right for score, right in scored if score >= THRESHOLD]
    wrong = told.count(False)
    print(
        f"\nMean gap between score and share right: {mean_gap(table):.3f}, "
        f"above the lowest bin {mean_gap([b for b in table if b.low > 0]):.3f}. "
        f"At {THRESHOLD:g} and above: {len(told):,} detections, {wrong:,} wrong "
        f"({100 * wrong / max(1, len(told)):.2f} %)."
    )


# ------------------------------------------------------------------ false alarms


def false_alarms(args, folder):
    """Every object looked for in frames that do not show it."""
    truth = [p for p in args.frames if p.endswith(".json")]
    objects, frames = gather(truth, read_pictures(args.objects, 2, "objects"), read_picture)
    plain = picture_paths(p for p in args.frames if not p.endswith(".json"))
    frames += [Frame(os.path.realpath(p)) for p in plain]
    detector = Keygraph("alarms", args.keygraph, folder, args.train, threads=2, threshold=args.threshold)
    total = max(args.pairs, sum(o.digest not in f.may_show for o in objects for f in frames))
    alarms = Alarms(detector, objects, args.keep, Progress(total, "pairs"))
    for i in range(0, len(frames), BATCH):
        alarms.search("given", frames[i : i + BATCH])
    rng, n = random.Random(args.seed), 0
    with open_studio(args, folder) as studio:
        while alarms.pairs < args.pairs:
            shown = [(objects[k % len(objects)], k) for k in range(n, n + BATCH)]
            batch = [studio.shoot(picture, hard_factors(rng), "alarm", k) for picture, k in shown]
            before = alarms.pairs
            alarms.search("rendered", batch, args.pairs)
            studio.clear(batch)
            n += BATCH
            if alarms.pairs == before:
                sys.exit("every frame may show every object: give more --objects")
    alarms.print(args.threshold)
    false = sum(s >= THRESHOLD for s in alarms.scores)
    return {
        "pairs": alarms.pairs,
        "objects": len(objects),
        "detections": false,
        "scores": sorted(s for s in alarms.scores if s >= THRESHOLD),
        "fewer_than_one_in": alarms.pairs / upper_limit(false),
    }


class Alarms:
    """What is detected in frames that do not show it."""

    def __init__(self, detector, objects, folder, progress):
        self.detector, self.objects, self.folder, self.progress = detector, objects, folder, progress
        self.scores = []  # of every detection
        self.alarms = []  # (score, object, kind, frame) of frames with one that would be reported
        self.asked = {"given": 0, "rendered": 0}  # pairs of frame and object

    @property
    def pairs(self):
        """Pairs of frame and object so far."""
        return sum(self.asked.values())

    def search(self, kind, frames, most=None):
        """Looks for each object in the frames that do not show it, until there are `most` pairs."""
        for picture in self.objects:
            absent = [f for f in frames if picture.digest not in f.may_show]
            if most is not None:
                absent = absent[: most - self.pairs]
            if not absent:
                continue
            for frame, search in try_search(self.detector, picture, absent):
                self.scores += [d.score for d in search.detections]
                worst = max((d.score for d in search.detections), default=0.0)
                if worst >= THRESHOLD:
                    self.alarms.append((worst, picture.name, kind, os.path.basename(frame.path)))
                    keep(self.folder, picture.name, frame)
            self.asked[kind] += len(absent)
            self.progress.add(len(absent))

    def print(self, threshold):
        """Prints the counts, the histogram of scores, and every false alarm."""
        false = sum(s >= THRESHOLD for s in self.scores)
        print(
            f"{self.pairs:,} pairs of frame and object not in it ({self.asked['given']:,} on frames given, "
            f"{self.asked['rendered']:,} on rendered ones): {false} detections at {THRESHOLD:g} and above; "
            f"with 95 % certainty fewer than one in {self.pairs / upper_limit(false):,.0f} pairs.\n"
        )
        print("| score | detections | per 10,000 pairs |\n| --- | --- | --- |")
        for low, high, n in histogram(self.scores, threshold):
            print(f"| {low:.2f} to {high:.2f} | {n} | {1e4 * n / self.pairs:.1f} |")
        for score, name, kind, frame in sorted(self.alarms, reverse=True):
            print(f"false alarm: {name} with {score:.3f} in {frame} ({kind})")
