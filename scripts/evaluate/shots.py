"""The command `pictures`: draws the pictures of the pages anew, by this build, and keeps their digests.

Frames are those of assets/sequence, or rendered ones of known poses. Screenshots come from the tests that use the pages
in headless Chromium: they write them where KEYGRAPH_SCREENSHOTS says.
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys

import cv2
import numpy as np
from detectors import check_command
from frames import build_renderer
from lenses import LENSES, MIDDLE, SQUARE, VIEWS
from pictures import picture_paths
from places import DOCS, PICTURES, ROOT, SEQUENCE

# What is drawn, by the place of its file below the root.
DRAWN = ("docs/found.webp", "docs/steep.jpg", "docs/bent.jpg", "docs/page.png", "bindings/web/screenshot.jpg")
# A view from far to the side: two pictures tilted by 80 degrees.
STEEP = [
    {
        "path": "astronaut",
        "pose": {"side_px": 620, "rotation_deg": 0, "tilt_deg": 80, "axis_deg": 82, "centre": [310, 270]},
    },
    {
        "path": "coffee",
        "pose": {"side_px": 600, "rotation_deg": 0, "tilt_deg": 80, "axis_deg": 27, "centre": [650, 250]},
    },
]
TURN, SPIN, LEAN = "100", "10", "12"  # of the can, degrees
VIEW_OF_FISHEYE = 7  # of the views that tests/examples/lensed.rs draws
MOVING = "fps=3,scale=480:-1:flags=lanczos"


def pictures(args, folder):
    """Draws all pictures; gives their digests."""
    check_command(args.keygraph)
    draw = Draw(os.path.abspath(args.keygraph), folder)
    draw.moving()
    draw.steep()
    draw.bent()
    draw.explained()
    draw.page()
    draw.web()
    explained = picture_paths([os.path.join(DOCS, "method")])
    names = [*DRAWN, *(os.path.relpath(path, ROOT) for path in explained)]
    return {"sha256": {name: digest(os.path.join(ROOT, name)) for name in names}}


def digest(path):
    """The SHA-256 of a file."""
    with open(path, "rb") as f:
        return hashlib.sha256(f.read()).hexdigest()


def run(*command, **more):
    """Runs a command; ends the program when it fails."""
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, **more)
    # 1 says that nothing was found.
    if done.returncode:
        sys.exit(f"{done.stdout}this failed: {' '.join(map(str, command))}")
    return done.stdout


class Draw:
    """What draws pictures with one build of the command, below a folder."""

    def __init__(self, keygraph, folder):
        self.keygraph, self.folder = keygraph, folder
        self.models = []
        for name in ("astronaut", "coffee"):
            model = os.path.join(folder, f"{name}.kgm")
            run(keygraph, "train", "--quiet", os.path.join(PICTURES, f"{name}.jpg"), "-o", model)
            self.models += ["-m", model]

    def annotated(self, *options, models=None):
        """Frames with what is found in them: a folder."""
        out = os.path.join(self.folder, f"out-{len(os.listdir(self.folder))}")
        run(self.keygraph, "detect", "--quiet", *(models or self.models), "--annotate", out, *options)
        return out

    def moving(self):
        """The sequence with what is found, every second frame."""
        out = self.annotated(*picture_paths([SEQUENCE])[::2])
        frames = os.path.join(out, "*.jpg")
        encoder = "-c:v", "libwebp_anim", "-loop", "0", "-quality", "55", "-compression_level", "6"
        into = os.path.join(DOCS, "found.webp")
        source = "-framerate", "3", "-pattern_type", "glob", "-i", frames
        run("ffmpeg", "-v", "error", "-y", *source, "-vf", MOVING, *encoder, into)

    def steep(self):
        """Two pictures that are seen from far to the side."""
        frame = os.path.join(self.folder, "steep.png")
        laid = [{**p, "path": os.path.join(PICTURES, f"{p['path']}.jpg")} for p in STEEP]
        scene = {"out": frame, "width": 960, "height": 540, "seed": 7, "blur_px": 0.5, "noise": 2.0, "pictures": laid}
        scene["background"] = os.path.join(PICTURES, "gravel.jpg")
        run(build_renderer(), input=json.dumps(scene) + "\n")
        out = self.annotated("--wide", frame)
        save("docs/steep.jpg", read(out, "steep.png"))

    def bent(self):
        """A label on a can, the same laid flat, and a picture before a fisheye lens."""
        for example in ("can", "lensed"):
            run("cargo", "build", "--release", "--quiet", "-p", "keygraph-tests", "--example", example)
        examples = os.path.join(os.path.dirname(self.keygraph), "examples")
        can, views, flat = (os.path.join(self.folder, name) for name in ("can.png", "views", "flat"))
        run(os.path.join(examples, "can"), can, TURN, SPIN, LEAN)
        focal, k = LENSES["fisheye of 170 degrees"]
        camera = ",".join(str(v) for v in (focal, focal * SQUARE, *MIDDLE)), ",".join(map(str, k))
        run(os.path.join(examples, "lensed"), views, str(VIEWS), "11", *camera)
        astronaut = self.models[:2]
        label = read(self.annotated("--rectify", flat, can, models=astronaut), "can.png")
        written = os.path.join(self.folder, "camera.yaml")
        run(self.keygraph, "calibrate", "--fisheye", *astronaut, views, "-o", written)
        fisheye, lens = f"{VIEW_OF_FISHEYE:03}.png", ("--lens", written, "--width-mm", "200")
        seen = read(self.annotated(*lens, os.path.join(views, fisheye), models=astronaut), fisheye)
        rectified = read(flat, sorted(os.listdir(flat))[0])
        height = 440
        parts = [
            cv2.resize(p, (p.shape[1] * height // p.shape[0], height), interpolation=cv2.INTER_AREA)
            for p in (label, rectified, seen)
        ]
        save("docs/bent.jpg", np.hstack(parts))

    def explained(self):
        """Each stage on one frame."""
        frame, out = os.path.join(SEQUENCE, "0005.jpg"), os.path.join(self.folder, "method")
        run(self.keygraph, "explain", os.path.join(PICTURES, "astronaut.jpg"), frame, "-o", out)
        for path in picture_paths([out]):
            shutil.copy(path, os.path.join(DOCS, "method"))

    def page(self):
        """The page of `keygraph camera`."""
        shots = {**os.environ, "KEYGRAPH_SCREENSHOTS": self.folder}
        run("cargo", "test", "--quiet", "-p", "keygraph", "--test", "camera_page", "the_outline_lies", env=shots)
        # With 256 colours it has a quarter of the bytes.
        palette = "split[a][b];[a]palettegen[p];[b][p]paletteuse"
        shot, into = os.path.join(self.folder, "found.png"), os.path.join(DOCS, "page.png")
        run("ffmpeg", "-v", "error", "-y", "-i", shot, "-vf", palette, into)

    def web(self):
        """The page that learns and finds in the browser."""
        run(os.path.join("scripts", "test-web"), env={**os.environ, "KEYGRAPH_SCREENSHOTS": self.folder})
        save("bindings/web/screenshot.jpg", read(self.folder, "web.png"))


def read(folder, name):
    """A picture of a folder."""
    pixels = cv2.imread(os.path.join(folder, name))
    if pixels is None:
        sys.exit(f"there is no picture {name} in {folder}: {', '.join(sorted(os.listdir(folder)))}")
    return pixels


def save(name, pixels):
    """Writes a picture of the pages."""
    cv2.imwrite(os.path.join(ROOT, name), pixels, [cv2.IMWRITE_JPEG_QUALITY, 88])
    print(f"wrote {name}", flush=True)
