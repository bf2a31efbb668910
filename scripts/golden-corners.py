#!/usr/bin/env python3
"""Write tests/data/corners: OpenCV's corners of three grey pictures.

    python3 scripts/golden-corners.py           corners of the pictures that are there
    python3 scripts/golden-corners.py --images  makes the pictures anew first, from an
                                                installed scikit-image

Needs numpy and opencv-python(-headless); --images also needs scikit-image.

The header of each file makes claims. Each is checked against plain integer arithmetic
before the file is written; a claim that does not hold ends the run.
"""

import argparse
import itertools
import os

import cv2
import numpy as np

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
CORNERS = os.path.join(ROOT, "tests", "data", "corners")

# name: (file in scikit-image, crop x0 y0 x1 y1, size, where it is from)
SOURCES = {
    "astronaut": (
        "astronaut.png",
        (0, 0, 512, 384),
        (320, 240),
        "astronaut, NASA; no known copyright restrictions, released into the public domain",
    ),
    "coffee": (
        "coffee.png",
        (60, 0, 593, 400),
        (320, 240),
        "coffee, Rachel Michetti; no copyright restrictions, CC0 by the photographer",
    ),
    "rocket": (
        "rocket.jpg",
        (0, 0, 569, 427),
        (320, 240),
        "rocket, SpaceX; released in the public domain",
    ),
}

QUALITY = 0.01
LISTS = {"plain": (300, 1), "spaced": (79, 10)}
# What OpenCV multiplies each Sobel response by.
SCALE = 1 / (2 ** (3 - 1) * 3 * 255)

HEADER = """\
Corners of {name}.png ({width}x{height}, 8-bit grey; from scikit-image's {source})
by OpenCV {version} goodFeaturesToTrack with
  maxCorners={count} qualityLevel={quality} minDistance={distance}
  blockSize=3 gradientSize=3 useHarrisDetector=False, no mask.
Lines: x y eigenvalue, in OpenCV's order (strongest first);
  eigenvalue = cornerMinEigenVal(grey, 3, ksize=3) at that pixel (float32), as %.9g.

From integers: with gx, gy the 3x3 Sobel responses (weights 1 2 1), and
  A = sum gx*gx, B = sum gx*gy, C = sum gy*gy over the pixel's 3x3 block,
  lambda_int = ((A + C) - sqrt((A - C)^2 + 4 B^2)) / 2
             = the smaller eigenvalue of [[A, B], [B, C]],
  eigenvalue = lambda_int * scale^2, lambda_int = eigenvalue / scale^2,
  scale = 1 / (2^(ksize-1) * blockSize * 255) = 1/3060, scale^2 = 1/9363600.
Checked on this picture, every pixel, borders too: the two sides agree to
  {worst:.1e} of the picture's largest value; on the corners below to
  {relative:.1e} of the corner's own value (OpenCV computes in float32).
Borders: BORDER_REFLECT_101 (= BORDER_DEFAULT), without repeating the edge
  pixel: the grey picture for the Sobel, and then the products gx*gx, gx*gy,
  gy*gy for the block sum.
Choice: a pixel not in the outermost 1 px frame; its eigenvalue above
  qualityLevel times the picture's largest (which is taken over all pixels,
  the frame included) and not below any of its 8 neighbours'; then strongest
  first, among equals the later in row order first; a corner closer than
  minDistance to one already taken is left out (dx^2 + dy^2 < minDistance^2).
  {found} corners are left before the distance and the count.
  Done with lambda_int in float64 instead of OpenCV's float32, these steps
  give the same list in the same order.
Least relative gap between neighbours in the list: {gap:.1e}"""


def make_images():
    """Makes the pictures from the files inside the scikit-image package."""
    import skimage

    data = os.path.join(os.path.dirname(skimage.__file__), "data")
    for name, (file, (x0, y0, x1, y1), size, _) in SOURCES.items():
        image = cv2.imread(os.path.join(data, file), cv2.IMREAD_COLOR)
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)[y0:y1, x0:x1]
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        cv2.imwrite(os.path.join(CORNERS, name + ".png"), grey, [cv2.IMWRITE_PNG_COMPRESSION, 9])


def sums(grey):
    """Integer sums A, B, C over each 3x3 block of gx*gx, gx*gy, gy*gy."""
    h, w = grey.shape
    p = np.pad(grey.astype(np.int64), 1, mode="reflect")

    def at(image, dx, dy):
        return image[1 + dy : 1 + dy + h, 1 + dx : 1 + dx + w]

    gx = sum(k * (at(p, 1, dy) - at(p, -1, dy)) for dy, k in ((-1, 1), (0, 2), (1, 1)))
    gy = sum(k * (at(p, dx, 1) - at(p, dx, -1)) for dx, k in ((-1, 1), (0, 2), (1, 1)))

    def block(product):
        q = np.pad(product, 1, mode="reflect")
        return sum(at(q, dx, dy) for dy in (-1, 0, 1) for dx in (-1, 0, 1))

    return block(gx * gx), block(gx * gy), block(gy * gy)


def smaller(a, b, c):
    """The smaller eigenvalue of [[a, b], [b, c]], in the form that keeps digits."""
    trace = (a + c).astype(np.float64)
    root = np.sqrt(((a - c) ** 2 + 4 * b * b).astype(np.float64))
    det = (a * c - b * b).astype(np.float64)
    return np.where(trace > 0, 2 * det / np.maximum(trace + root, 1), 0.0)


def rank(value, count, distance, later_first=True):
    """The choice of goodFeaturesToTrack, in plain steps, on any eigenvalue image."""
    h, w = value.shape
    floor = value.max() * QUALITY
    found = []
    for y in range(1, h - 1):
        for x in range(1, w - 1):
            v = value[y, x]
            if v > floor and v == value[y - 1 : y + 2, x - 1 : x + 2].max():
                order = y * w + x
                found.append((-v, -order if later_first else order, x, y))
    found.sort()
    kept = []
    for _, _, x, y in found:
        if all((x - u) ** 2 + (y - v) ** 2 >= distance * distance for u, v in kept):
            kept.append((x, y))
            if len(kept) == count:
                break
    return kept, len(found)


def check(name, grey, kind):
    """OpenCV's corners of a picture, and what was measured of them.

    Ends with an AssertionError where a claim of HEADER does not hold.
    """
    count, distance = LISTS[kind]
    eig = cv2.cornerMinEigenVal(grey, 3, ksize=3)
    exact = smaller(*sums(grey))
    back = eig.astype(np.float64) / SCALE**2
    worst = np.abs(back - exact).max() / exact.max()
    assert worst < 1e-6, (name, worst)
    points = cv2.goodFeaturesToTrack(
        grey, count, QUALITY, distance, None, blockSize=3, gradientSize=3, useHarrisDetector=False
    )
    points = [tuple(int(v) for v in p) for p in points.reshape(-1, 2)]
    assert len(points) == count, (name, kind, len(points))
    values = [eig[y, x] for x, y in points]
    pairs = list(itertools.pairwise(values))
    assert all(a >= b for a, b in pairs), (name, kind)
    assert rank(eig, count, distance)[0] == points, (name, kind)
    ours, found = rank(exact, count, distance)
    differing = [(i, a, b) for i, (a, b) in enumerate(zip(points, ours, strict=True)) if a != b]
    assert not differing, (name, kind, differing)
    relative = max(abs(back[y, x] / exact[y, x] - 1) for x, y in points)
    gap = min(a / b - 1 for a, b in pairs)
    print(
        f"{name} {kind} {len(points)} of {found}: error {worst:.1e} of the largest, {relative:.1e} of itself; "
        f"smallest gap {gap:.1e}, {sum(a == b for a, b in pairs)} ties; the exact list is the same"
    )
    measured = {"worst": worst, "relative": relative, "gap": gap, "found": found}
    return list(zip(points, values, strict=True)), measured


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("--images", action="store_true", help="make the pictures anew")
    args = args.parse_args()
    cv2.setNumThreads(1)
    os.makedirs(CORNERS, exist_ok=True)
    if args.images:
        make_images()
    for name, (_, _, _, source) in SOURCES.items():
        grey = cv2.imread(os.path.join(CORNERS, name + ".png"), cv2.IMREAD_UNCHANGED)
        assert grey.dtype == np.uint8 and grey.ndim == 2
        height, width = grey.shape
        for kind, (count, distance) in LISTS.items():
            corners, measured = check(name, grey, kind)
            header = HEADER.format(
                name=name,
                width=width,
                height=height,
                source=source,
                version=cv2.__version__,
                count=count,
                quality=QUALITY,
                distance=distance,
                **measured,
            )
            with open(os.path.join(CORNERS, f"{name}.{kind}.txt"), "w") as out:
                for line in header.splitlines():
                    out.write(("# " + line).rstrip() + "\n")
                for (x, y), v in corners:
                    out.write(f"{x} {y} {v:.9g}\n")


if __name__ == "__main__":
    main()
