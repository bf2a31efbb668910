"""Frames rendered from pictures, with poses that are known.

The renderer is that of host/src/render.rs, which host/examples/render.rs offers to other
programs; this file chooses what to render. A frame is 640x480 px. It shows one object over
a part of another picture; a part of it may be hidden behind a third one.
"""

import functools
import hashlib
import json
import os
import random
import shutil
import subprocess
import sys
from dataclasses import dataclass

from places import RELEASE, ROOT
from scoring import outline
from truth import Frame

WIDTH, HEIGHT = 640, 480
UNIT = 420.0  # longer side of the object at scale 1, px
QUALITY = 90  # of the frames' JPEG

# Every factor of a frame, and the range it is drawn from where nothing else is asked for.
PLAIN = {
    "scale": (0.5, 1.0),
    "rotation": (0.0, 360.0),  # degrees
    "tilt": (0.0, 20.0),  # degrees between the object's normal and the line of sight
    "occlusion": (0.0, 0.0),  # hidden share of the object
    "blur": (0.4, 0.8),  # standard deviation, px
    "light": (0.8, 1.2),  # gain
    "noise": (3.0, 3.0),  # standard deviation, gray levels
    "cast": (0.0, 0.0),  # each channel is multiplied by 1 - cast to 1 + cast
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
    percent: bool = False  # ticks are shares, shown in per cent
    log: bool = False


SWEEPS = [
    Sweep("scale", "Scale", (0.2, 0.25, 0.3, 0.4, 0.5, 0.7, 1.0, 1.4, 2.0), (0.2, 0.3, 0.5, 1, 2), log=True),
    Sweep("rotation", "Rotation, degrees", tuple(range(0, 361, 20)), (0, 90, 180, 270, 360)),
    Sweep("tilt", "Tilt, degrees", (0, 10, 20, 30, 40, 50, 60, 70), (0, 20, 40, 60)),
    Sweep("occlusion", "Hidden, %", (0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6), (0, 0.2, 0.4, 0.6), percent=True),
    Sweep("blur", "Blur, px", (0.5, 1, 2, 3, 4, 5, 6), (0, 2, 4, 6)),
    Sweep(
        "light",
        "Light, % of plain",
        (0.05, 0.07, 0.1, 0.14, 0.2, 0.3, 0.5, 1),
        (0.05, 0.1, 0.2, 0.5, 1),
        percent=True,
        log=True,
    ),
    Sweep("noise", "Noise, gray levels", (0, 5, 10, 15, 20, 30, 40), (0, 10, 20, 30, 40)),
    Sweep("cast", "Colour cast, ± %", (0, 0.1, 0.2, 0.3, 0.4, 0.5), (0, 0.2, 0.4), percent=True),
]


def draw(rng, factors):
    """One value for every factor: a range is drawn from, a number stays."""
    chosen = {**PLAIN, **factors}
    return {k: rng.uniform(*v) if isinstance(v, tuple) else float(v) for k, v in chosen.items()}


def hard_factors(rng):
    """Two of the conditions at once, one of them perhaps plain."""
    a, b = rng.sample(list(CONDITIONS.values()), 2)
    return {**a, **b}


def keep(folder, name, frame):
    """Copies a frame that is worth a look into `folder`, if one is given."""
    if folder:
        os.makedirs(folder, exist_ok=True)
        shutil.copy(frame.path, os.path.join(folder, f"{name}-{os.path.basename(frame.path)}"))


def build_renderer():
    """Builds the renderer where it is not there yet; gives its path."""
    return build_example("render")


@functools.cache
def build_example(name):
    """Builds a program of host/examples where it is not there yet; gives its path."""
    build = ["cargo", "build", "--release", "--quiet", "--example", name, "-p", "keygraph"]
    try:
        done = subprocess.run(build, cwd=ROOT, check=False).returncode == 0
    except FileNotFoundError:
        sys.exit("Rust is missing: install it as https://rustup.rs says")
    if not done:
        sys.exit(f"the example {name} cannot be built: {' '.join(build)}")
    return os.path.join(RELEASE, "examples", name)


class Renderer:
    """The renderer as a process. It takes a request and answers it before the next one."""

    def __init__(self, command):
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def render(self, request):
        """Writes one frame; gives the homography of each of its pictures, nine numbers.

        host/examples/render.rs lists the fields of a request. Ends the program when the
        frame cannot be rendered: the renderer has said why on standard error.
        """
        try:
            self.process.stdin.write(json.dumps(request) + "\n")
            self.process.stdin.flush()
            answer = self.process.stdout.readline()
        except BrokenPipeError:
            answer = ""
        if not answer:
            sys.exit(f"no frame was rendered: the renderer ended with exit status {self.process.wait()}")
        return [picture["homography"] for picture in json.loads(answer)["pictures"]]

    def close(self):
        """Ends the process."""
        self.process.stdin.close()
        self.process.stdout.close()
        self.process.wait()


class Studio:
    """Renders frames into a folder. A frame depends on the seed and its key alone."""

    def __init__(self, folder, backgrounds, seed, renderer):
        self.folder, self.backgrounds, self.seed, self.renderer = folder, backgrounds, seed, renderer

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.renderer.close()

    def shoot(self, picture, factors, *key):
        """A frame of `picture`; `key` tells it from the others of this run.

        Neither the background nor what hides the object is the object's own picture.
        """
        name = "-".join(map(str, (self.seed, picture.name, *key)))
        digest = hashlib.sha256(name.encode()).hexdigest()[:16]
        path = os.path.join(self.folder, digest + ".jpg")
        seed = int(digest, 16)
        rng = random.Random(seed)
        background, patch = rng.sample([b for b in self.backgrounds if b.digest != picture.digest], 2)
        request = request_of(rng, picture, background, patch, draw(rng, factors))
        homography = self.renderer.render({"out": path, "seed": seed, **request})[0]
        shown = {picture.digest, background.digest, patch.digest}
        return Frame(path, {picture.digest: outline(homography, picture.size)}, shown)

    def clear(self, frames):
        """Deletes frames from the disk."""
        for frame in frames:
            os.remove(frame.path)


def request_of(rng, picture, background, patch, values):
    """What the renderer is asked for: `picture` over `background`, as `values` say."""
    pose = {
        "side_px": values["scale"] * UNIT,
        "rotation_deg": values["rotation"],
        "tilt_deg": values["tilt"],
        "axis_deg": rng.uniform(0, 360),
    }
    shown = {"path": os.path.abspath(picture.path), "pose": pose}
    if values["occlusion"] > 0:
        shown["hidden"] = {"share": values["occlusion"], "by": os.path.abspath(patch.path)}
    return {
        "width": WIDTH,
        "height": HEIGHT,
        "background": os.path.abspath(background.path),
        "pictures": [shown],
        "light": values["light"],
        "cast": [rng.uniform(1 - values["cast"], 1 + values["cast"]) for _ in range(3)],
        "blur_px": values["blur"],
        "noise": values["noise"],
        "quality": QUALITY,
    }
