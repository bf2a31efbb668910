"""The command `measure`: measures again what the pages show, and writes records and tables.

A part is measured on one build and kept as one record, which names that build. Scorers of photographs that cannot be
shipped leave JSON files in a folder; of these the records `accuracy`, `siblings` and `bent` are made.
"""

import json
import os
import subprocess
import sys
import time
from statistics import median

import cv2
from pages import update
from places import PICTURES, SEQUENCE
from record import FIGURES, write_record

# Part -> the options with which its command is run, and the minutes that it takes on two cores.
PARTS = {
    "rivals": ([], 2),
    "mixed": (["--frames", "16"], 2),
    "tilt": ([], 8),
    "costs": ([], 1),
    "precision": ([], 2),
    "calibration": ([], 3),
    "economy": (["--frames", "12"], 12),
    "curves": (["--frames", "3"], 10),
    "look-alikes": (["--groups", "2", "--frames", "3"], 15),
    "growth": ([], 30),
    "tracking": ([], 3),
    "lenses": ([], 2),
    "memory": ([], 6),
    "cluster": ([], 6),
    "web": ([], 2),
    "pictures": ([], 10),
}
# Files of the scorer: a run each.
SCORES = ("large", "standard", "compact", "luma", "paper", "rivals", "hard")


def measure(args, folder):
    """Measures the parts of the command line, or all, and brings the pages up to date."""
    if args.scores:
        scores(args.scores, args.keygraph)
    for part in args.parts:
        if part not in PARTS:
            sys.exit(f"there is no part {part}: give {', '.join(PARTS)}")
    parts = args.parts or ([] if args.scores or args.pages else list(PARTS))
    print(
        f"{', '.join(parts) or 'nothing'} to measure: some {sum(PARTS[p][1] for p in parts)} minutes", file=sys.stderr
    )
    for part in parts:
        print(f"== {part}", flush=True)
        numbers = args.run(part, [*PARTS[part][0], "--keygraph", args.keygraph])
        if part not in FIGURES:
            write_record(part, numbers, args.keygraph)
    for wrong in update():
        print(wrong, file=sys.stderr)


def scores(folder, keygraph):
    """Writes the records of what scorers of photographs left in a folder."""
    records = {"accuracy": accuracy(folder), "siblings": siblings(folder)}
    records["tracking-videos"] = read(folder, "tracking")
    bent = read(folder, "bent")
    records["bent"] = {who: told["total"] for who, told in bent.items()} if bent else {}
    if not any(records.values()):
        sys.exit(
            f"{folder} has no file of a scorer: {', '.join(f'{n}.json' for n in (*SCORES, 'look-alikes-1', 'bent'))}"
        )
    for part, numbers in records.items():
        if numbers:
            write_record(part, numbers, keygraph)


def accuracy(folder):
    """Frames found, by run or rival and by group of frames."""
    out = {}
    for name in SCORES:
        groups = read(folder, name).get("groups", {})
        for who in next(iter(groups.values()), {}):
            out[name if who == "keygraph" else who] = {
                group: {key: row[who][key] for key in ("frames", "shown", "found", "tight", "false")}
                for group, row in groups.items()
            }
    return out


def siblings(folder):
    """Look-alikes, searched for alone and together, by family: sums over the runs look-alikes-1, -2, ..."""
    out, seed = {}, 1
    while told := read(folder, f"look-alikes-{seed}"):
        for family, row in told["keygraph"].items():
            sums = out.setdefault(family, dict.fromkeys(row, 0))
            for key, count in row.items():
                sums[key] += count
        seed += 1
    for row in out.values():
        row["alone_in_100"] = 100 * row["alone_false"] / row["alone_looks"] if row["alone_looks"] else None
    return out


def read(folder, name):
    """What lies in a file of a scorer; nothing where there is none."""
    try:
        with open(os.path.join(folder, f"{name}.json"), encoding="utf-8") as f:
            return json.load(f)
    except FileNotFoundError:
        return {}


def costs(args, folder):
    """Times of whole commands: training, a folder of frames on one core and on two, a start."""
    large, small = (os.path.join(folder, name) for name in ("large.jpg", "small.jpg"))
    picture = os.path.join(PICTURES, "astronaut.jpg")
    pixels = cv2.imread(picture)
    cv2.imwrite(large, cv2.resize(pixels, (4000, 3000), interpolation=cv2.INTER_CUBIC))
    cv2.imwrite(small, cv2.resize(pixels, (160, 120), interpolation=cv2.INTER_AREA))
    model, other = (os.path.join(folder, name) for name in ("model.kgm", "other.kgm"))
    train = [args.keygraph, "train", "--preset", "standard", "-o"]
    numbers = {"train_s": seconds([*train, model, picture]), "train_12_megapixels_s": seconds([*train, other, large])}
    frames = [os.path.join(SEQUENCE, name) for name in sorted(os.listdir(SEQUENCE)) if name.endswith(".jpg")] * 8
    detect = [args.keygraph, "detect", "-m", model, "--json"]
    numbers["frames"] = len(frames)
    for threads in ("1", "2"):
        numbers[f"threads_{threads}_s"] = seconds([*detect, "--threads", threads, *frames])
    numbers["small_picture_ms"] = 1e3 * seconds([*detect, small], times=9)
    numbers["model_bytes"] = os.path.getsize(model)
    for name, value in numbers.items():
        print(f"{name}: {value}")
    return numbers


def seconds(command, times=3):
    """The median time of a command, start of the program included, s."""
    taken = []
    for _ in range(times):
        start = time.perf_counter()
        # 1 says that nothing was found.
        if subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False).returncode > 1:
            sys.exit(f"this failed: {' '.join(command)}")
        taken.append(time.perf_counter() - start)
    return round(median(taken), 4)
