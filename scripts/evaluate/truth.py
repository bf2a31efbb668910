"""Frames whose truth is known, and the files that hold it.

A truth file is JSON: one set or a list of sets, each
{"name", "model": picture, "frames": [{"image", "H" or "corners"}]}, with paths relative to
the file. "H" maps picture px to frame px (nine numbers or three rows); "corners" is the
outline, the images of (0, 0), (w, 0), (w, h), (0, h). A null for either says that the
frame does not show the object. A frame with "train": true shows it and is never searched
for it, since the picture was cut from it.
"""

import json
import os
import sys
from dataclasses import dataclass, field

from scoring import outline


@dataclass
class Frame:
    """A frame on disk, and what it shows. Objects go by the digest of their picture."""

    path: str
    quads: dict = field(default_factory=dict)  # digest -> outline; None where it is not known
    may_show: set = field(default_factory=set)  # digests of all pictures that may be seen


def read_truth(path, read_picture):
    """The objects' pictures and the frames of a truth file.

    `read_picture` turns a path into a picture with `digest` and `size`. Ends the program
    when the file cannot be read.
    """
    base = os.path.dirname(os.path.abspath(path))
    pictures, frames = {}, {}
    try:
        with open(path, encoding="utf-8") as text:
            sets = json.load(text)
        for entry in sets if isinstance(sets, list) else [sets]:
            picture = read_picture(os.path.join(base, entry["model"]))
            pictures.setdefault(picture.digest, picture)
            for given in entry["frames"]:
                image = os.path.realpath(os.path.join(base, given["image"]))
                note(frames.setdefault(image, Frame(image)), picture, given)
    except OSError as e:
        sys.exit(f"{path}: {e.strerror}")
    except (KeyError, TypeError, ValueError) as e:
        sys.exit(f"{path}: not a truth file ({type(e).__name__}: {e}); `--help` says what is in one")
    return list(pictures.values()), list(frames.values())


def note(frame, picture, given):
    """Enters into `frame` what one entry of a truth file says of `picture`."""
    if given.get("train"):
        quad = None
    elif given.get("H") is not None:
        quad = outline(given["H"], picture.size)
    elif given.get("corners") is not None:
        quad = [(float(x), float(y)) for x, y in given["corners"]]
        if len(quad) != 4:
            raise ValueError(f"an outline has four corners, not {len(quad)}")
    else:
        return
    frame.quads[picture.digest] = quad
    frame.may_show.add(picture.digest)


def gather(truth_files, pictures, read_picture):
    """The objects of truth files and of `pictures`, each once, and the files' frames."""
    objects, frames = {p.digest: p for p in pictures}, {}
    for path in truth_files:
        named, shot = read_truth(path, read_picture)
        for picture in named:
            objects.setdefault(picture.digest, picture)
        for frame in shot:
            known = frames.setdefault(frame.path, frame)
            known.quads.update(frame.quads)
            known.may_show |= frame.may_show
    return list(objects.values()), list(frames.values())
