"""Judges outlines against the truth, scores against what they promise, and counts.

Plain arithmetic: needs no package. An outline is a list of four corners, (x, y) in frame
px each: where (0, 0), (w, 0), (w, h) and (0, h) of a picture of w x h px are seen. A
pixel's centre has integer coordinates.
"""

import enum
import math
from dataclasses import dataclass

FOUND = 0.10  # largest error of an outline that is right, as a share of the object's size
TIGHT = 0.03  # largest error of an outline that is tight
THRESHOLD = 0.8  # least score that the command reports unless it is told otherwise


@dataclass
class Detection:
    """One outline, how sure the detector is of it, and how much of the object it sees (0 to 1)."""

    score: float
    corners: list
    visible: float = 1.0


@dataclass
class Search:
    """What a detector reports of one frame: detections, best first, and the time it took."""

    detections: list
    ms: float


class Verdict(enum.Enum):
    """What a detection is worth."""

    TIGHT = "tight"
    FOUND = "found"
    WRONG_PLACE = "wrong place"
    ABSENT = "absent"

    @property
    def right(self):
        """Whether the outline is at the object's place."""
        return self in (Verdict.TIGHT, Verdict.FOUND)


# ------------------------------------------------------------------ outlines


def outline(homography, size):
    """The outline of a picture of `size` px (width, height) in the frame.

    `homography` maps picture px to frame px: nine numbers or three rows of three.
    """
    rows = [list(row) if hasattr(row, "__len__") else [row] for row in homography]
    numbers = [float(v) for row in rows for v in row]
    if len(numbers) != 9:
        raise ValueError(f"a homography has nine numbers, not {len(numbers)}")
    a, b, c, d, e, f, g, h, i = numbers
    w, ht = size
    corners = []
    for x, y in ((0, 0), (w, 0), (w, ht), (0, ht)):
        z = g * x + h * y + i
        corners.append(((a * x + b * y + c) / z, (d * x + e * y + f) / z))
    return corners


def area(corners):
    """The area of a polygon, px^2."""
    following = [*corners[1:], corners[0]]
    twice = sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in zip(corners, following, strict=True))
    return abs(twice) / 2


def corner_error(corners, truth):
    """The mean distance of the corners from the true ones, px."""
    return sum(math.dist(a, b) for a, b in zip(corners, truth, strict=True)) / len(truth)


def relative_error(corners, truth):
    """The corner error as a share of the object's size, the square root of its area."""
    return corner_error(corners, truth) / math.sqrt(area(truth))


def mean_shift(corners, truth):
    """The mean of the corners' x and y, less that of the true ones, px."""
    pairs = list(zip(corners, truth, strict=True))
    return tuple(sum(a[i] - b[i] for a, b in pairs) / len(pairs) for i in (0, 1))


def judge(detections, truth):
    """A verdict for each detection of one object, best first.

    `truth` is the object's outline, None where the frame does not show it. The first
    outline at the true place is right; a second one there is wrong.
    """
    verdicts, seen = [], False
    for detection in detections:
        if truth is None:
            verdicts.append(Verdict.ABSENT)
            continue
        error = relative_error(detection.corners, truth)
        if seen or error >= FOUND:
            verdicts.append(Verdict.WRONG_PLACE)
            continue
        seen = True
        verdicts.append(Verdict.TIGHT if error < TIGHT else Verdict.FOUND)
    return verdicts


def is_found(detections, truth):
    """Whether the best detection is at the object's place."""
    return any(verdict.right for verdict in judge(detections[:1], truth))


def shares_of(looks, least, count):
    """For each visible share in `least`, the share of looks that count when what shows less is left out.

    `looks` are (detections, truth) pairs, and `count` takes both.
    """
    shares = []
    for visible in least:
        counted = (count([d for d in found if d.visible >= visible], truth) for found, truth in looks)
        shares.append(sum(map(bool, counted)) / len(looks))
    return shares


# ------------------------------------------------------------------ scores


@dataclass
class Bin:
    """Detections whose scores lie from `low` to `high`."""

    low: float
    high: float
    count: int
    mean_score: float
    share_right: float

    @property
    def gap(self):
        """The distance between what the scores promise and what is right."""
        return abs(self.mean_score - self.share_right)


def reliability(scored, bins, weights=None):
    """The bins of (score, right) pairs, lowest first, without the empty ones.

    A score on a bin's lower edge belongs to it; 1 belongs to the last bin. Means and shares are
    weighted where weights are given.
    """
    members = [[] for _ in range(bins)]
    for (score, right), weight in zip(scored, weights if weights is not None else [1] * len(scored), strict=True):
        members[min(int(score * bins), bins - 1)].append((score, right, weight))
    table = []
    for i, inside in enumerate(members):
        weight = sum(w for _, _, w in inside)
        if inside:
            mean, share = (sum(row[k] * row[2] for row in inside) / weight for k in (0, 1))
            table.append(Bin(i / bins, (i + 1) / bins, len(inside), mean, share))
    return table


def mean_gap(bins):
    """The mean gap over all detections of the bins; 0 when there are none."""
    count = sum(b.count for b in bins)
    return sum(b.count * b.gap for b in bins) / count if count else 0.0


def upper_limit(count):
    """The count that is not exceeded with 95 % certainty when `count` were seen.

    The one-sided limit of a Poisson distribution: 3.0 when nothing was seen, Byar's
    approximation otherwise.
    """
    if count == 0:
        return 3.0
    k = count + 1
    return k * (1 - 1 / (9 * k) + 1.645 / (3 * math.sqrt(k))) ** 3


def histogram(scores, threshold, bins=20):
    """(low, high, count) of each bin of scores from `threshold` to 1."""
    rows = []
    for b in range(bins):
        low, high = max(b / bins, threshold), (b + 1) / bins
        if low < high:
            last = b == bins - 1
            rows.append((low, high, sum(low <= s < high or (last and s == 1) for s in scores)))
    return rows
