"""The command `lenses`: cameras with known lenses are calibrated by a picture, and by OpenCV with a chessboard.

Views are rendered by tests/examples/lensed.rs: 640x480 px, the picture in the middle and near each corner, turned and
tilted at random. The chessboard takes the picture's place in the same views. What is told of a calibration: by how
much the focal length is off, and how far from where the lens really shows it the calibrated lens shows what is seen at
a corner of the frame; the greatest of four. A fisheye lens is asked 40 px from the corners: beyond, its views end.
"""

import os
import subprocess
import sys

import cv2
import numpy as np
import tables
from detectors import check_command
from places import PICTURES, ROOT

WIDTH, HEIGHT = 640, 480
# Focal length and coefficients: five are those of Brown and Conrady, four those of a fisheye lens.
LENSES = {
    "2.8 mm": (450.0, (-0.36, 0.14, 5e-4, -4e-4, -0.02)),
    "GC2145": (620.0, (0.09, -0.22, -1e-3, 1e-3, 0.08)),
    "fisheye of 170 degrees": (230.0, (0.02, -0.006, 0.002, -0.0004)),
}
MIDDLE = 316.0, 243.0
SQUARE = 1.005  # the focal length along y over that along x
VIEWS, SEEDS = 15, (11, 12, 13)
INNER = 8, 5  # inner corners of the chessboard
FIELD, MARGIN = 50, 31  # px
NEAR = 40  # px from a corner of the frame


def lenses(args, folder):
    """Calibrates each lens from each set of views, and prints the table."""
    check_command(args.keygraph)
    build = ["cargo", "build", "--release", "--quiet", "-p", "keygraph-tests", "--example", "lensed"]
    subprocess.run(build, cwd=ROOT, check=True)
    renderer = os.path.join(os.path.dirname(os.path.abspath(args.keygraph)), "examples", "lensed")
    board, model = (os.path.join(folder, n) for n in ("board.png", "model.kgm"))
    cv2.imwrite(board, chessboard())
    picture = os.path.join(PICTURES, "astronaut.jpg")
    subprocess.run([args.keygraph, "train", picture, "-o", model], check=True, stdout=subprocess.DEVNULL)
    out = []
    for name, (focal, k) in LENSES.items():
        truth = np.array([[focal, 0, MIDDLE[0]], [0, focal * SQUARE, MIDDLE[1]], [0, 0, 1]]), np.array(k)
        runs = []
        for seed in SEEDS:
            camera = ",".join(str(v) for v in (focal, focal * SQUARE, *MIDDLE)), ",".join(map(str, k))
            views = {}
            for what, more in (("picture", []), ("board", [board])):
                views[what] = os.path.join(folder, f"{what}-{focal:g}-{seed}")
                subprocess.run([renderer, views[what], str(VIEWS), str(seed), *camera, *more], check=True)
            ours = by_picture(args.keygraph, model, views["picture"], len(k) == 4)
            theirs = by_chessboard(views["board"], len(k) == 4)
            runs.append({"keygraph": told(truth, ours), "opencv": told(truth, theirs)})
        out.append({"name": name, "runs": runs})
    each = [run["keygraph"] for lens in out for run in lens["runs"] if "focal_percent" in run["keygraph"]]
    others = [run["opencv"] for lens in out for run in lens["runs"] if "focal_percent" in run["opencv"]]
    numbers = {
        "opencv": cv2.__version__,
        "views": VIEWS,
        "lenses": out,
        "worst": worst(each),
        "worst_opencv": worst(others),
    }
    print("\n".join(tables.lenses(numbers)))
    return numbers


def chessboard():
    """A chessboard with a white margin."""
    fields = np.indices((INNER[1] + 1, INNER[0] + 1)).sum(0) % 2
    black = np.kron(fields, np.ones((FIELD, FIELD), np.uint8)).astype(np.uint8)
    board = cv2.copyMakeBorder(black * 255, MARGIN, MARGIN, MARGIN, MARGIN, cv2.BORDER_CONSTANT, value=255)
    return cv2.cvtColor(board, cv2.COLOR_GRAY2BGR)


def by_picture(keygraph, model, views, is_fisheye):
    """What `keygraph calibrate` finds: views that were used, camera matrix and coefficients; None when it refuses."""
    written = os.path.join(views, "camera.yaml")
    run = [keygraph, "calibrate", "-m", model, views, "-o", written, *(["--fisheye"] if is_fisheye else [])]
    done = subprocess.run(run, capture_output=True, text=True)
    if done.returncode:
        print(f"{views}: {done.stderr.strip()}", file=sys.stderr)
        return None
    used = next(line.split()[0] for line in done.stdout.splitlines() if " views of " in line)
    file = cv2.FileStorage(written, cv2.FILE_STORAGE_READ)
    names = "camera_matrix", "distortion_coefficients"
    return int(used), *(file.getNode(name).mat() for name in names)


def by_chessboard(views, is_fisheye):
    """What OpenCV finds; None when it refuses."""
    points = np.zeros((1, INNER[0] * INNER[1], 3), np.float64)
    points[0, :, :2] = np.mgrid[: INNER[0], : INNER[1]].T.reshape(-1, 2)
    seen = []
    for name in sorted(os.listdir(views)):
        frame = cv2.imread(os.path.join(views, name), cv2.IMREAD_GRAYSCALE)
        is_found, corners = cv2.findChessboardCorners(frame, INNER)
        if is_found:
            stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
            seen.append(cv2.cornerSubPix(frame, corners, (4, 4), (-1, -1), stop).astype(np.float64).reshape(1, -1, 2))
    try:
        if is_fisheye:
            # OpenCV 5 has moved them.
            names = cv2 if hasattr(cv2, "CALIB_FIX_SKEW") else cv2.fisheye
            flags = names.CALIB_RECOMPUTE_EXTRINSIC | names.CALIB_FIX_SKEW
            of = [points] * len(seen), seen, (WIDTH, HEIGHT), np.eye(3), np.zeros(4)
            _, matrix, k, *_ = cv2.fisheye.calibrate(*of, flags=flags)
        else:
            pairs = [points[0].astype(np.float32)] * len(seen), [c[0].astype(np.float32) for c in seen]
            _, matrix, k, *_ = cv2.calibrateCamera(*pairs, (WIDTH, HEIGHT), None, None)
    except cv2.error as error:
        print(f"{views}: OpenCV refuses: {error.err}", file=sys.stderr)
        return None
    return len(seen), matrix, k


def told(truth, found):
    """How far a calibration is off."""
    if found is None:
        return {"views": 0}
    views, matrix, k = found
    near = NEAR if truth[1].size == 4 else 0
    at = [[x, y] for x in (near, WIDTH - 1 - near) for y in (near, HEIGHT - 1 - near)]
    at = np.array(at, np.float64).reshape(-1, 1, 2)
    off = shown(rays(at, *truth), matrix, k.ravel()) - at
    return {
        "views": views,
        "focal_percent": round(100 * max(abs(matrix[i, i] / truth[0][i, i] - 1) for i in (0, 1)), 3),
        "corner_px": round(float(np.linalg.norm(off, axis=2).max()), 2),
    }


def rays(at, matrix, k):
    """Where a camera looks at these places of its frame: places of the plane at distance 1."""
    if k.size == 4:
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 1000, 1e-10)
        return cv2.fisheye.undistortPoints(at, matrix, k, criteria=stop)
    # Versions of OpenCV differ in how often they repeat this; near a corner it takes more than five times.
    focal, middle = np.diag(matrix)[:2], matrix[:2, 2]
    found = (at - middle) / focal
    for _ in range(200):
        found = found + (at - shown(found, matrix, k)) / focal
    return found


def shown(rays, matrix, k):
    """Where a camera shows what is seen in these directions, px."""
    if k.size == 4:
        return cv2.fisheye.distortPoints(rays, matrix, k)
    points = cv2.convertPointsToHomogeneous(rays)
    return cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, k)[0]


def worst(runs):
    """The greatest errors of some calibrations, and the least at a corner."""
    corners = [run["corner_px"] for run in runs]
    return {
        "focal_percent": max(run["focal_percent"] for run in runs),
        "corner_px": max(corners),
        "least_corner_px": min(corners),
    }
