"""What happens to prints and frames that the renderer does not know: bends, dents, things in front, and light.

A print that is not flat lies on a piece of another picture, because its outline is curved. The
renderer lays the two down as one picture. In: pixels, and a generator of random numbers of numpy.
"""

from dataclasses import dataclass

import cv2
import numpy as np

MARGIN = 0.12  # around a print that is not flat, as a share of its longer side
FULL = 255.0


@dataclass
class Print:
    """A print that is not flat, on its ground, and where the picture's corners are, px."""

    pixels: np.ndarray
    corners: np.ndarray


def lay(pixels, ground, back):
    """The print on the `ground`. `back` gives the picture's px that are seen at x and y, px from its corner."""
    h, w = pixels.shape[:2]
    margin = int(MARGIN * max(w, h))
    y, x = np.mgrid[-margin : h + margin, -margin : w + margin].astype(np.float32)
    u, v = (np.float32(a) for a in back(x, y))
    ground = cv2.resize(ground, (x.shape[1], x.shape[0])).astype(np.float32)
    there = cv2.remap(np.ones((h, w), np.float32), u, v, cv2.INTER_LINEAR)[..., None]
    seen = cv2.remap(pixels, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    corners = np.array([(0, 0), (w, 0), (w, h), (0, h)], float)
    # Where the picture's corner is seen: steps towards it, since the map is nearly the identity.
    at = corners.copy()
    for _ in range(30):
        at += 0.7 * (corners - np.stack(back(at[:, 0], at[:, 1]), -1))
    return Print(np.uint8(seen * there + ground * (1 - there)), at + margin)


def bend(rng, pixels, ground):
    """A page that is bent by up to 90 degrees from edge to edge, as around a can, or as a wave."""
    h, w = pixels.shape[:2]
    turn, along = np.radians(rng.uniform(20, 90)), rng.integers(2)
    s = np.linspace(-0.5, 0.5, 201)
    wave = 0.5 * np.cos(2 * np.pi * 0.75 * s + rng.uniform(0, 6))
    heading = turn * (wave if rng.integers(2) else s)
    # Where a place on the paper is seen, and how far it rises from the plane: both from 0 to 1.
    seen = np.concatenate([[0], np.cumsum(np.cos(heading[1:]))]) / np.cos(heading[1:]).sum()
    rise = np.concatenate([[0], np.cumsum(np.sin(heading[1:]))]) / 200 * rng.uniform(-0.5, 0.5)
    shade = 1 - rng.uniform(0, 0.5) * (1 - np.cos(heading + rng.uniform(-0.4, 0.4)))
    paper = np.linspace(0, 1, 201)

    def back(x, y):
        a, b, long, wide = (x, y, w, h) if along == 0 else (y, x, h, w)
        # Beyond its ends the paper goes on as it is in the plane.
        t = a / long
        place = np.where((t < 0) | (t > 1), t, np.interp(t, seen, paper))
        a, b = place * long, b - np.interp(place, paper, rise) * min(long, wide)
        return (a, b) if along == 0 else (b, a)

    light = np.interp(np.linspace(0, 1, (w, h)[along]), paper, shade)
    lit = pixels * (light[None, :, None] if along == 0 else light[:, None, None])
    return lay(np.uint8(np.clip(lit, 0, FULL)), ground, back)


def crumple(rng, pixels, ground):
    """Another print of the picture, by another camera, that is not quite flat."""
    h, w = pixels.shape[:2]
    mixed = (pixels / FULL) ** rng.uniform(0.6, 1.6) @ (np.eye(3) + rng.normal(0, 0.08, (3, 3)))
    n = int(rng.integers(3, 8))
    dents = rng.normal(0, rng.uniform(0.002, 0.018) * np.sqrt(w * h), (2, n, n)).astype(np.float32)
    shade = cv2.resize(rng.normal(0, rng.uniform(0, 0.12), (n, n)), (w, h), interpolation=cv2.INTER_CUBIC)
    mixed = (mixed * rng.uniform(0.6, 1) + rng.uniform(-0.06, 0.06, 3)) * (1 + shade[..., None])

    def back(x, y):
        places = [np.float32(a / side * (n - 1)).reshape(x.shape[0], -1) for a, side in ((x, w), (y, h))]
        off = [cv2.remap(d, *places, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for d in dents]
        return tuple(a + d.reshape(a.shape) for a, d in zip((x, y), off, strict=True))

    return lay(np.uint8(np.clip(FULL * mixed, 0, FULL)), ground, back)


def wear(rng, pixels, ground):
    """An old print, paler than the picture: folded, stained, with numbers of its own, and crumpled."""
    h, w = pixels.shape[:2]
    worn = pixels / FULL
    gray = worn.mean(2, keepdims=True)
    worn = gray + rng.uniform(0.2, 1) * (worn - gray)
    worn = 1 - rng.uniform(0.5, 1) * (1 - worn)
    for _ in range(rng.integers(4)):
        # A number or a word that differs from print to print: a piece of the picture from elsewhere on it.
        piece = np.int32(rng.uniform(0.05, 0.25, 2) * (h, w))
        there, here = (tuple(map(slice, at, at + piece)) for at in rng.integers((h, w) - piece, size=(2, 2)))
        worn[there] = worn[here].copy()
    y, x = np.mgrid[:h, :w].astype(np.float32)
    for _ in range(rng.integers(1, 4)):
        # A fold: the halves catch the light differently, and the paper has lost its print along it.
        angle = rng.integers(2) * np.pi / 2 + rng.normal(0, 0.1)
        far = (x - rng.uniform(0.2, 0.8) * w) * np.cos(angle) + (y - rng.uniform(0.2, 0.8) * h) * np.sin(angle)
        worn *= np.where(far > 0, rng.uniform(0.7, 1), 1)[..., None]
        lost = rng.uniform(0, 0.8) * np.exp(-((far / (rng.uniform(0.002, 0.01) * max(w, h))) ** 2))[..., None]
        worn = worn * (1 - lost) + rng.uniform(0.4, 1) * lost
    n = int(rng.integers(6, 20))
    stains = cv2.resize(rng.normal(0, rng.uniform(0, 0.1), (n, n)), (w, h), interpolation=cv2.INTER_CUBIC)
    return crumple(rng, np.uint8(np.clip(FULL * (worn + stains[..., None]), 0, FULL)), ground)


# ------------------------------------------------------------------ frames


def cover(rng, frame, quad, other):
    """Puts something in front of the object: a half plane, a blob or a stripe, plain or a part of `other`."""
    h, w = frame.shape[:2]
    middle, size = quad.mean(0), np.sqrt(cv2.contourArea(np.float32(quad)))
    angle = rng.uniform(0, 2 * np.pi)
    across = np.array([np.cos(angle), np.sin(angle)])
    along, mask = np.array([-across[1], across[0]]) * 3000, np.zeros((h, w), np.uint8)
    kind = rng.integers(3)
    if kind == 0:
        fill(mask, middle + across * rng.uniform(-0.3, 0.35) * size, along, across * 3000)
    elif kind == 1:
        at = middle + across * rng.uniform(0.1, 0.5) * size
        axes = np.int32(size * rng.uniform((0.2, 0.12), (0.5, 0.4)))
        cv2.ellipse(mask, np.int32(at).tolist(), axes.tolist(), float(rng.uniform(0, 180)), 0, 360, 255, -1)
    else:
        start = middle + across * rng.uniform(-0.45, 0.25) * size
        fill(mask, start, along, across * rng.uniform(0.2, 0.5) * size)
    return lay_over(rng, frame, mask, other)


def cover_by_box(rng, frame, quad, other):
    """Puts an upright box in front of the object, somewhere in the upright rectangle around it, of 40 to 60 % of it."""
    mask = np.zeros(frame.shape[:2], np.uint8)
    low, high = quad.min(0), quad.max(0)
    size = (high - low) * rng.uniform(0.4, 0.6) ** 0.5
    at = rng.uniform(low, high - size)
    cv2.rectangle(mask, np.int32(at).tolist(), np.int32(at + size).tolist(), 255, -1)
    return lay_over(rng, frame, mask, other)


def lay_over(rng, frame, mask, other):
    """Lays something over the frame where there is a mask: mostly a part of `other`, or a colour."""
    h, w = mask.shape
    if rng.random() < 0.7:
        front = cv2.flip(cv2.resize(other, (w, h)), int(rng.integers(-1, 2)))
    else:
        front = rng.uniform(0, FULL, 3) + rng.normal(0, rng.uniform(1, 8), frame.shape)
        front = np.uint8(np.clip(front + np.linspace(-20, 20, w)[None, :, None], 0, FULL))
    return np.where(mask[..., None] > 0, front, frame)


def fill(mask, start, along, across):
    """Fills a strip that starts at a line through `start` and is as wide as `across`."""
    corners = [start - along, start + along, start + along + across, start - along + across]
    cv2.fillConvexPoly(mask, np.int32(corners), 255)


def spoil(rng, frame, quad):
    """Up to two of: glare, the edge of a shadow, another gamma, less contrast, more blur."""
    h, w = frame.shape[:2]
    size = np.sqrt(cv2.contourArea(np.float32(quad)))
    y, x = np.mgrid[:h, :w].astype(np.float32)
    seen = frame.astype(np.float32)
    for kind in rng.permutation(5)[: rng.integers(1, 3)]:
        at = quad.mean(0) + rng.normal(0, 0.3, 2) * size
        if kind == 0:
            far = ((x - at[0]) ** 2 + (y - at[1]) ** 2) / (size * rng.uniform(0.1, 0.45)) ** 2
            seen += rng.uniform(60, 220) * np.exp(-far)[..., None]
        elif kind == 1:
            angle = rng.uniform(0, 2 * np.pi)
            far = ((x - at[0]) * np.cos(angle) + (y - at[1]) * np.sin(angle)) / rng.uniform(2, 40)
            seen *= 1 - rng.uniform(0.3, 0.7) / (1 + np.exp(-np.clip(far, -30, 30)))[..., None]
        elif kind == 2:
            seen = FULL * (np.clip(seen, 0, FULL) / FULL) ** rng.uniform(0.5, 2)
        elif kind == 3:
            left = rng.uniform(0.3, 0.9)
            seen = seen * left + seen.mean() * (1 - left)
        else:
            seen = cv2.GaussianBlur(seen, (0, 0), rng.uniform(0.8, 3))
    return np.uint8(np.clip(seen + rng.normal(0, rng.uniform(1, 4), seen.shape), 0, FULL))
