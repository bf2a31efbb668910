#!/usr/bin/env python3
"""Render assets/sequence: 48 frames of two pictures handled before a camera.

    python3 scripts/render-frames.py              frames + truth.json
    python3 scripts/render-frames.py --pictures   first (re)make assets/pictures
                                                  from an installed scikit-image
    python3 scripts/render-frames.py --sheet F    also write a contact sheet with
                                                  the true outlines drawn, to F

Needs numpy and opencv-python(-headless); --pictures also needs scikit-image.

The frames are a function of the pictures and of --seed alone, for one version
of numpy and OpenCV (another version may resample or compress differently by a
grey level; the truth does not depend on either).

Coordinates: a pixel's centre has integer coordinates, in the object pictures
and in the frames; x to the right, y down. A homography in truth.json is nine
numbers in row order with the last one 1, and maps (x, y, 1) of the object
picture to the frame.
"""

import argparse
import json
import math
import os

import cv2
import numpy as np

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
PICTURES = os.path.join(ROOT, "assets", "pictures")
SEQUENCE = os.path.join(ROOT, "assets", "sequence")

FRAMES = 48
WIDTH, HEIGHT = 640, 480
QUALITY = 88
FOCAL = 600.0            # camera's focal length in pixels
UNIT = 420.0             # scale 1: the picture's longer side is 420 px, seen flat
NOISE = 3.0              # standard deviation of the sensor noise
MARGIN = 0.025           # white paper around the print, of the longer side
SUPER = 2                # supersampling of the rendering

# How each object is held, at key frames; between them the path is smooth.
#   frame, centre x, centre y, scale, roll, yaw, pitch (degrees)
# A list is one stay before the camera: its first and last key frames are the
# first and last frame in which the object is there.
PATHS = {
    "astronaut": [
        [
            (0, 300, 245, 0.62, -8, 0, 5),
            (4, 332, 232, 0.95, 12, -18, 8),
            (8, 322, 240, 1.20, 50, 10, -12),
            (12, 245, 236, 0.82, 118, 34, 4),
            (15, 175, 212, 0.60, 160, 24, 26),
            (18, 160, 222, 0.52, 182, -4, 36),
            (21, 172, 248, 0.48, 205, -25, 20),
        ],
        [
            (34, 478, 160, 0.35, 215, 28, -10),
            (38, 486, 205, 0.42, 250, 4, -39),
            (42, 436, 244, 0.62, 300, -38, -4),
            (45, 352, 240, 0.86, 338, -18, 14),
            (47, 322, 236, 0.98, 354, 2, 8),
        ],
    ],
    "coffee": [
        [
            (15, 508, 250, 0.42, 0, 12, -6),
            (18, 484, 262, 0.60, 32, -20, 18),
            (21, 470, 232, 0.62, 62, 8, 30),
        ],
        [
            (28, 330, 250, 0.72, 90, 20, 4),
            (31, 318, 240, 1.20, 142, -6, 22),
            (34, 190, 252, 0.72, 212, -32, 8),
            (38, 158, 262, 0.50, 290, 6, 38),
            (43, 118, 246, 0.36, 366, 26, 0),
        ],
    ],
}

# Where the camera looks on the wall behind: frame, x, y of the view's centre,
# turn (degrees), zoom. The quick pan is where neither object is there.
CAMERA = [
    (0, 420, 350, -2, 1.00),
    (8, 455, 372, 2, 1.04),
    (15, 540, 360, 0, 1.00),
    (21, 640, 350, -3, 0.98),
    (24, 1180, 362, 1, 1.00),
    (28, 1760, 350, 2, 1.02),
    (36, 1860, 368, -2, 1.00),
    (47, 2010, 352, 1, 1.03),
]

# A sleeve reaching across: frame -> (hand x, y, elbow x, y), half widths of the
# hand's and the elbow's end.
SLEEVE = {
    6: (465, 350, 750, 620, 46, 74),
    7: (355, 268, 720, 590, 50, 78),
    8: (335, 252, 710, 580, 50, 78),
    9: (440, 335, 745, 620, 46, 74),
    30: (220, 375, 80, 650, 40, 66),
    31: (305, 240, 120, 620, 46, 70),
    32: (240, 330, 80, 640, 42, 66),
    40: (500, 205, 720, 20, 26, 50),
    41: (468, 222, 710, 40, 28, 52),
}


def prepare_pictures():
    """Make assets/pictures from the files inside the scikit-image package."""
    import skimage

    data = os.path.join(os.path.dirname(skimage.__file__), "data")
    os.makedirs(PICTURES, exist_ok=True)

    def load(name, grey=False):
        flag = cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_COLOR
        return cv2.imread(os.path.join(data, name), flag)

    hubble = load("hubble_deep_field.jpg")[136:736, 100:900]
    made = {
        "astronaut": load("astronaut.png"),
        "coffee": load("coffee.png"),
        "chelsea": load("chelsea.png"),
        "rocket": load("rocket.jpg"),
        "hubble": cv2.resize(hubble, (640, 480), interpolation=cv2.INTER_AREA),
        "brick": load("brick.png", True),
        "gravel": load("gravel.png", True),
    }
    for name, image in made.items():
        path = os.path.join(PICTURES, name + ".jpg")
        cv2.imwrite(path, image, [cv2.IMWRITE_JPEG_QUALITY, 92])


def picture(name):
    image = cv2.imread(os.path.join(PICTURES, name + ".jpg"), cv2.IMREAD_COLOR)
    if image is None:
        raise SystemExit("no picture " + name + " (try --pictures)")
    return image


def smooth(keys, t):
    """Cubic Hermite through the keys (t first), slopes from the neighbours."""
    keys = np.asarray(keys, dtype=np.float64)
    times, values = keys[:, 0], keys[:, 1:]
    slopes = np.zeros_like(values)
    slopes[1:-1] = (values[2:] - values[:-2]) / (times[2:] - times[:-2])[:, None]
    i = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2))
    step = times[i + 1] - times[i]
    u = (t - times[i]) / step
    return (
        (1 + 2 * u) * (1 - u) ** 2 * values[i]
        + u * (1 - u) ** 2 * step * slopes[i]
        + u * u * (3 - 2 * u) * values[i + 1]
        + u * u * (u - 1) * step * slopes[i + 1]
    )


class Wander:
    """A smooth seeded curve that reaches both ends of its range."""

    def __init__(self, rng, low, high, periods):
        t = np.arange(FRAMES) / FRAMES
        curve = np.zeros(FRAMES)
        for period in periods:
            curve += np.sin(2 * np.pi * (t * period + rng.random())) / len(periods)
        curve -= curve.min()
        self.values = low + (high - low) * curve / curve.max()

    def __getitem__(self, frame):
        return float(self.values[frame])


def homography(size, x, y, scale, roll, yaw, pitch):
    """Picture pixels to frame pixels, for a flat picture before a pinhole."""
    w, h = size
    longer = max(w, h)
    a, b, c = (math.radians(v) for v in (roll, yaw, pitch))
    rz = np.array([[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]])
    ry = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    rx = np.array([[1, 0, 0], [0, math.cos(c), -math.sin(c)], [0, math.sin(c), math.cos(c)]])
    r = ry @ rx @ rz
    mid = np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2])
    depth = FOCAL / (scale * UNIT)
    centre = (np.array([x, y]) - mid) * depth / FOCAL
    pose = np.column_stack([r[:, 0], r[:, 1], [centre[0], centre[1], depth]])
    lens = np.array([[FOCAL, 0, mid[0]], [0, FOCAL, mid[1]], [0, 0, 1.0]])
    plane = np.array(
        [[1 / longer, 0, -(w - 1) / 2 / longer], [0, 1 / longer, -(h - 1) / 2 / longer], [0, 0, 1]]
    )
    m = lens @ pose @ plane
    return m / m[2, 2]


def tilt(yaw, pitch):
    return math.degrees(math.acos(math.cos(math.radians(yaw)) * math.cos(math.radians(pitch))))


def corners(size, m):
    """The picture's outline (its pixels' outer edges) in the frame."""
    w, h = size
    box = np.array([[[-0.5, -0.5], [w - 0.5, -0.5], [w - 0.5, h - 0.5], [-0.5, h - 0.5]]])
    return cv2.perspectiveTransform(box, m)[0]


def enlarge(k):
    """Pixel coordinates after the image is made k times as large."""
    return np.array([[k, 0, (k - 1) / 2], [0, k, (k - 1) / 2], [0, 0, 1.0]])


def resized(image, k):
    """The image shrunk by about k, and the exact map to its coordinates."""
    h, w = image.shape[:2]
    nw, nh = max(1, round(w * k)), max(1, round(h * k))
    small = cv2.resize(image, (nw, nh), interpolation=cv2.INTER_AREA)
    fx, fy = nw / w, nh / h
    return small, np.array([[fx, 0, (fx - 1) / 2], [0, fy, (fy - 1) / 2], [0, 0, 1.0]])


def wall():
    """One long background: brick, the cat as a mural, gravel, the deep field."""
    high = 720

    def tinted(name, bgr):
        grey = picture(name).astype(np.float32)
        return np.clip(grey * np.float32(bgr), 0, 255).astype(np.uint8)

    def fit(image):
        w = round(image.shape[1] * high / image.shape[0])
        return cv2.resize(image, (w, high), interpolation=cv2.INTER_CUBIC)

    parts = [
        fit(tinted("brick", (0.72, 0.88, 1.20))),
        fit(picture("chelsea"))[:, :700],
        fit(tinted("gravel", (0.92, 0.98, 1.02))),
        fit(picture("hubble")),
    ]
    return np.hstack(parts)


def paste(canvas, image, m):
    """Lay the printed picture on the supersampled canvas, with a faint shadow."""
    h, w = image.shape[:2]
    pad = round(MARGIN * max(w, h))
    sheet = cv2.copyMakeBorder(image, pad, pad, pad, pad, cv2.BORDER_CONSTANT, value=(236, 240, 240))
    shift = np.array([[1, 0, -pad], [0, 1, -pad], [0, 0, 1.0]])
    onto = enlarge(SUPER) @ m
    # shrink first, so that the warp does not skip pixels
    area = cv2.contourArea(corners((w, h), onto).astype(np.float32))
    k = min(1.0, 1.25 * math.sqrt(area / (w * h)))
    small, to_small = resized(sheet, k)
    final = onto @ shift @ np.linalg.inv(to_small)
    size = (canvas.shape[1], canvas.shape[0])
    warped = cv2.warpPerspective(
        small, final, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    ).astype(np.float32)
    solid = np.full(small.shape[:2], 255, np.uint8)
    mask = cv2.warpPerspective(solid, final, size, flags=cv2.INTER_LINEAR).astype(np.float32) / 255
    drop = cv2.warpAffine(mask, np.float32([[1, 0, 9 * SUPER], [0, 1, 12 * SUPER]]), size)
    drop = cv2.GaussianBlur(drop, (0, 0), 8 * SUPER)
    canvas *= (1 - 0.35 * drop)[:, :, None]
    canvas += (warped - canvas) * mask[:, :, None]


def sleeve(canvas, shape, cloth):
    """An arm in a rough sleeve, from beyond the frame's edge to the hand."""
    ax, ay, bx, by, ra, rb = (v * float(SUPER) for v in shape)
    ys, xs = np.mgrid[0 : canvas.shape[0], 0 : canvas.shape[1]].astype(np.float32)
    dx, dy = bx - ax, by - ay
    length = dx * dx + dy * dy
    along = np.clip(((xs - ax) * dx + (ys - ay) * dy) / length, 0, 1)
    across = ((xs - ax) * dy - (ys - ay) * dx) / math.sqrt(length)
    away = np.hypot(xs - ax - along * dx, ys - ay - along * dy)
    radius = ra + (rb - ra) * along
    mask = np.clip(radius - away + 0.5, 0, 1)
    round_ = np.sqrt(np.clip(1 - (away / radius) ** 2, 0.05, 1)) * (1 + 0.25 * across / radius)
    skin = np.float32((120, 155, 210))
    reach = (xs - ax) * dx + (ys - ay) * dy
    hand = (reach < length * 0.14)[:, :, None]
    cloth = cloth[: canvas.shape[0], : canvas.shape[1], None].astype(np.float32)
    body = np.where(hand, skin, cloth * np.float32((0.95, 0.62, 0.45)))
    body = body * round_[:, :, None]
    canvas += (body - canvas) * mask[:, :, None]


def inside(quad):
    """The share of the outline's area that is within the frame."""
    frame = np.float32([[-0.5, -0.5], [WIDTH - 0.5, -0.5], [WIDTH - 0.5, HEIGHT - 0.5], [-0.5, HEIGHT - 0.5]])
    quad = quad.astype(np.float32)
    return cv2.intersectConvexConvex(quad, frame)[0] / cv2.contourArea(quad)


def main():
    args = argparse.ArgumentParser()
    args.add_argument("--seed", type=int, default=1)
    args.add_argument("--pictures", action="store_true")
    args.add_argument("--sheet")
    args = args.parse_args()
    cv2.setNumThreads(1)
    if args.pictures:
        prepare_pictures()
    os.makedirs(SEQUENCE, exist_ok=True)

    rng = np.random.Generator(np.random.PCG64(args.seed))
    gain = Wander(rng, 0.5, 1.2, (1.3, 2.9))
    blur = Wander(rng, 0.4, 1.2, (2.3, 5.1))
    cast = [Wander(rng, 0.9, 1.1, (0.9, 1.7)) for _ in range(3)]
    hand = {
        name: [Wander(rng, -r, r, (3.7, 6.3, 9.1)) for r in (3.0, 3.0, 2.0)] for name in PATHS
    }

    objects = {name: picture(name) for name in PATHS}
    behind = wall()
    cloth = cv2.resize(picture("gravel")[:, :, 0], (WIDTH * SUPER, HEIGHT * SUPER))
    truth, sheet, total = [], [], 0
    for frame in range(FRAMES):
        x, y, turn, zoom = smooth(CAMERA, frame)
        look = cv2.getRotationMatrix2D((x, y), turn, zoom * SUPER)
        look[:, 2] += np.array([WIDTH, HEIGHT]) * SUPER / 2 - (x, y)
        canvas = cv2.warpAffine(
            behind, look, (WIDTH * SUPER, HEIGHT * SUPER),
            flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101,
        ).astype(np.float32)

        held, quads, notes = {}, {}, []
        for name in PATHS:
            held[name] = None
            h, w = objects[name].shape[:2]
            for stay in PATHS[name]:
                if stay[0][0] <= frame <= stay[-1][0]:
                    x, y, scale, roll, yaw, pitch = smooth(stay, frame)
                    shake = [wander[frame] for wander in hand[name]]
                    m = homography((w, h), x + shake[0], y + shake[1], scale, roll + shake[2], yaw, pitch)
                    held[name] = m
                    quads[name] = corners((w, h), m)
                    notes.append(
                        f"{name} scale {scale:.2f} roll {roll:.0f} tilt {tilt(yaw, pitch):.0f}"
                        f" inside {inside(quads[name]):.2f}"
                    )
                    if inside(quads[name]) < 0.7:
                        raise SystemExit(f"frame {frame}: {name} is too far out")
        if len(quads) == 2:
            a, b = (q.astype(np.float32) for q in quads.values())
            both = cv2.intersectConvexConvex(a, b)[0] / min(cv2.contourArea(a), cv2.contourArea(b))
            notes.append(f"overlap {both:.3f}")
            if both > 0.03:
                raise SystemExit(f"frame {frame}: the objects overlap by {both:.3f}")

        for name in ("coffee", "astronaut"):
            if held[name] is not None:
                paste(canvas, objects[name], held[name])
        if frame in SLEEVE:
            sleeve(canvas, SLEEVE[frame], cloth)
            notes.append("sleeve")

        image = cv2.resize(canvas, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
        image = cv2.GaussianBlur(image, (0, 0), blur[frame])
        image *= np.float32([c[frame] * gain[frame] for c in cast])
        image += rng.normal(0, NOISE, image.shape).astype(np.float32)
        image = np.clip(np.rint(image), 0, 255).astype(np.uint8)
        file = f"{frame:04d}.jpg"
        path = os.path.join(SEQUENCE, file)
        cv2.imwrite(path, image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        total += os.path.getsize(path)
        truth.append(
            {
                "image": file,
                "objects": {
                    name: None if m is None else [float(f"{v:.12g}") for v in m.ravel()]
                    for name, m in held.items()
                },
            }
        )
        print(frame, f"gain {gain[frame]:.2f} blur {blur[frame]:.2f}", "; ".join(notes))

        if args.sheet:
            for colour, quad in zip(((0, 255, 0), (255, 255, 0)), quads.values()):
                points = np.rint(quad * 16).astype(np.int32)
                cv2.polylines(image, [points], True, colour, 2, cv2.LINE_AA, 4)
                cv2.circle(image, tuple(int(v) for v in points[0]), 8 * 16, colour, 2, cv2.LINE_AA, 4)
            cv2.putText(image, str(frame), (8, 30), cv2.FONT_HERSHEY_SIMPLEX, 1, (0, 0, 255), 2)
            sheet.append(cv2.resize(image, (WIDTH // 2, HEIGHT // 2), interpolation=cv2.INTER_AREA))

    with open(os.path.join(SEQUENCE, "truth.json"), "w") as out:
        out.write("[\n" + ",\n".join(json.dumps(entry) for entry in truth) + "\n]\n")
    if args.sheet:
        rows = [np.hstack(sheet[i : i + 6]) for i in range(0, FRAMES, 6)]
        cv2.imwrite(args.sheet, np.vstack(rows))
    print("frames:", total, "bytes")


if __name__ == "__main__":
    main()
