"""The command `growth`: how the time of a search grows.

With the objects that are looked for at once, with the keygraphs of a model, with the
corners of a frame, and with its size. Models are of the standard preset.

Cost: a model is trained in a second on each core; 1,000 objects take some ten minutes,
6 GB of disk and 1.5 GB of memory.
"""

import json
import os
import statistics
import subprocess
import sys
import time

import cv2
from commands import open_studio
from detectors import Keygraph
from figures import check_figure, draw_growth, save
from frames import CONDITIONS, WIDTH
from pictures import read_pictures
from posters import poster_models
from scoring import Detection, is_found, relative_error

# Bytes that models are capped at.
BYTES = [64 << 10, 128 << 10, 256 << 10, 512 << 10, 1 << 20, 2_000_000]
# Keygraphs of each object on the lists, where they are fewer than packing takes.
LISTED = [3000, 1500]
# Profile, and the width that frames are scaled to.
PROFILES = [("qqvga", 160), ("qvga", 320), ("vga", 640), ("hd", 960)]


def growth(args, folder):
    """Draws docs/growth.png anew."""
    check_figure(args.out)
    pictures = read_pictures(args.objects, 1, "objects")
    work = args.work or folder
    os.makedirs(work, exist_ok=True)
    keygraph = Keygraph("standard", args.keygraph, folder, ["--preset", "standard"])
    own = {picture.digest: keygraph.model(picture)[0] for picture in pictures}
    with open_studio(args, folder) as studio:
        shots = [
            (
                picture,
                [studio.shoot(picture, f, c, n) for c, f in CONDITIONS.items() for n in range(args.frames)],
            )
            for picture in pictures
        ]
    numbers = {"frames": args.frames, "seed": args.seed, "keygraphs": by_keygraphs(args, shots, folder)}
    numbers["sizes"], numbers["corners"] = by_frame(args, shots, own, folder)
    numbers["objects"] = by_objects(args, shots, own, work)
    save(draw_growth(numbers), numbers, args.out, args.keygraph)
    return numbers


def detect(command, model, paths, profile="vga"):
    """The JSON line of each frame, and the seconds until all were done."""
    run = [command, "detect", "-m", model, "--json", "--threads", "1", "--profile", profile, *paths]
    start = time.perf_counter()
    done = subprocess.run(run, stdout=subprocess.PIPE, text=True, check=True)
    return [json.loads(line) for line in done.stdout.splitlines()], time.perf_counter() - start


def count_found(line, name, truth):
    """Whether the object is reported at its place, and how many other outlines are."""
    own = [Detection(d["score"], d["corners"]) for d in line["detections"] if d["object"] == name]
    nearest = sorted(own, key=lambda d: relative_error(d.corners, truth))
    right = is_found(nearest, truth)
    return right, len(line["detections"]) - right


def median_ms(lines):
    """The median time of the frames, ms."""
    return statistics.median(line["time_ms"]["total"] for line in lines)


def by_objects(args, shots, own, work):
    """Rows of the table: one for each number of objects, and for the largest one with fewer keygraphs on the lists."""
    most = max(args.counts)
    others = poster_models(args.keygraph, work, most - 1)
    cases = [(n, None) for n in args.counts] + [(most, n) for n in LISTED if most > 1]
    rows = []
    for n, listed in cases:
        tally = Tally()
        for i, (picture, frames) in enumerate(shots):
            models = [own[picture.digest], *others[: n - 1]]
            model, sizes = pack(args.keygraph, models, listed, work)
            told = detect(args.keygraph, model, [f.path for f in frames])[0]
            for line, frame in zip(told, frames, strict=True):
                tally.add(line, count_found(line, picture.name, frame.quads[picture.digest]))
            # Frames of another object that show this one nowhere.
            away = [f for f in shots[i - 1][1] if picture.digest not in f.may_show][:: args.frames]
            tally.absent += detect(args.keygraph, model, [f.path for f in away])[0]
            # The time of one frame more or less is nothing beside that of loading 1,000 objects.
            tally.loads.append(detect(args.keygraph, model, [frames[0].path])[1])
            tally.sizes.append(sizes)
        rows.append({"objects": n, "listed": listed, **tally.row()})
        print(rows[-1], file=sys.stderr)
    return rows


class Tally:
    """What the searches of a row have given."""

    def __init__(self):
        self.shown, self.absent, self.loads, self.sizes = [], [], [], []
        self.found = self.wrong = 0

    def add(self, line, verdict):
        """Adds a frame that shows the object."""
        found, wrong = verdict
        self.shown.append(line)
        self.found, self.wrong = self.found + found, self.wrong + wrong

    def row(self):
        """Shares, medians and sums."""
        whole, slim = (statistics.median(sizes) for sizes in zip(*self.sizes, strict=True))
        return {
            "frames": len(self.shown),
            "found": self.found / len(self.shown),
            "wrong": self.wrong,
            "ms": round(median_ms(self.shown), 2),
            "absent_frames": len(self.absent),
            "absent_found": sum(len(line["detections"]) for line in self.absent),
            "absent_ms": round(median_ms(self.absent), 2),
            "start_s": round(statistics.median(self.loads), 3),
            "bytes": whole,
            "slim_bytes": slim,
        }


def pack(command, models, listed, work):
    """The file to search, and the bytes of the whole and of the slim file. With `listed` the slim one is searched."""
    if len(models) == 1:
        return models[0], [os.path.getsize(models[0])] * 2
    whole, slim = (os.path.join(work, name) for name in ("whole.kgm", "slim.kgm"))
    run = [command, "pack", "-q"]
    fewer = [] if listed is None else ["--listed", str(listed)]
    subprocess.run([*run, *models, *fewer, "-o", whole], check=True)
    subprocess.run([*run, "-m", whole, "--slim", "-o", slim], check=True)
    return whole if listed is None else slim, [os.path.getsize(path) for path in (whole, slim)]


def by_keygraphs(args, shots, work):
    """Time against the keygraphs of a model, where the object is and where it is not."""
    points = []
    for most in BYTES:
        counts, shown, absent = [], [], []
        for i, (picture, frames) in enumerate(shots):
            model = os.path.join(work, "sized.kgm")
            run = [args.keygraph, "train", picture.path, "--bytes", str(most), "-o", model, "--json"]
            done = subprocess.run(run, check=True, stdout=subprocess.PIPE, text=True)
            counts.append(json.loads(done.stdout)["keygraphs"])
            shown += detect(args.keygraph, model, [f.path for f in frames])[0]
            # Frames of another object that show this one nowhere.
            other = [f for f in shots[i - 1][1] if picture.digest not in f.may_show]
            absent += detect(args.keygraph, model, [f.path for f in other])[0]
        points.append({"keygraphs": statistics.median(counts), "shown": median_ms(shown), "absent": median_ms(absent)})
    return points


def by_frame(args, shots, own, work):
    """Time against the frame's size; and for 640x480 against its corners."""
    sizes, corners = [], []
    for profile, width in PROFILES:
        lines = []
        for picture, frames in shots:
            paths = [resized(f.path, width, work, profile) for f in frames]
            lines += detect(args.keygraph, own[picture.digest], paths, profile)[0]
        sizes.append({"profile": profile, "pixels": lines[0]["width"] * lines[0]["height"], "ms": median_ms(lines)})
        if width == WIDTH:
            corners = [[line["stages"]["corners"]["kept"], line["time_ms"]["total"]] for line in lines]
    return sizes, corners


def resized(path, width, work, profile):
    """The path of a copy of the frame that is `width` px wide."""
    pixels = cv2.imread(path)
    k = width / pixels.shape[1]
    method = cv2.INTER_AREA if k < 1 else cv2.INTER_LINEAR
    copy = os.path.join(work, f"{profile}-{os.path.basename(path)}")
    cv2.imwrite(copy, cv2.resize(pixels, None, fx=k, fy=k, interpolation=method))
    return copy
