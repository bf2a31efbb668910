"""Pictures of objects and backgrounds, read with OpenCV."""

import hashlib
import os
import sys
from dataclasses import dataclass, field

import cv2
import numpy as np


@dataclass
class Picture:
    """A picture on disk. Two with the same bytes have the same digest."""

    path: str
    pixels: np.ndarray = field(repr=False)
    digest: str

    @property
    def name(self):
        """The file's name without its extension."""
        return os.path.splitext(os.path.basename(self.path))[0]

    @property
    def size(self):
        """Width and height, px."""
        return self.pixels.shape[1], self.pixels.shape[0]


def read_picture(path):
    """The picture at `path`; ends the program when there is none."""
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
