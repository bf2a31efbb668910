#!/usr/bin/env python3
"""Make assets/pictures from the photographs inside the scikit-image package.

    python3 scripts/make-pictures.py [FOLDER]    default: assets/pictures

Needs `pip install scikit-image==0.26.0 opencv-python-headless`. Another version of OpenCV
may compress differently by a gray level. Results of tests depend on the pictures' bytes:
those in the repository stay as they are.
"""

import os
import sys

import cv2
import skimage

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
DATA = os.path.join(os.path.dirname(skimage.__file__), "data")
QUALITY = 92


def load(name, gray=False):
    """A photograph of the package."""
    return cv2.imread(os.path.join(DATA, name), cv2.IMREAD_GRAYSCALE if gray else cv2.IMREAD_COLOR)


def main():
    if len(sys.argv) > 2 or sys.argv[1:2] in (["-h"], ["--help"]):
        sys.exit(__doc__)
    folder = sys.argv[1] if len(sys.argv) == 2 else os.path.join(ROOT, "assets", "pictures")
    hubble = load("hubble_deep_field.jpg")[136:736, 100:900]
    pictures = {
        "astronaut": load("astronaut.png"),
        "coffee": load("coffee.png"),
        "chelsea": load("chelsea.png"),
        "rocket": load("rocket.jpg"),
        "hubble": cv2.resize(hubble, (640, 480), interpolation=cv2.INTER_AREA),
        "brick": load("brick.png", gray=True),
        "gravel": load("gravel.png", gray=True),
    }
    os.makedirs(folder, exist_ok=True)
    for name, pixels in pictures.items():
        cv2.imwrite(os.path.join(folder, name + ".jpg"), pixels, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])


if __name__ == "__main__":
    main()
