#!/usr/bin/env python3
"""Measure how well objects are found, on rendered frames whose pose is known exactly.

    python3 scripts/evaluate.py curves          docs/curves.png, .json: found, against
                                                scale, rotation, tilt, occlusion, light
    python3 scripts/evaluate.py economy         docs/economy.png, .json: found, against
                                                the model's size
    python3 scripts/evaluate.py precision       corner error in px, a table
    python3 scripts/evaluate.py calibration [TRUTH.json ...]
                                                score against the share right, a table
    python3 scripts/evaluate.py false-alarms [FRAMES ...]
                                                detections where nothing is to be found

Needs `cargo build --release`, and
`pip install numpy opencv-python-headless matplotlib`.
The same pictures, seed and versions of these packages give the same frames.

In: pictures of objects and backgrounds (those of assets/ unless others are
given); for `calibration` and `false-alarms` also truth files: a list of
{"name", "model": picture, "frames": [{"image", "H" or "corners"}]}, paths
relative to the file. "H" maps picture pixels to frame pixels (nine numbers or
three rows), "corners" are the images of (0,0), (w,0), (w,h), (0,h), null of
either says that the object is not there. A frame with "train": true shows the
object and is left out (the picture was cut from it).

Frames: 640x480 px. At scale 1 the object's longer side is 420 px; it is seen by
a pinhole camera of 600 px focal length, over a background and behind a patch
that never show the object itself. Pixel centres have integer coordinates.

Found: the mean distance of the best detection's four corners from the truth is
under 10 % of the object's size, the square root of its area in the frame.
Rivals: OpenCV's SIFT and ORB (1,000 features) with ratio test and RANSAC
homography, on the same frames. Times are in-process, of one thread, from the
decoded pixels to the outlines.

Cost: a frame is rendered in about 60 ms, and searched in 10 to 150 ms; `curves` takes
some 20 minutes, `economy` 15, `false-alarms` 15 to 50, the tables a few minutes.
"""

import argparse
import hashlib
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field

import cv2
import numpy as np

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
PICTURES = os.path.join(ROOT, "assets", "pictures")
OBJECTS = [os.path.join(PICTURES, f"{name}.jpg") for name in ("astronaut", "chelsea", "coffee", "hubble", "rocket")]

WIDTH, HEIGHT = 640, 480
UNIT = 420.0             # longer side of the object at scale 1, px
FOCAL = 600.0            # of the camera, px
SUPER = 2                # supersampling of the rendering
QUALITY = 90             # of the frames' JPEG
FOUND = 0.10             # of the object's size
THRESHOLD = 0.8          # the command's default score

# Every factor of a frame, and the range it is drawn from where nothing else is asked.
PLAIN = {
    "scale": (0.5, 1.0),
    "rotation": (0.0, 360.0),    # degrees
    "tilt": (0.0, 20.0),         # degrees between the object's normal and the line of sight
    "occlusion": (0.0, 0.0),     # hidden share of the object's area
    "blur": (0.4, 0.8),          # standard deviation, px
    "light": (0.8, 1.2),         # gain
    "noise": (3.0, 3.0),         # standard deviation, gray levels
    "cast": (0.0, 0.0),          # each channel is multiplied by 1 - cast to 1 + cast
}

# Conditions that are mixed where one figure must stand for all.
CONDITIONS = {
    "plain": {},
    "small": {"scale": (0.25, 0.4)},
    "tilted": {"tilt": (40.0, 55.0)},
    "30 % hidden": {"occlusion": 0.3},
    "dark, noisy": {"light": (0.15, 0.3), "noise": 6.0},
    "blurred": {"blur": (2.0, 4.0)},
}


@dataclass(frozen=True)
class Sweep:
    """One factor, moved while the others stay plain."""

    factor: str
    title: str
    values: tuple
    ticks: tuple
    percent: bool = False    # ticks are shares, shown in per cent
    log: bool = False


SWEEPS = [
    Sweep("scale", "Scale", (0.2, 0.25, 0.3, 0.4, 0.5, 0.7, 1.0, 1.4, 2.0), (0.2, 0.3, 0.5, 1, 2), log=True),
    Sweep("rotation", "Rotation, degrees", tuple(range(0, 361, 20)), (0, 90, 180, 270, 360)),
    Sweep("tilt", "Tilt, degrees", (0, 10, 20, 30, 40, 50, 60, 70), (0, 20, 40, 60)),
    Sweep("occlusion", "Hidden, %", (0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6), (0, 0.2, 0.4, 0.6), percent=True),
    Sweep("blur", "Blur, px", (0.5, 1, 2, 3, 4, 5, 6), (0, 2, 4, 6)),
    Sweep("light", "Light, % of plain", (0.05, 0.07, 0.1, 0.14, 0.2, 0.3, 0.5, 1), (0.05, 0.1, 0.2, 0.5, 1),
          percent=True, log=True),
    Sweep("noise", "Noise, gray levels", (0, 5, 10, 15, 20, 30, 40), (0, 10, 20, 30, 40)),
    Sweep("cast", "Colour cast, ± %", (0, 0.1, 0.2, 0.3, 0.4, 0.5), (0, 0.2, 0.4), percent=True),
]


# ------------------------------------------------------------------ pictures and frames


@dataclass
class Picture:
    """A picture on disk; two with the same bytes are the same."""

    path: str
    pixels: np.ndarray = field(repr=False)
    digest: str

    @property
    def name(self):
        return os.path.splitext(os.path.basename(self.path))[0]

    @property
    def size(self):
        """Width and height, px."""
        return self.pixels.shape[1], self.pixels.shape[0]


@dataclass
class Frame:
    """A frame on disk, and where objects are in it."""

    path: str
    quads: dict              # digest of an object's picture -> 4x2 corners in px; None: there, but not known where
    may_show: set            # digests of all that may be seen: an object not among them is not there


def read_picture(path):
    try:
        with open(path, "rb") as file:
            data = file.read()
    except OSError as e:
        sys.exit(f"{path}: {e.strerror}")
    pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if data else None
    if pixels is None:
        sys.exit(f"{path}: not a picture; give PNG or JPEG files")
    return Picture(path, pixels, hashlib.sha256(data).hexdigest())


def picture_paths(paths):
    """The files given, and the pictures in the folders given, sorted by name."""
    found = []
    for path in paths:
        if os.path.isdir(path):
            names = (n for n in sorted(os.listdir(path)) if n.lower().endswith((".jpg", ".jpeg", ".png")))
            found += [os.path.join(path, n) for n in names]
        else:
            found.append(path)
    return found


def read_pictures(paths, least, what):
    """The pictures at `paths`, each once; ends the program when there are fewer than `least`."""
    pictures = list({p.digest: p for p in map(read_picture, picture_paths(paths))}.values())
    if len(pictures) < least:
        sys.exit(f"{len(pictures)} {what}: give at least {least}")
    return pictures


def outline(homography, size):
    """The images of (0,0), (w,0), (w,h), (0,h): 4x2, px."""
    w, h = size
    corners = np.float64([[[0, 0], [w, 0], [w, h], [0, h]]])
    return cv2.perspectiveTransform(corners, np.float64(homography).reshape(3, 3))[0]


def read_truth(path):
    """The objects and the frames of a truth file."""
    base = os.path.dirname(os.path.abspath(path))
    try:
        with open(path, encoding="utf-8") as text:
            sets = json.load(text)
        pictures, frames = {}, {}
        for entry in sets if isinstance(sets, list) else [sets]:
            picture = read_picture(os.path.join(base, entry["model"]))
            pictures.setdefault(picture.digest, picture)
            for f in entry["frames"]:
                image = os.path.realpath(os.path.join(base, f["image"]))
                frame = frames.setdefault(image, Frame(image, {}, set()))
                quad = None
                if f.get("H") is not None:
                    quad = outline(f["H"], picture.size)
                elif f.get("corners") is not None:
                    quad = np.float64(f["corners"]).reshape(4, 2)
                elif not f.get("train"):
                    continue
                frame.quads[picture.digest] = None if f.get("train") else quad
                frame.may_show.add(picture.digest)
    except OSError as e:
        sys.exit(f"{path}: {e.strerror}")
    except (KeyError, TypeError, ValueError) as e:
        sys.exit(f"{path}: not a truth file ({type(e).__name__}: {e}); `--help` says what is in one")
    return list(pictures.values()), list(frames.values())


# ------------------------------------------------------------------ renderer


def draw(rng, factors):
    """One value for every factor: a range is drawn from, a number stays."""
    chosen = {**PLAIN, **factors}
    return {k: float(rng.uniform(*v)) if isinstance(v, tuple) else float(v) for k, v in chosen.items()}


def rotation_about(axis, degrees):
    """The 3x3 matrix of a turn about the x, y or z axis (0, 1, 2)."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turn = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn[i, i], turn[i, j], turn[j, i], turn[j, j] = c, -s, s, c
    return turn


def camera_homography(size, scale, rotation, tilt, direction, x, y):
    """Picture pixels to frame pixels: the object's middle is seen at (x, y), at the
    depth where it would measure `scale`, turned by `rotation` and tilted by `tilt`
    about an axis in direction `direction` (degrees)."""
    w, h = size
    longer = max(w, h)
    middle = (WIDTH - 1) / 2, (HEIGHT - 1) / 2
    depth = FOCAL / (scale * UNIT)       # in longer sides of the object
    r = rotation_about(2, direction) @ rotation_about(0, tilt) @ rotation_about(2, rotation - direction)
    place = [(x - middle[0]) * depth / FOCAL, (y - middle[1]) * depth / FOCAL, depth]
    plane = np.array([[1, 0, -(w - 1) / 2], [0, 1, -(h - 1) / 2], [0, 0, longer]]) / longer
    lens = np.array([[FOCAL, 0, middle[0]], [0, FOCAL, middle[1]], [0, 0, 1]])
    homography = lens @ np.column_stack([r[:, 0], r[:, 1], place]) @ plane
    return homography / homography[2, 2]


def pose(rng, size, factors):
    """A homography that shows the whole object, the nearer to the frame's middle the
    less room there is for it; the one in the middle when there is none."""
    direction = rng.uniform(0, 360)
    tries = 30
    for i in range(tries):
        reach = 1 - (i + 1) / tries
        x = WIDTH / 2 + reach * rng.uniform(-WIDTH / 2, WIDTH / 2)
        y = HEIGHT / 2 + reach * rng.uniform(-HEIGHT / 2, HEIGHT / 2)
        homography = camera_homography(size, factors["scale"], factors["rotation"], factors["tilt"], direction, x, y)
        quad = outline(homography, size)
        if (quad > 2).all() and (quad < [WIDTH - 3, HEIGHT - 3]).all():
            break
    return homography


def cover(rng, pixels, width, height):
    """A random part of a picture, enlarged to `width` x `height`."""
    h, w = pixels.shape[:2]
    zoom = max(width / w, height / h) * rng.uniform(1.0, 1.5)
    w, h = max(width, round(w * zoom)), max(height, round(h * zoom))
    x, y = rng.integers(0, w - width + 1), rng.integers(0, h - height + 1)
    part = cv2.resize(pixels, (w, h), interpolation=cv2.INTER_AREA if zoom < 1 else cv2.INTER_LINEAR)
    part = part[y : y + height, x : x + width]
    return part[:, ::-1] if rng.random() < 0.5 else part


def to_canvas(homography):
    """The homography into the supersampled frame."""
    shift = (SUPER - 1) / 2
    return np.array([[SUPER, 0, shift], [0, SUPER, shift], [0, 0, 1.0]]) @ homography


def hide(rng, canvas, quad, share, pixels):
    """Covers `share` of the object with an upright rectangle of another picture."""
    quad = np.float32(quad * SUPER)
    u, v = rng.uniform(0.2, 0.8, 2)
    middle = (1 - v) * ((1 - u) * quad[0] + u * quad[1]) + v * ((1 - u) * quad[3] + u * quad[2])
    aspect = math.exp(rng.uniform(-0.5, 0.5))
    shape = np.array([math.sqrt(aspect), 1 / math.sqrt(aspect)])
    wanted, least, most = share * cv2.contourArea(quad), 0.0, 4.0 * max(np.ptp(quad, axis=0))
    for _ in range(30):
        side = (least + most) / 2
        (x0, y0), (x1, y1) = middle - side * shape / 2, middle + side * shape / 2
        patch = np.float32([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
        hidden = cv2.intersectConvexConvex(quad, patch)[0]
        least, most = (side, most) if hidden < wanted else (least, side)
    height, width = canvas.shape[:2]
    x0, x1 = (int(np.clip(round(float(x)), 0, width)) for x in (x0, x1))
    y0, y1 = (int(np.clip(round(float(y)), 0, height)) for y in (y0, y1))
    if x1 > x0 and y1 > y0:
        canvas[y0:y1, x0:x1] = cover(rng, pixels, x1 - x0, y1 - y0)


def render(rng, picture, background, patch, factors):
    """-> (frame as BGR bytes, exact homography from picture to frame)."""
    f = draw(rng, factors)
    homography = pose(rng, picture.size, f)
    quad = outline(homography, picture.size)
    onto, size = to_canvas(homography), (WIDTH * SUPER, HEIGHT * SUPER)

    # Blurred before it is made smaller, so that the warp skips nothing.
    w, h = picture.size
    shrink = math.sqrt(w * h / cv2.contourArea(np.float32(quad * SUPER)))
    source = picture.pixels
    if shrink > 1.05:
        source = cv2.GaussianBlur(source, (0, 0), 0.5 * math.sqrt(shrink**2 - 1))
    seen = cv2.warpPerspective(source, onto, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    mask = cv2.warpPerspective(np.full((h, w), 255, np.uint8), onto, size, flags=cv2.INTER_LINEAR)
    canvas = np.ascontiguousarray(cover(rng, background.pixels, *size))
    cv2.copyTo(seen, cv2.compare(mask, 127, cv2.CMP_GT), canvas)
    if f["occlusion"] > 0:
        hide(rng, canvas, quad, f["occlusion"], patch.pixels)

    frame = cv2.resize(canvas, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(np.float32)
    frame = cv2.GaussianBlur(frame, (0, 0), f["blur"])
    frame *= f["light"] * rng.uniform(1 - f["cast"], 1 + f["cast"], 3).astype(np.float32)
    frame += f["noise"] * rng.standard_normal(frame.shape, dtype=np.float32)
    return np.clip(np.rint(frame), 0, 255).astype(np.uint8), homography


class Studio:
    """Renders frames into a folder; the frame depends on the seed and the key alone."""

    def __init__(self, folder, backgrounds, seed):
        self.folder, self.backgrounds, self.seed = folder, backgrounds, seed

    def shoot(self, picture, factors, *key):
        """A frame of `picture`; `key` tells it from the others of this run."""
        name = "-".join(map(str, (self.seed, picture.name, *key)))
        digest = hashlib.sha256(name.encode()).hexdigest()
        rng = np.random.default_rng(int(digest[:16], 16))
        others = [b for b in self.backgrounds if b.digest != picture.digest]
        background, patch = (others[i] for i in rng.choice(len(others), 2, replace=False))
        pixels, homography = render(rng, picture, background, patch, factors)
        path = os.path.join(self.folder, digest[:16] + ".jpg")
        cv2.imwrite(path, pixels, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        shown = {picture.digest, background.digest, patch.digest}
        return Frame(path, {picture.digest: outline(homography, picture.size)}, shown)

    def clear(self, frames):
        """Deletes frames from the disk."""
        for frame in frames:
            os.remove(frame.path)


# ------------------------------------------------------------------ detectors


@dataclass
class Detection:
    """One outline."""

    score: float
    corners: np.ndarray      # 4x2, px


@dataclass
class Search:
    """What one detector said of one frame: detections, best first, and its time."""

    detections: list
    ms: float


class Refused(Exception):
    """A detector cannot be trained on a picture."""


class Keygraph:
    """The command, with models kept in a folder."""

    def __init__(self, label, command, folder, train=(), threads=1, threshold=THRESHOLD):
        if not os.path.exists(command):
            sys.exit(f"{command} is not there: `cargo build --release` makes it; --keygraph says where else it is")
        self.label, self.command, self.folder, self.train = label, command, folder, list(train)
        self.threads, self.threshold = threads, threshold
        self.models = {}     # digest of the picture -> (path of the model, its bytes), or why it was refused

    def model(self, picture):
        """-> (path, bytes) of the model of `picture`."""
        if picture.digest not in self.models:
            path = os.path.join(self.folder, f"{self.label}-{picture.digest[:16]}.kgm".replace(" ", "-"))
            run = [self.command, "train", picture.path, "-o", path, "--json", *self.train]
            done = subprocess.run(run, capture_output=True, text=True, check=False)
            if done.returncode == 2:
                sys.exit(done.stderr)
            self.models[picture.digest] = (
                Refused(done.stderr.strip()) if done.returncode else (path, json.loads(done.stdout)["bytes"])
            )
        model = self.models[picture.digest]
        if isinstance(model, Refused):
            raise model
        return model

    def size(self, picture):
        """Bytes of the model."""
        return self.model(picture)[1]

    def search(self, picture, frames):
        """-> a `Search` for each of `frames`."""
        run = [self.command, "detect", "-m", self.model(picture)[0], "--json"]
        run += ["--threshold", str(self.threshold), "--threads", str(self.threads)]
        done = subprocess.run(run + [f.path for f in frames], stdout=subprocess.PIPE, text=True, check=False)
        lines = [json.loads(line) for line in done.stdout.splitlines()]
        if done.returncode or len(lines) != len(frames):
            sys.exit(f"`keygraph detect` ended with {done.returncode}: {len(lines)} lines for {len(frames)} frames")
        searches = []
        for line in lines:
            detections = [Detection(d["score"], np.float64(d["corners"])) for d in line["detections"]]
            searches.append(Search(sorted(detections, key=lambda d: -d.score), line["time_ms"]["total"]))
        return searches


class Rival:
    """OpenCV's features, with the ratio test and a RANSAC homography, accepted when
    it keeps ten matches and its outline is convex and larger than 20x20 px."""

    def __init__(self, label):
        self.label = label
        self.features = cv2.SIFT_create() if label == "SIFT" else cv2.ORB_create(1000)
        self.matcher = cv2.BFMatcher(cv2.NORM_L2 if label == "SIFT" else cv2.NORM_HAMMING)
        self.models = {}     # digest of the picture -> (points in its pixels, descriptors)

    def model(self, picture):
        """-> (points, descriptors), from the picture at 640x480 or less, as keygraph trains."""
        if picture.digest not in self.models:
            w, h = picture.size
            k = min(1.0, WIDTH / max(w, h), math.sqrt(WIDTH * HEIGHT / (w * h)))
            gray = cv2.cvtColor(picture.pixels, cv2.COLOR_BGR2GRAY)
            if k < 1:
                gray = cv2.resize(gray, None, fx=k, fy=k, interpolation=cv2.INTER_AREA)
            points, descriptors = self.features.detectAndCompute(gray, None)
            if descriptors is None or len(points) < 4:
                raise Refused(f"{picture.path}: {len(points)} features")
            self.models[picture.digest] = (np.float64([(np.add(p.pt, 0.5)) / k - 0.5 for p in points]), descriptors)
        return self.models[picture.digest]

    def size(self, picture):
        """Bytes of descriptors (SIFT's rounded to bytes) and of positions of two bytes a coordinate."""
        descriptors = self.model(picture)[1]
        return descriptors.size + 4 * len(descriptors)

    def search(self, picture, frames):
        """-> a `Search` for each of `frames`, of 640x480 px or less."""
        model = self.model(picture)
        searches = []
        for frame in frames:
            pixels = cv2.imread(frame.path, cv2.IMREAD_COLOR)
            start = time.perf_counter()
            corners = self.outline(pixels, model, picture.size)
            ms = 1e3 * (time.perf_counter() - start)
            searches.append(Search([] if corners is None else [Detection(1.0, corners)], ms))
        return searches

    def outline(self, pixels, model, size):
        """The corners of the object in the frame, or None."""
        gray = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
        points, descriptors = self.features.detectAndCompute(gray, None)
        if descriptors is None:
            return None
        pairs = [p for p in self.matcher.knnMatch(model[1], descriptors, k=2) if len(p) == 2]
        good = [best for best, second in pairs if best.distance < 0.75 * second.distance]
        if len(good) < 6:
            return None
        there = np.float64([points[m.trainIdx].pt for m in good])
        homography, kept = cv2.findHomography(model[0][[m.queryIdx for m in good]], there, cv2.RANSAC, 4.0)
        if homography is None or kept.sum() < 10:
            return None
        corners = outline(homography, size)
        whole = np.float32(corners)
        return corners if cv2.isContourConvex(whole) and cv2.contourArea(whole) > 400 else None


# ------------------------------------------------------------------ scorer


def corner_error(corners, truth):
    """The mean distance of four corners from the true ones, px."""
    return float(np.linalg.norm(corners - truth, axis=1).mean())


def relative_error(corners, truth):
    """The same, as a share of the object's size."""
    return corner_error(corners, truth) / math.sqrt(abs(cv2.contourArea(np.float32(truth))))


def judge(search, truth):
    """For each detection whether it is right: the best one at the true place is, a
    second one there is not. `truth` is None where the object is not."""
    verdicts, seen = [], False
    for d in search.detections:
        right = truth is not None and not seen and relative_error(d.corners, truth) < FOUND
        seen |= right
        verdicts.append(right)
    return verdicts


def keep(folder, name, frame):
    """Copies a frame that is worth a look, if a folder for such is given."""
    if folder:
        os.makedirs(folder, exist_ok=True)
        shutil.copy(frame.path, os.path.join(folder, f"{name}-{os.path.basename(frame.path)}"))


def try_search(detector, picture, frames):
    """Like `search`; a detector that refuses the picture finds nothing, in no time."""
    try:
        return detector.search(picture, frames)
    except Refused:
        return [Search([], math.nan) for _ in frames]


class Progress:
    """How far a run is and how long it will take, on standard error."""

    def __init__(self, total, unit):
        self.total, self.unit, self.done = total, unit, 0
        self.start = self.told = time.monotonic()

    def add(self, n):
        self.done += n
        now = time.monotonic()
        live = sys.stderr.isatty()
        if now - self.told < (0.5 if live else 20) and self.done < self.total:
            return
        self.told = now
        left = (now - self.start) * max(0, self.total - self.done) / self.done
        line = f"{self.done:,} of {self.total:,} {self.unit}, {left // 60:.0f} min {left % 60:.0f} s left"
        end = "" if live and self.done < self.total else "\n"
        print(("\r\x1b[K" if live else "") + line, end=end, file=sys.stderr, flush=True)


# ------------------------------------------------------------------ figures

# Okabe and Ito's colours, which the colour-blind can tell apart; line, marker and width as well.
STYLES = {
    "Keygraph large": dict(color="#0072B2", marker="o", linestyle="-", linewidth=2.4, zorder=5),
    "Keygraph standard": dict(color="#56B4E9", marker="s", linestyle="-", linewidth=1.6, zorder=4),
    "Keygraph luma": dict(color="#009E73", marker="^", linestyle="--", linewidth=1.6, zorder=3),
    "SIFT": dict(color="#D55E00", marker="D", linestyle="-", linewidth=1.6, zorder=2),
    "ORB": dict(color="#7A7A7A", marker="v", linestyle="-", linewidth=1.6, zorder=1),
}
INK, PALE = "#222222", "#DDDDDD"


def pyplot():
    """matplotlib, drawing into files, in our style. Only the figures need it."""
    try:
        import matplotlib
    except ImportError:
        sys.exit("matplotlib is missing: pip install matplotlib")
    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    plt.rcParams.update({
        "font.family": "DejaVu Sans", "font.size": 11, "text.color": INK, "axes.labelcolor": INK,
        "axes.edgecolor": "#888888", "axes.linewidth": 0.8, "axes.spines.top": False, "axes.spines.right": False,
        "axes.titlesize": 12, "axes.titleweight": "bold", "axes.titlelocation": "left", "axes.titlepad": 8,
        "axes.grid": True, "axes.axisbelow": True, "grid.color": PALE, "grid.linewidth": 0.7,
        "xtick.color": INK, "ytick.color": INK, "xtick.major.size": 3, "ytick.major.size": 0,
        "xtick.minor.size": 0, "lines.markersize": 4.5, "lines.markeredgewidth": 0, "savefig.dpi": 150,
        "figure.facecolor": "white",
    })
    return plt


def per_cent_axis(axis):
    axis.set_ylim(-3, 103)
    axis.set_yticks([0, 25, 50, 75, 100], ["0", "25", "50", "75", "100 %"])


def numbers_of(path):
    """The numbers that an earlier run left beside the figure at `path`."""
    numbers = os.path.splitext(path)[0] + ".json"
    try:
        with open(numbers, encoding="utf-8") as text:
            return json.load(text)
    except FileNotFoundError:
        sys.exit(f"{numbers} is not there: run once without --redraw")


def check_figure(path):
    """Ends the program before the work when the figure could not be drawn after it."""
    pyplot()
    folder = os.path.dirname(os.path.abspath(path))
    if not os.path.isdir(folder):
        sys.exit(f"cannot write {path}: the folder {folder} does not exist")


def save(figure, numbers, path):
    """Writes the figure to `path` and the numbers beside it as JSON."""
    figure.savefig(path)
    with open(os.path.splitext(path)[0] + ".json", "w", encoding="utf-8") as out:
        json.dump(numbers, out, indent=1)
        out.write("\n")
    print(f"wrote {path} and {os.path.basename(os.path.splitext(path)[0])}.json", file=sys.stderr)


def draw_curves(numbers):
    """Small multiples, a sweep each, and the times."""
    plt = pyplot()
    from matplotlib.transforms import ScaledTranslation

    figure, axes = plt.subplots(3, 3, figsize=(12, 8.6), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.12, h_pad=0.10, rect=(0, 0.055, 1, 0.845))
    labels = list(numbers["time_ms"])
    for i, (axis, sweep) in enumerate(zip(axes.flat, SWEEPS)):
        for k, label in enumerate(labels):
            beside = ScaledTranslation(0, ((len(labels) - 1) / 2 - k) * 1.3 / 72, figure.dpi_scale_trans)
            axis.plot(sweep.values, 100 * np.array(numbers["found"][sweep.factor][label]), label=label,
                      transform=axis.transData + beside, clip_on=False, **STYLES[label])
        low, high = sweep.values[0], sweep.values[-1]
        if sweep.log:
            axis.set_xscale("log")
            axis.set_xlim(low * (low / high) ** 0.04, high * (high / low) ** 0.04)
        else:
            axis.set_xlim(low - 0.04 * (high - low), high + 0.04 * (high - low))
        axis.set_xticks(sweep.ticks, [f"{100 * t:.0f}" if sweep.percent else f"{t:g}" for t in sweep.ticks])
        axis.minorticks_off()
        axis.set_title(sweep.title)
        per_cent_axis(axis)
        if i % 3:
            axis.set_yticklabels([])
    draw_times(axes.flat[-1], numbers["time_ms"])
    handles, names = axes.flat[0].get_legend_handles_labels()
    figure.suptitle("Objects found, % of frames", x=0.012, y=0.985, ha="left", fontsize=15, fontweight="bold")
    figure.legend(handles, names, loc="upper left", bbox_to_anchor=(0.003, 0.955), ncols=len(names), frameon=False,
                  fontsize=12.5, handlelength=2.4, columnspacing=1.8)
    n = numbers["objects"] * numbers["frames"]
    figure.text(0.012, 0.012, f"{numbers['objects']} objects, {n} rendered frames of {WIDTH}x{HEIGHT} px a point, "
                f"good to ±{98 / math.sqrt(n):.0f} % at worst. What a panel does not name is plain:\nscale 0.5 to 1, "
                "any rotation, tilt to 20 degrees. Blur and noise: standard deviation. "
                "Lines that coincide are drawn side by side.",
                fontsize=10.5, color="#555555", linespacing=1.4)
    return figure


def draw_times(axis, times):
    """A bar for each detector, its name above and its time at the end."""
    most = max(times.values())
    for i, (label, ms) in enumerate(times.items()):
        axis.barh(i, ms, color=STYLES[label]["color"], height=0.34)
        axis.text(0, i - 0.26, label, va="bottom")
        axis.text(ms + 0.02 * most, i, f"{ms:.0f}", va="center", fontweight="bold")
    axis.set_title("Time a frame, ms (median)")
    axis.set_xlim(0, 1.15 * most)
    axis.set_ylim(len(times) - 0.6, -0.75)
    axis.xaxis.set_visible(False)
    axis.yaxis.set_visible(False)
    axis.spines[["bottom", "left"]].set_visible(False)


def draw_economy(numbers):
    """Found against bytes: keygraph's lines, and the rivals' points."""
    plt = pyplot()
    figure, axis = plt.subplots(figsize=(8, 4.8), layout="constrained")
    figure.get_layout_engine().set(rect=(0, 0.05, 1, 0.95))
    per_cent_axis(axis)
    for preset, most in PRESETS[:-1]:
        axis.axvline(most / 1024, color="#888888", linewidth=1, linestyle=":")
        axis.text(most / 1024, 2, f" {preset}", color="#555555", fontsize=10)
    for label, points in numbers["found"].items():
        x, y = np.array(points["bytes"]) / 1024, 100 * np.array(points["all"])
        style = STYLES["Keygraph large" if label == "Keygraph" else label]
        axis.plot(x, y, **{**style, "markersize": 9 if len(x) == 1 else 5})
        # Both lines end at nearly the same place.
        below = len(x) > 1 and label != "Keygraph"
        axis.annotate(label, (x[-1], y[-1]), xytext=(10, -15 if below else 0), textcoords="offset points", va="center",
                      color=style["color"], fontweight="bold")
    axis.set_xscale("log")
    ticks = [32, 64, 128, 256, 512, 1024, 2048, 4096]
    axis.set_xticks(ticks, [f"{t} KB" if t < 1024 else f"{t // 1024} MB" for t in ticks])
    axis.minorticks_off()
    axis.set_xlim(24, 14_000)
    axis.set_title("Objects found, % of frames, against the model's size")
    n = numbers["objects"] * numbers["frames"]
    figure.text(0.015, 0.018, f"{numbers['objects']} objects, {n} rendered frames of each of: {'; '.join(CONDITIONS)}.",
                fontsize=10, color="#555555")
    return figure


# ------------------------------------------------------------------ subcommands


def keygraphs(args, folder):
    """The variants that the curves show."""
    variants = [("Keygraph large", []), ("Keygraph standard", ["--preset", "standard"]), ("Keygraph luma", ["--luma"])]
    return [Keygraph(label, args.keygraph, folder, train) for label, train in variants]


def curves(args, folder):
    """One factor after the other, for every detector."""
    if args.redraw:
        numbers = numbers_of(args.out)
        return save(draw_curves(numbers), numbers, args.out)
    check_figure(args.out)
    objects = read_pictures(args.objects, 1, "objects")
    studio = Studio(folder, read_pictures(args.backgrounds, 3, "backgrounds"), args.seed)
    detectors = keygraphs(args, folder) + [Rival("SIFT"), Rival("ORB")]
    found = {s.factor: {d.label: np.zeros(len(s.values)) for d in detectors} for s in SWEEPS}
    times = {d.label: [] for d in detectors}
    progress = Progress(sum(len(s.values) for s in SWEEPS) * len(objects) * args.frames, "frames")
    for sweep in SWEEPS:
        for picture in objects:
            keys = [(i, n) for i in range(len(sweep.values)) for n in range(args.frames)]
            shot = [studio.shoot(picture, {sweep.factor: sweep.values[i]}, sweep.factor, i, n) for i, n in keys]
            for detector in detectors:
                for (i, _), frame, search in zip(keys, shot, try_search(detector, picture, shot)):
                    truth = frame.quads[picture.digest]
                    found[sweep.factor][detector.label][i] += any(judge(search, truth)[:1])
                    times[detector.label].append(search.ms)
            studio.clear(shot)
            progress.add(len(shot))
    shown = len(objects) * args.frames
    numbers = {
        "objects": len(objects), "frames": args.frames, "seed": args.seed,
        "values": {s.factor: s.values for s in SWEEPS},
        "found": {f: {label: (n / shown).tolist() for label, n in lines.items()} for f, lines in found.items()},
        "time_ms": {label: round(float(np.nanmedian(ms)), 1) for label, ms in times.items()},
    }
    return save(draw_curves(numbers), numbers, args.out)


# Most bytes of the presets, so that each size is trained with the preset made for it.
PRESETS = [("compact", 512 << 10), ("standard", 1_500_000), ("large", 2_000_000)]
SIZES = [32 << 10, 64 << 10, 128 << 10, 256 << 10, 512 << 10, 1 << 20, 2_000_000, 6_000_000]


def economy(args, folder):
    """Models capped at one size after the other, over a mix of conditions."""
    if args.redraw:
        numbers = numbers_of(args.out)
        return save(draw_economy(numbers), numbers, args.out)
    check_figure(args.out)
    objects = read_pictures(args.objects, 1, "objects")
    studio = Studio(folder, read_pictures(args.backgrounds, 3, "backgrounds"), args.seed)
    lines = {"Keygraph": [], "Keygraph luma": [], "SIFT": [Rival("SIFT")], "ORB": [Rival("ORB")]}
    for cap in SIZES:
        preset = next((name for name, most in PRESETS if cap <= most), "large")
        train = ["--preset", preset, "--bytes", str(cap)]
        lines["Keygraph"].append(Keygraph(f"both {cap}", args.keygraph, folder, train, threads=2))
        lines["Keygraph luma"].append(Keygraph(f"luma {cap}", args.keygraph, folder, [*train, "--luma"], threads=2))
    found = {label: np.zeros((len(detectors), len(CONDITIONS))) for label, detectors in lines.items()}
    progress = Progress(len(objects) * len(CONDITIONS) * args.frames, "frames")
    for picture in objects:
        for c, (condition, factors) in enumerate(CONDITIONS.items()):
            shot = [studio.shoot(picture, factors, condition, n) for n in range(args.frames)]
            for label, detectors in lines.items():
                for i, detector in enumerate(detectors):
                    for frame, search in zip(shot, try_search(detector, picture, shot)):
                        found[label][i, c] += any(judge(search, frame.quads[picture.digest])[:1])
            studio.clear(shot)
            progress.add(len(shot))
    shown = len(objects) * args.frames
    numbers = {"objects": len(objects), "frames": args.frames, "seed": args.seed, "found": {}}
    for label, detectors in lines.items():
        sizes = [median_size(d, objects) for d in detectors]
        # Caps that nothing can be trained under, or that cap nothing any more, say nothing.
        kept = [i for i, s in enumerate(sizes) if s is not None and s not in sizes[:i]]
        points = {"bytes": [sizes[i] for i in kept], "all": (found[label][kept].mean(axis=1) / shown).tolist()}
        for c, condition in enumerate(CONDITIONS):
            points[condition] = (found[label][kept, c] / shown).tolist()
        numbers["found"][label] = points
    return save(draw_economy(numbers), numbers, args.out)


def median_size(detector, objects):
    """The median model's bytes; None when every object is refused."""
    sizes = []
    for picture in objects:
        try:
            sizes.append(detector.size(picture))
        except Refused as e:
            print(f"{picture.name}: {e}", file=sys.stderr)
    return float(np.median(sizes)) if sizes else None


def precision(args, folder):
    """Corner errors in px where nothing makes it hard."""
    objects = read_pictures(args.objects, 1, "objects")
    studio = Studio(folder, read_pictures(args.backgrounds, 3, "backgrounds"), args.seed)
    detectors = keygraphs(args, folder) + [Rival("SIFT"), Rival("ORB")]
    errors, shifts = {d.label: [] for d in detectors}, {d.label: [] for d in detectors}
    progress = Progress(len(objects) * args.frames, "frames")
    for picture in objects:
        shot = [studio.shoot(picture, {"scale": args.scale}, "precision", n) for n in range(args.frames)]
        for detector in detectors:
            for frame, search in zip(shot, try_search(detector, picture, shot)):
                truth = frame.quads[picture.digest]
                if any(judge(search, truth)[:1]):
                    corners = search.detections[0].corners
                    errors[detector.label].append(corner_error(corners, truth))
                    shifts[detector.label].append((corners - truth).mean(axis=0))
        studio.clear(shot)
        progress.add(len(shot))
    print(f"| scale {args.scale:g} | found of {len(objects) * args.frames} | median, px | 90th percentile, px | "
          "mean shift x, y, px |\n| --- | --- | --- | --- | --- |")
    for label, e in errors.items():
        if not e:
            print(f"| {label} | 0 | | | |")
            continue
        x, y = np.mean(shifts[label], axis=0)
        print(f"| {label} | {len(e)} | {np.median(e):.3f} | {np.percentile(e, 90):.3f} | {x:+.3f}, {y:+.3f} |")


def hard_factors(rng):
    """Two of the conditions at once, one of them perhaps plain."""
    a, b = rng.choice(len(CONDITIONS), 2, replace=False)
    values = list(CONDITIONS.values())
    return {**values[a], **values[b]}


def gather(truth_files, pictures):
    """The objects of truth files and of pictures, each once; and the files' frames."""
    objects, frames = {p.digest: p for p in pictures}, {}
    for path in truth_files:
        named, shot = read_truth(path)
        for p in named:
            objects.setdefault(p.digest, p)
        for f in shot:
            known = frames.setdefault(f.path, f)
            known.quads.update(f.quads)
            known.may_show |= f.may_show
    return list(objects.values()), list(frames.values())


def calibration(args, folder):
    """What the score is worth: the share of right detections in each bin of it."""
    objects, frames = gather(args.truth, read_pictures(args.objects, 2, "objects"))
    studio = Studio(folder, read_pictures(args.backgrounds, 3, "backgrounds"), args.seed)
    detector = Keygraph("calibration", args.keygraph, folder, args.train, threads=2, threshold=0.0)
    scored, wrong = [], []   # (score, right) of all; (score, where) of the wrong ones that would be told
    given = sum(quad is not None for f in frames for quad in f.quads.values())
    progress = Progress(given + 2 * args.frames * len(objects), "searches")

    def ask(picture, shot):
        for frame, search in zip(shot, try_search(detector, picture, shot)):
            truth = frame.quads.get(picture.digest)
            for d, right in zip(search.detections, judge(search, truth)):
                scored.append((d.score, right))
                if d.score >= THRESHOLD and not right:
                    why = "not there" if truth is None else f"off by {100 * relative_error(d.corners, truth):.0f} %"
                    wrong.append((d.score, f"{picture.name} in {os.path.basename(frame.path)}, {why}"))
                    keep(args.keep, picture.name, frame)
        progress.add(len(shot))

    for i, picture in enumerate(objects):
        real = [f for f in frames if f.quads.get(picture.digest) is not None]
        if real:
            ask(picture, real)
        rng = np.random.default_rng([args.seed, i])
        shot = [studio.shoot(picture, hard_factors(rng), "calibration", n) for n in range(args.frames)]
        ask(picture, shot)
        # The frames of one object are searched for the next that is not in them.
        for k in range(1, len(objects)):
            stranger = objects[(i + k) % len(objects)]
            absent = [f for f in shot if stranger.digest not in f.may_show]
            if absent:
                ask(stranger, absent)
                break
        studio.clear(shot)
    print_reliability(scored, args.bins)
    for score, where in sorted(wrong, reverse=True):
        print(f"wrong: {score:.3f}, {where}")


def print_reliability(scored, bins):
    """Prints the table of (score, right) pairs."""
    if not scored:
        sys.exit("nothing was detected at all: nothing to calibrate on")
    score, right = np.array([s for s, _ in scored]), np.array([r for _, r in scored])
    at = np.minimum((score * bins).astype(int), bins - 1)
    print("| score | detections | mean score | share right |")
    print("| --- | --- | --- | --- |")
    gaps = np.zeros(bins)
    for b in range(bins):
        inside = at == b
        if inside.any():
            mean, share = score[inside].mean(), right[inside].mean()
            gaps[b] = abs(mean - share)
            print(f"| {b / bins:.2f} to {(b + 1) / bins:.2f} | {inside.sum():,} | {mean:.3f} | {share:.3f} |")
    told = score >= THRESHOLD
    wrong = (~right[told]).sum()
    above = gaps[at[at > 0]].mean() if (at > 0).any() else 0.0
    print(f"\nMean gap between score and share right: {gaps[at].mean():.3f}, above the lowest bin {above:.3f}. "
          f"At {THRESHOLD:g} and above: {told.sum():,} detections, {wrong:,} wrong "
          f"({100 * wrong / max(1, told.sum()):.2f} %).")


BATCH = 100                  # rendered frames on disk at once


def false_alarms(args, folder):
    """Every object looked for in frames that do not show it."""
    truth = [p for p in args.frames if p.endswith(".json")]
    objects, frames = gather(truth, read_pictures(args.objects, 2, "objects"))
    plain = picture_paths(p for p in args.frames if not p.endswith(".json"))
    frames += [Frame(os.path.realpath(p), {}, set()) for p in plain]
    studio = Studio(folder, read_pictures(args.backgrounds, 3, "backgrounds"), args.seed)
    detector = Keygraph("alarms", args.keygraph, folder, args.train, threads=2, threshold=args.threshold)
    scores, alarms, asked = [], [], {"given": 0, "rendered": 0}
    total = max(args.pairs, sum(o.digest not in f.may_show for o in objects for f in frames))
    progress = Progress(total, "pairs")

    def ask(kind, batch):
        for picture in objects:
            absent = [f for f in batch if picture.digest not in f.may_show]
            if kind == "rendered":
                absent = absent[: args.pairs - sum(asked.values())]
            if not absent:
                continue
            for frame, search in zip(absent, try_search(detector, picture, absent)):
                scores.extend(d.score for d in search.detections)
                worst = max((d.score for d in search.detections), default=0.0)
                if worst >= THRESHOLD:
                    alarms.append((worst, picture.name, kind, os.path.basename(frame.path)))
                    keep(args.keep, picture.name, frame)
            asked[kind] += len(absent)
            progress.add(len(absent))

    for i in range(0, len(frames), BATCH):
        ask("given", frames[i : i + BATCH])
    rng, n = np.random.default_rng(args.seed), 0
    while sum(asked.values()) < args.pairs:
        batch = [studio.shoot(objects[(n + k) % len(objects)], hard_factors(rng), "alarm", n + k) for k in range(BATCH)]
        before = sum(asked.values())
        ask("rendered", batch)
        studio.clear(batch)
        n += BATCH
        if sum(asked.values()) == before:
            sys.exit("every frame may show every object: give more --objects")
    print_alarms(scores, alarms, asked, args.threshold)


def print_alarms(scores, alarms, asked, threshold):
    """Prints the counts, the histogram of scores, and every false alarm."""
    pairs = sum(asked.values())
    false = sum(s >= THRESHOLD for s in scores)
    # Upper 95 % limit of a Poisson count (Byar's approximation; exactly 3.0 at none).
    k = false + 1
    limit = 3.0 if false == 0 else k * (1 - 1 / (9 * k) + 1.645 / (3 * math.sqrt(k))) ** 3
    print(f"{pairs:,} pairs of frame and object not in it ({asked['given']:,} on frames given, "
          f"{asked['rendered']:,} on rendered ones): {false} detections at {THRESHOLD:g} and above; "
          f"with 95 % certainty fewer than one in {pairs / limit:,.0f} pairs.\n")
    print("| score | detections | per 10,000 pairs |\n| --- | --- | --- |")
    for b in range(20):
        low, high = b / 20, (b + 1) / 20
        if high <= threshold:
            continue
        n = sum(max(low, threshold) <= s < high or (b == 19 and s == 1) for s in scores)
        print(f"| {max(low, threshold):.2f} to {high:.2f} | {n} | {1e4 * n / pairs:.1f} |")
    for score, name, kind, frame in sorted(alarms, reverse=True):
        print(f"false alarm: {name} with {score:.3f} in {frame} ({kind})")


# ------------------------------------------------------------------ command line


def parser():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = p.add_subparsers(dest="command", required=True)

    def command(run, help_text, frames):
        c = commands.add_parser(run.__name__.replace("_", "-"), help=help_text, description=help_text)
        c.set_defaults(run=run)
        c.add_argument("--keygraph", default=os.path.join(ROOT, "target", "release", "keygraph"), metavar="FILE",
                       help="the command [default: target/release/keygraph]")
        c.add_argument("--objects", nargs="+", default=OBJECTS, metavar="PICTURE",
                       help="pictures of objects, or folders of them [default: five of assets/pictures]")
        c.add_argument("--backgrounds", nargs="+", default=[PICTURES], metavar="PICTURE",
                       help="pictures for backgrounds and patches, or folders of them [default: assets/pictures]")
        c.add_argument("--seed", type=int, default=1)
        if frames:
            c.add_argument("--frames", type=positive, default=frames[0], metavar="N",
                           help=f"rendered frames {frames[1]} [default: {frames[0]}]")
        return c

    def figure(c, name):
        c.add_argument("--out", default=os.path.join(ROOT, "docs", name), metavar="FILE.png",
                       help=f"figure; the numbers go beside it as .json [default: docs/{name}]")
        c.add_argument("--redraw", action="store_true", help="only draw anew, from the numbers of an earlier run")

    def trained(c):
        c.add_argument("--keep", metavar="DIR", help="copy the frames with wrong detections here")
        c.add_argument("--train", type=str.split, default=[], metavar="OPTIONS",
                       help="options of `keygraph train`, as one word: --train='--preset standard'")

    c = command(curves, "Found, against scale, rotation, tilt, occlusion, light", (8, "a point and object"))
    figure(c, "curves.png")
    c = command(economy, "Found, against the model's size", (12, "a condition and object"))
    figure(c, "economy.png")
    c = command(precision, "Corner error in px", (40, "an object"))
    c.add_argument("--scale", type=float, default=1.0)
    c = command(calibration, "Score, against the share of right detections", (100, "an object"))
    c.add_argument("truth", nargs="*", metavar="TRUTH.json", help="truth files, whose frames are searched as well")
    c.add_argument("--bins", type=positive, default=10)
    trained(c)
    c = command(false_alarms, "Detections in frames that do not show the object", None)
    c.add_argument("frames", nargs="*", metavar="FRAMES",
                   help="truth files; frames or folders of frames that show none of the objects")
    c.add_argument("--pairs", type=positive, default=30_000, metavar="N",
                   help="frames are rendered until there are so many pairs of frame and object [default: 30000]")
    c.add_argument("--threshold", type=float, default=0.05, metavar="S",
                   help="least score that is counted [default: 0.05]")
    trained(c)
    return p


def positive(text):
    n = int(text)
    if n < 1:
        raise argparse.ArgumentTypeError("give 1 or more")
    return n


def main():
    args = parser().parse_args()
    cv2.setNumThreads(1)
    cv2.setRNGSeed(1)
    with tempfile.TemporaryDirectory(prefix="keygraph-") as folder:
        args.run(args, folder)


if __name__ == "__main__":
    main()
