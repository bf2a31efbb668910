#!/usr/bin/env python3
"""How the time of a search grows: with the objects that are looked for at once, with the
keygraphs of a model, with the corners of a frame, and with its size.

    python3 benches/growth.py [--objects 1 10 100 1000] [--frames 2]

Needs `cargo build --release`, and `pip install numpy opencv-python-headless matplotlib`.
Out: docs/growth.png and .json, and a table. Frames are rendered as in scripts/evaluate.py,
of five pictures of assets/ in six conditions. The other objects are posters that are drawn
here: coloured shapes and words over tinted parts of the two textures of assets/, each of
its own seed. Models are of the standard preset.

Cost: a model is trained in a second on each core, 1,000 objects take some ten minutes and
6 GB of disk (--work keeps the models there for the next run) and 1.5 GB of memory.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
sys.path.insert(0, os.path.join(ROOT, "scripts"))
import evaluate as ev  # noqa: E402

WORDS = "ATLAS GARDEN RIVER MODERN ART VOLUME NORTH SILENT OCEAN DAILY COFFEE BREAD 1984 ORBIT FIELD GUIDE STORY".split()
BYTES = [64 << 10, 128 << 10, 256 << 10, 512 << 10, 1 << 20, 2_000_000]
# Profile, and the width that frames are scaled to.
FRAMES = [("qqvga", 160), ("qvga", 320), ("vga", 640), ("hd", 960)]


def poster(seed, textures):
    """A picture that no other seed gives."""
    rng = np.random.default_rng(seed)
    w, h = [(480, 360), (360, 480), (420, 420), (540, 360)][rng.integers(4)]
    top, bottom = rng.uniform(0, 255, (2, 3))
    down = np.linspace(0, 1, h)[:, None, None]
    pixels = (top * (1 - down) + bottom * down) * np.ones((h, w, 1))
    texture = textures[rng.integers(len(textures))].astype(np.float64)
    turn = cv2.getRotationMatrix2D((w / 2, h / 2), rng.uniform(0, 360), rng.uniform(0.5, 1.5))
    x, y = np.sort(rng.integers(0, w, 2)), np.sort(rng.integers(0, h, 2))
    part = slice(*y), slice(*x)
    pixels[part] = (cv2.warpAffine(texture, turn, (w, h), borderMode=cv2.BORDER_REFLECT) * rng.uniform(0.3, 1.4, 3))[part]
    pixels = np.clip(pixels, 0, 255).astype(np.uint8)
    colour = lambda: tuple(map(float, rng.uniform(0, 255, 3)))  # noqa: E731
    place = lambda: (int(rng.integers(w)), int(rng.integers(h)))  # noqa: E731
    for _ in range(rng.integers(12, 40)):
        at, side, line = place(), int(rng.integers(6, 90)), int(rng.choice([-1, -1, 1, 3]))
        kind = rng.integers(4)
        if kind == 0:
            cv2.circle(pixels, at, side // 2, colour(), line, cv2.LINE_AA)
        elif kind == 1:
            cv2.rectangle(pixels, at, (at[0] + side, at[1] + int(rng.integers(5, 80))), colour(), line)
        elif kind == 2:
            cv2.fillPoly(pixels, [np.int32(rng.normal(at, side / 2, (int(rng.integers(3, 7)), 2)))], colour(), cv2.LINE_AA)
        else:
            cv2.line(pixels, at, place(), colour(), int(rng.integers(1, 5)), cv2.LINE_AA)
    for _ in range(rng.integers(4, 12)):
        text = " ".join(rng.choice(WORDS, rng.integers(1, 4)))
        at = int(rng.integers(-20, w // 2)), int(rng.integers(20, h))
        cv2.putText(pixels, text, at, int(rng.integers(0, 8)), float(rng.uniform(0.4, 2.2)), colour(),
                    int(rng.integers(1, 4)), cv2.LINE_AA)
    return pixels


def posters(command, folder, n):
    """-> paths of the models of `n` posters, trained where they are not there yet."""
    textures = [cv2.imread(os.path.join(ev.PICTURES, f"{name}.jpg")) for name in ("brick", "gravel")]

    def train(i):
        path = os.path.join(folder, f"poster-{i:04}.kgm")
        if not os.path.exists(path):
            picture = path[:-4] + ".jpg"
            cv2.imwrite(picture, poster(i, textures))
            done = [command, "train", picture, "--preset", "standard", "-o", path + ".part"]
            subprocess.run(done, check=True, stdout=subprocess.DEVNULL)
            os.rename(path + ".part", path)
        progress.add(1)
        return path

    progress = ev.Progress(n, "models")
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(train, range(n)))


def detect(command, model, paths, profile="vga"):
    """-> the JSON line of each frame, the seconds until all were done."""
    run = [command, "detect", "-m", model, "--json", "--threads", "1", "--profile", profile, *paths]
    start = time.perf_counter()
    done = subprocess.run(run, stdout=subprocess.PIPE, text=True, check=True)
    return [json.loads(line) for line in done.stdout.splitlines()], time.perf_counter() - start


def found(line, name, truth):
    """Whether the object is told at its place, and how often where it is not."""
    errors = [ev.relative_error(np.float64(d["corners"]), truth) for d in line["detections"] if d["object"] == name]
    right = min(errors, default=1.0) < ev.FOUND
    return right, len(line["detections"]) - right


def ms(lines):
    return statistics.median(line["time_ms"]["total"] for line in lines)


def by_objects(args, shots, own, work):
    """Rows of the table: one for each number of objects."""
    others = posters(args.keygraph, work, max(args.objects) - 1)
    rows = []
    for n in args.objects:
        lines, right, wrong, loads, sizes = [], 0, 0, [], []
        for picture, frames in shots:
            model = own[picture.digest]
            if n > 1:
                model = os.path.join(work, "pack.kgm")
                run = [args.keygraph, "pack", own[picture.digest], *others[: n - 1], "-o", model]
                subprocess.run(run, check=True, stdout=subprocess.DEVNULL)
            told, seconds = detect(args.keygraph, model, [f.path for f in frames])
            for line, frame in zip(told, frames):
                hit, false = found(line, picture.name, frame.quads[picture.digest])
                right, wrong = right + hit, wrong + false
            lines += told
            # The time of one frame more or less is nothing beside 1,000 objects.
            loads.append(detect(args.keygraph, model, [frames[0].path])[1])
            sizes.append(os.path.getsize(model))
        shown = sum(len(frames) for _, frames in shots)
        rows.append({"objects": n, "frames": shown, "found": right / shown, "wrong": wrong, "ms": round(ms(lines), 2),
                     "start_s": round(statistics.median(loads), 3), "bytes": statistics.median(sizes)})
        print(rows[-1], file=sys.stderr)
    return rows


def by_keygraphs(args, shots, work):
    """Time against the keygraphs of a model, where the object is and where it is not."""
    points = []
    for most in BYTES:
        counts, there, not_there = [], [], []
        for i, (picture, frames) in enumerate(shots):
            model = os.path.join(work, "sized.kgm")
            run = [args.keygraph, "train", picture.path, "--bytes", str(most), "-o", model, "--json"]
            counts.append(json.loads(subprocess.run(run, check=True, stdout=subprocess.PIPE, text=True).stdout)["keygraphs"])
            there += detect(args.keygraph, model, [f.path for f in frames])[0]
            # Frames of the others that show this one nowhere.
            other = [f for f in shots[i - 1][1] if picture.digest not in f.may_show]
            not_there += detect(args.keygraph, model, [f.path for f in other])[0]
        points.append({"keygraphs": statistics.median(counts), "shown": ms(there), "absent": ms(not_there)})
    return points


def by_frame(args, shots, own, work):
    """Time against the frame's size; and for 640x480 against its corners."""
    sizes, corners = [], []
    for profile, width in FRAMES:
        lines = []
        for picture, frames in shots:
            paths = []
            for f in frames:
                pixels = cv2.imread(f.path)
                k = width / pixels.shape[1]
                paths.append(os.path.join(work, f"{profile}-{os.path.basename(f.path)}"))
                cv2.imwrite(paths[-1], cv2.resize(pixels, None, fx=k, fy=k,
                                                  interpolation=cv2.INTER_AREA if k < 1 else cv2.INTER_LINEAR))
            lines += detect(args.keygraph, own[picture.digest], paths, profile)[0]
        sizes.append({"profile": profile, "pixels": lines[0]["width"] * lines[0]["height"], "ms": ms(lines)})
        if width == ev.WIDTH:
            corners = [[line["stages"]["corners"]["kept"], line["time_ms"]["total"]] for line in lines]
    return sizes, corners


def draw(numbers):
    plt = ev.pyplot()
    figure, axes = plt.subplots(1, 4, figsize=(14, 3.8), layout="constrained")
    blue, orange = "#0072B2", "#D55E00"
    a, b, c, d = axes
    rows = numbers["objects"]
    a.plot([r["objects"] for r in rows], [r["ms"] for r in rows], "o-", color=blue)
    for r in rows:
        a.annotate(f"{100 * r['found']:.0f} %", (r["objects"], r["ms"]), xytext=(0, 8), textcoords="offset points", ha="center")
    a.set_title("Objects at once (and found)")
    points = numbers["keygraphs"]
    for key, colour in (("shown", blue), ("absent", orange)):
        b.plot([p["keygraphs"] for p in points], [p[key] for p in points], "o-", color=colour, label=key)
    b.legend(frameon=False)
    b.set_title("Keygraphs of a model")
    c.plot(*zip(*numbers["corners"]), "o", color=blue, alpha=0.6)
    c.set_title("Corners in a frame")
    sizes = numbers["sizes"]
    d.plot([s["pixels"] for s in sizes], [s["ms"] for s in sizes], "o-", color=blue)
    for s in sizes:
        d.annotate(s["profile"], (s["pixels"], s["ms"]), xytext=(0, 8), textcoords="offset points", ha="center")
    d.set_title("Pixels of a frame")
    for axis in (a, b, d):
        axis.set_xscale("log")
        axis.minorticks_off()
    a.set_xticks([r["objects"] for r in rows], [f"{r['objects']:,}" for r in rows])
    for axis in axes:
        axis.set_ylim(0, 1.2 * axis.get_ylim()[1])
    a.set_ylabel("ms a frame, one thread, median")
    return figure


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--keygraph", default=os.path.join(ROOT, "target", "release", "keygraph"), metavar="FILE")
    p.add_argument("--objects", type=ev.positive, nargs="+", default=[1, 10, 100, 1000], metavar="N")
    p.add_argument("--frames", type=ev.positive, default=4, metavar="N", help="of each object and condition [default: 4]")
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--work", metavar="DIR", help="keep the posters' models here")
    p.add_argument("--out", default=os.path.join(ROOT, "docs", "growth.png"), metavar="FILE.png")
    args = p.parse_args()
    ev.check_figure(args.out)
    pictures = ev.read_pictures(ev.OBJECTS, 1, "objects")
    with tempfile.TemporaryDirectory(prefix="keygraph-") as folder:
        work = args.work or folder
        os.makedirs(work, exist_ok=True)
        studio = ev.Studio(folder, ev.read_pictures([ev.PICTURES], 3, "backgrounds"), args.seed)
        keygraph = ev.Keygraph("standard", args.keygraph, folder, ["--preset", "standard"])
        own = {picture.digest: keygraph.model(picture)[0] for picture in pictures}
        shots = [
            (picture, [studio.shoot(picture, factors, condition, n)
                       for condition, factors in ev.CONDITIONS.items() for n in range(args.frames)])
            for picture in pictures
        ]
        numbers = {"frames": args.frames, "seed": args.seed, "keygraphs": by_keygraphs(args, shots, folder)}
        numbers["sizes"], numbers["corners"] = by_frame(args, shots, own, folder)
        numbers["objects"] = by_objects(args, shots, own, work)
    ev.save(draw(numbers), numbers, args.out)
    print("| objects | found | wrong | ms a frame | pack, MB | first frame after, s |\n| --- | --- | --- | --- | --- | --- |")
    for r in numbers["objects"]:
        print(f"| {r['objects']:,} | {100 * r['found']:.0f} % | {r['wrong']} | {r['ms']:.1f} | {r['bytes'] / 1e6:.1f} | {r['start_s']:.2f} |")


if __name__ == "__main__":
    main()
