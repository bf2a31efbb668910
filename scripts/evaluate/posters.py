"""Posters: drawn pictures for the objects of large packs.

Coloured shapes and words over a tinted part of one of the two textures of assets/.
"""

import os
import subprocess
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
from places import PICTURES
from progress import Progress

WORDS = (
    "ATLAS GARDEN RIVER MODERN ART VOLUME NORTH SILENT OCEAN DAILY COFFEE BREAD 1984 ORBIT FIELD GUIDE STORY".split()
)
SIZES = [(480, 360), (360, 480), (420, 420), (540, 360)]


def poster(seed, textures):
    """The poster of this seed; no other seed gives the same."""
    rng = np.random.default_rng(seed)
    pixels = ground(rng, SIZES[rng.integers(len(SIZES))], textures)
    for _ in range(rng.integers(12, 40)):
        draw_shape(rng, pixels)
    for _ in range(rng.integers(4, 12)):
        draw_words(rng, pixels)
    return pixels


def read_textures():
    """The textures, which are objects nowhere."""
    return [cv2.imread(os.path.join(PICTURES, f"{name}.jpg")) for name in ("brick", "gravel")]


def ground(rng, size, textures):
    """One colour that fades into another, and a part of a texture."""
    w, h = size
    top, bottom = rng.uniform(0, 255, (2, 3))
    down = np.linspace(0, 1, h)[:, None, None]
    pixels = (top * (1 - down) + bottom * down) * np.ones((h, w, 1))
    texture = textures[rng.integers(len(textures))].astype(np.float64)
    turn = cv2.getRotationMatrix2D((w / 2, h / 2), rng.uniform(0, 360), rng.uniform(0.5, 1.5))
    x, y = np.sort(rng.integers(0, w, 2)), np.sort(rng.integers(0, h, 2))
    part = slice(*y), slice(*x)
    cover = cv2.warpAffine(texture, turn, (w, h), borderMode=cv2.BORDER_REFLECT) * rng.uniform(0.3, 1.4, 3)
    pixels[part] = cover[part]
    return np.clip(pixels, 0, 255).astype(np.uint8)


def colour(rng):
    """A random colour."""
    return tuple(map(float, rng.uniform(0, 255, 3)))


def place(rng, pixels):
    """A random pixel: x, y."""
    return int(rng.integers(pixels.shape[1])), int(rng.integers(pixels.shape[0]))


def draw_shape(rng, pixels):
    """Draws a circle, a rectangle, a polygon or a line."""
    at, side, line = place(rng, pixels), int(rng.integers(6, 90)), int(rng.choice([-1, -1, 1, 3]))
    kind = rng.integers(4)
    if kind == 0:
        cv2.circle(pixels, at, side // 2, colour(rng), line, cv2.LINE_AA)
    elif kind == 1:
        cv2.rectangle(pixels, at, (at[0] + side, at[1] + int(rng.integers(5, 80))), colour(rng), line)
    elif kind == 2:
        corners = np.int32(rng.normal(at, side / 2, (int(rng.integers(3, 7)), 2)))
        cv2.fillPoly(pixels, [corners], colour(rng), cv2.LINE_AA)
    else:
        cv2.line(pixels, at, place(rng, pixels), colour(rng), int(rng.integers(1, 5)), cv2.LINE_AA)


def draw_words(rng, pixels):
    """Writes one to three words."""
    h, w = pixels.shape[:2]
    text = " ".join(rng.choice(WORDS, rng.integers(1, 4)))
    at = int(rng.integers(-20, w // 2)), int(rng.integers(20, h))
    font, size = int(rng.integers(0, 8)), float(rng.uniform(0.4, 2.2))
    cv2.putText(pixels, text, at, font, size, colour(rng), int(rng.integers(1, 4)), cv2.LINE_AA)


def poster_models(command, folder, n):
    """Paths of the models of `n` posters in `folder`, trained where they are not there yet."""
    textures = read_textures()
    progress = Progress(n, "models")

    def train(i):
        path = os.path.join(folder, f"poster-{i:04}.kgm")
        if not os.path.exists(path):
            picture = path[:-4] + ".jpg"
            cv2.imwrite(picture, poster(i, textures))
            run = [command, "train", picture, "--preset", "standard", "-o", path]
            subprocess.run(run, check=True, stdout=subprocess.DEVNULL)
        progress.add(1)
        return path

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(train, range(n)))
