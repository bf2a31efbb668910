"""Measure how well objects are found, on rendered frames whose pose is known exactly.

    python3 scripts/evaluate curves          docs/curves.png, .json: found, against
                                             scale, rotation, tilt, occlusion, light
    python3 scripts/evaluate economy         docs/economy.png, .json: found, against
                                             the model's size
    python3 scripts/evaluate precision       corner error in px, a table
    python3 scripts/evaluate calibration [TRUTH.json ...]
                                             score against the share right, a table
    python3 scripts/evaluate false-alarms [FRAMES ...]
                                             detections where nothing is to be found
    python3 scripts/evaluate look-alikes     docs/look-alikes.png, .json: what is taken
                                             for an object that it looks like
    python3 scripts/evaluate fit [TRUTH.json ...]
                                             fits the score anew; --write puts it
                                             into the core
    python3 scripts/evaluate growth          docs/growth.png, .json: time, against
                                             objects, keygraphs, corners and pixels
    python3 scripts/evaluate rivals          time beside OpenCV, a table
    python3 scripts/evaluate mixed           time by what a frame shows, beside OpenCV
    python3 scripts/evaluate tilt            found from far to the side, plainly and with --wide
    python3 scripts/evaluate costs           time of whole commands
    python3 scripts/evaluate tracking        rendered sequences, searched and tracked
    python3 scripts/evaluate lenses          calibrations by a picture, beside OpenCV's
    python3 scripts/evaluate memory          resident sizes of `keygraph camera`
    python3 scripts/evaluate pictures        the pictures of the pages, drawn by this build
    python3 scripts/evaluate web             times of the browser package in Chromium
    python3 scripts/evaluate cluster         frames a second of examples/cluster
    python3 scripts/evaluate measure         all of these for the pages: their records
                                             (benches/record, docs/*.json), figures
                                             and tables; scripts/measure runs it

Needs `cargo build --release`. The packages numpy, opencv-python-headless and matplotlib,
and for `fit` scikit-learn, are installed into out/evaluate where they are missing. The
examples of the host (the renderer) are built when they are first needed.

In: pictures of objects and backgrounds (those of assets/ unless others are given); for
`calibration`, `false-alarms` and `fit` also truth files: a list of
{"name", "model": picture, "frames": [{"image", "H" or "corners"}]}, with paths relative to
the file. "H" maps picture pixels to frame pixels (nine numbers or three rows), "corners"
are the images of (0,0), (w,0), (w,h), (0,h). A null for either says that the object is not
there. A frame with "train": true shows the object and is left out: the picture was cut
from it.

Frames: 640x480 px, rendered by host/src/render.rs. At scale 1 the object's longer side is
420 px. The object is seen by a pinhole camera of 640 px focal length, over a background
and behind a patch that never show the object itself. Tilt is the angle between the
object's normal and the line of sight to its middle. Pixel centres have integer
coordinates. The same pictures and seed give the same frames on every machine.

Found: the mean distance of the best detection's four corners from the truth is under 10 %
of the object's size, the square root of its area in the frame. Tight: under 3 %.
Rivals: OpenCV's SIFT and ORB (1,000 features) with ratio test and RANSAC homography, on
the same frames. Times are in-process, of one thread, from the decoded pixels to the
outlines.

Cost: a frame is rendered in some 80 ms, and searched in 4 to 170 ms. `curves --frames 3`
takes some 10 minutes, `economy --frames 3` 3, `false-alarms` 15 to 50, `growth` 30, the
tables a few minutes.
"""

import argparse
import importlib
import os
import sys
import tempfile

from packages import need
from places import BELIEF, DOCS, KEYGRAPH, PICTURES, SEQUENCE

# Command -> the module of its function.
MODULES = {
    "curves": "commands",
    "economy": "commands",
    "precision": "commands",
    "calibration": "alarms",
    "false-alarms": "alarms",
    "look-alikes": "confusion",
    "fit": "fit",
    "growth": "growth",
    "rivals": "rivals",
    "mixed": "mixed",
    "tilt": "tilt",
    "costs": "measure",
    "tracking": "following",
    "memory": "following",
    "cluster": "following",
    "pictures": "shots",
    "web": "following",
    "lenses": "lenses",
    "measure": "measure",
}
# Modules that a command needs beside cv2 and numpy, where it is not matplotlib.
OTHER_PACKAGES = {
    **dict.fromkeys(("rivals", "costs", "tracking", "memory", "cluster", "lenses", "pictures", "web"), []),
    "fit": ["matplotlib", "sklearn"],
}
OBJECTS = [os.path.join(PICTURES, f"{name}.jpg") for name in ("astronaut", "chelsea", "coffee", "hubble", "rocket")]


def parser():
    """The command line."""
    p = argparse.ArgumentParser(
        prog="evaluate", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = p.add_subparsers(dest="command", required=True)

    def command(name, help_text):
        c = commands.add_parser(name, help=help_text, description=help_text)
        c.add_argument(
            "--keygraph", default=KEYGRAPH, metavar="FILE", help="the command [default: target/release/keygraph]"
        )
        return c

    c = command("curves", "Found, against scale, rotation, tilt, occlusion, light")
    add_pictures(c)
    add_frames(c, 8, "a point and object")
    add_figure(c, "curves.png", redraw=True)
    c = command("economy", "Found, against the model's size")
    add_pictures(c)
    add_frames(c, 12, "a condition and object")
    add_figure(c, "economy.png", redraw=True)
    c = command("precision", "Corner error in px")
    add_pictures(c)
    add_frames(c, 40, "an object")
    c.add_argument("--scale", type=float, default=1.0)
    c = command("calibration", "Score, against the share of right detections")
    add_pictures(c)
    add_frames(c, 100, "an object")
    c.add_argument("truth", nargs="*", metavar="TRUTH.json", help="truth files, whose frames are searched as well")
    c.add_argument("--bins", type=positive, default=10)
    add_training(c)
    add_false_alarms(command("false-alarms", "Detections in frames that do not show the object"))
    c = command("look-alikes", "What is taken for an object that it looks like")
    add_pictures(c)
    add_frames(c, 4, "a member of a family")
    add_look_alikes(c)
    add_fit(command("fit", "Fits the score of the core anew"))
    add_growth(command("growth", "Time, against objects, keygraphs, corners and pixels"))
    add_rivals(command("rivals", "Time beside OpenCV, on the same frames"))
    c = command("mixed", "Time of frames that show the object plainly, hardly and not at all, beside OpenCV")
    add_pictures(c)
    add_frames(c, 40, "of each kind and object")
    c = command("tilt", "Found from far to the side, plainly and with --wide, beside OpenCV")
    add_pictures(c)
    add_frames(c, 24, "a tilt and object")
    command("costs", "Time of training, of a folder of frames and of a start")
    command("tracking", "How well rendered sequences are tracked, beside a search of every frame")
    command("lenses", "Errors of calibrations by a picture, beside those of OpenCV by a chessboard")
    command("pictures", "Draws the pictures of README and docs anew, and keeps their digests")
    command("web", "Times of the browser package in headless Chromium")
    command("cluster", "Frames a second of examples/cluster, with one worker and with two")
    command("memory", "Resident sizes of `keygraph camera` with viewers, learners and models")
    add_measure(command("measure", "Measures what the pages show, and writes records, figures and tables"))
    return p


def add_pictures(c):
    """Options of all commands that render frames."""
    c.add_argument(
        "--objects",
        nargs="+",
        default=OBJECTS,
        metavar="PICTURE",
        help="pictures of objects, or folders of them [default: five of assets/pictures]",
    )
    add_backgrounds(c)


def add_backgrounds(c):
    """Options of what is around the objects."""
    c.add_argument(
        "--backgrounds",
        nargs="+",
        default=[PICTURES],
        metavar="PICTURE",
        help="pictures for backgrounds and patches, or folders of them [default: assets/pictures]",
    )
    c.add_argument("--seed", type=int, default=1)


def add_frames(c, default, of_what):
    """How many frames are rendered."""
    c.add_argument(
        "--frames",
        type=positive,
        default=default,
        metavar="N",
        help=f"rendered frames {of_what} [default: {default}]",
    )


def add_figure(c, name, redraw):
    """Where a figure goes."""
    c.add_argument(
        "--out",
        default=os.path.join(DOCS, name),
        metavar="FILE.png",
        help=f"figure; the numbers go beside it as .json [default: docs/{name}]",
    )
    if redraw:
        c.add_argument("--redraw", action="store_true", help="only draw anew, from the numbers of an earlier run")


def add_training(c):
    """Options of commands that look for wrong detections."""
    c.add_argument("--keep", metavar="DIR", help="copy the frames with wrong detections here")
    add_train(c)


def add_train(c):
    """How models are trained."""
    c.add_argument(
        "--train",
        type=str.split,
        default=[],
        metavar="OPTIONS",
        help="options of `keygraph train`, as one word: --train='--preset standard'",
    )


def add_false_alarms(c):
    """Options of `false-alarms`."""
    add_pictures(c)
    c.add_argument(
        "frames",
        nargs="*",
        metavar="FRAMES",
        help="truth files; frames or folders of frames that show none of the objects",
    )
    c.add_argument(
        "--pairs",
        type=positive,
        default=30_000,
        metavar="N",
        help="frames are rendered until there are so many pairs of frame and object [default: 30000]",
    )
    c.add_argument(
        "--threshold", type=float, default=0.05, metavar="S", help="least score that is counted [default: 0.05]"
    )
    add_training(c)


def add_look_alikes(c):
    """Options of `look-alikes`."""
    c.add_argument(
        "--groups", type=positive, default=10, metavar="N", help="groups of five pictures a family [default: 10]"
    )
    c.add_argument(
        "--hidden", type=positive, default=60, metavar="N", help="frames an object, half hidden [default: 60]"
    )
    c.add_argument("--bins", type=positive, default=10)
    add_train(c)
    add_figure(c, "look-alikes.png", redraw=True)


def add_fit(c):
    """Options of `fit`."""
    add_pictures(c)
    add_frames(c, 24, "an object and condition")
    c.add_argument("truth", nargs="*", metavar="TRUTH.json", help="truth files, whose frames are fitted to as well")
    for name, default, what in (
        ("--posters", 12, "drawn objects beside the given ones"),
        ("--groups", 8, "groups of five look-alikes a family"),
        ("--trees", 48, "trees"),
        ("--bins", 10, "bins of the table"),
    ):
        c.add_argument(name, type=positive, default=default, metavar="N", help=f"{what} [default: {default}]")
    c.add_argument(
        "--bias",
        type=int,
        default=72,
        metavar="STEPS",
        help="added to the fitted BIAS: 32 steps multiply the odds by 2.7. More finds more that is hidden, and takes "
        "more look-alikes for it [default: 72]",
    )
    c.add_argument(
        "--write", nargs="?", const=BELIEF, metavar="FILE", help="put the trees into core/src/detect/belief.rs, or FILE"
    )
    add_train(c)


def add_growth(c):
    """Options of `growth`."""
    c.set_defaults(objects=OBJECTS)
    c.add_argument(
        "--objects",
        dest="counts",
        type=positive,
        nargs="+",
        default=[1, 10, 100, 1000],
        metavar="N",
        help="how many objects are looked for at once [default: 1 10 100 1000]",
    )
    add_backgrounds(c)
    add_frames(c, 4, "of each object and condition")
    c.add_argument("--work", metavar="DIR", help="keep the posters' models here, for the next run")
    add_figure(c, "growth.png", redraw=False)


def add_rivals(c):
    """Options of `rivals`."""
    c.add_argument(
        "--object",
        default=os.path.join(PICTURES, "astronaut.jpg"),
        metavar="PICTURE",
        help="the object [default: astronaut.jpg]",
    )
    c.add_argument("--frames", default=SEQUENCE, metavar="DIR", help="a folder of frames [default: assets/sequence]")
    c.add_argument("--passes", type=positive, default=5, metavar="N", help="times that each frame is taken")
    c.add_argument("--presets", nargs="+", default=["large", "standard", "compact"], metavar="PRESET")


def add_measure(c):
    """Options of `measure`."""
    c.add_argument("parts", nargs="*", metavar="PART", help="what is measured [default: all that --help lists]")
    c.add_argument(
        "--pages", action="store_true", help="measure nothing; write the tables of the pages from the records"
    )
    c.add_argument(
        "--scores",
        metavar="DIR",
        help="JSON files of a scorer of photographs: large.json, standard.json, ... (accuracy)",
    )


def positive(text):
    """A whole number of 1 or more."""
    n = int(text)
    if n < 1:
        raise argparse.ArgumentTypeError("give 1 or more")
    return n


def run(command, arguments):
    """Runs a command with these arguments; gives what it measured."""
    args = parser().parse_args([command, *arguments])
    module = importlib.import_module(MODULES[command])
    args.run = run
    with tempfile.TemporaryDirectory(prefix="keygraph-") as folder:
        return getattr(module, command.replace("-", "_"))(args, folder)


def main():
    """Runs the command that is asked for."""
    command = parser().parse_args().command
    need(["cv2", "numpy", *OTHER_PACKAGES.get(command, ["matplotlib"])])
    import cv2

    cv2.setNumThreads(1)
    cv2.setRNGSeed(1)
    run(command, sys.argv[2:])


if __name__ == "__main__":
    main()
