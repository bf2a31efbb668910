"""The command `fit`: fits the score of the core to rendered frames, objects and look-alikes.

Gradient boosting of small trees, monotone in the properties of which more must never mean less.
What is printed of the fit is measured on objects and groups of look-alikes that it does not
know: a fifth of them at a time is held back.
"""

import math
import sys

import numpy as np
from alarms import print_reliability
from detectors import Keygraph
from lookalikes import FAMILIES, FEWEST, MEMBERS, MOSTLY_SHARED
from pictures import read_picture, read_pictures
from progress import Progress
from scoring import THRESHOLD
from sklearn.ensemble import HistGradientBoostingClassifier
from training import CONDITIONS, STRANGERS, Set, draw_posters, looks_of_families
from trees import Trees, export, read, write
from truth import gather

# The properties of core/src/detect/scrutiny.rs: 1 where more speaks for the object, -1 where it
# speaks against it, 0 where it depends on the others.
DIRECTIONS = {
    "agree": 1,
    "mid": -1,
    "foreign": 0,
    "tint": -1,
    "strange": 0,
    "colour": 0,
    "clump": 1,
    "dis": 0,
    "hidden": 0,
    "edge": 0,
    "inside": 0,
    "votes": 1,
}
# What a frame without colour cannot tell, and what a picture without colour cannot: then these are 0. The weight of a
# detection like that beside the one with its colour.
GRAY_FRAME = ("tint", "strange"), 0.3
GRAY_PICTURE = ("tint", "strange", "colour"), 0.1
# Few objects of the fit are pale, and many in the world: each detection counts again with a `colour` drawn from this
# range, where it is less than its own, at this weight. Paler still are maps, and what is half hidden is like them.
PALE = (35, 90), 1.5
# The core says so of what is seen plainly, in colour or not.
PLAIN = (255, 0, 0, 13, 0, 128, 255, 0, 0, 191)

# A kind weighs as the square root of its detections, times its factor, or 1. Families of which a third is shared and
# more show as much as what is half hidden, and weigh little: nothing can be learnt of them. So do wrong poses in frames
# that show the object, of which many are nearly right. Heavy blur, worn prints and real frames are rare here, and
# must be found.
HIDDEN = dict.fromkeys(("behind a box", "mostly hidden", "behind something", "half hidden"), 36.0)
FACTORS = {
    **HIDDEN,
    **dict.fromkeys(("bent", "crumpled"), 2.0),
    **dict.fromkeys(("icons", "apps", "playing cards", "pages of print"), 1.5),
    **dict.fromkeys(("QR codes", "members"), 3.0),
    "real": 10.0,
    "worn": 12.0,
    "blurred": 16.0,
    "hidden members": 0.2,
    "elsewhere": 0.1,
    **dict.fromkeys((*MOSTLY_SHARED, "one brand", "sequels"), 0.15),
    "maps": 0.5,
}
FOLDS = 5
SECONDS = 0.15  # a look, with what is rendered and trained for it


def fit(args, folder):
    """Renders, fits, prints what the fit is worth, and writes it into the core when it is asked to."""
    if args.write:
        read(args.write)  # It is there, before the work is done.
    pictures = read_pictures(args.backgrounds, FEWEST, "backgrounds")
    objects, frames = gather(args.truth, read_pictures(args.objects, STRANGERS + 1, "objects"), read_picture)
    objects += draw_posters(args.posters, folder)
    samples = render(args, folder, pictures, objects, frames)
    x, right = np.array(samples.properties), np.array(samples.right)
    kinds, groups = np.array(samples.kinds), np.array(samples.groups)
    if right.all() or not right.any() or len(set(groups)) < FOLDS:
        sys.exit("too few detections to fit to: raise --frames, --groups or --posters")
    weights = weigh(kinds)
    # What is hidden and gray, and what is like it and gray, cannot be told apart: it weighs no more than others.
    gray = weights / np.array([HIDDEN.get(kind, 1.0) for kind in kinds])
    held = hold_back(x, right, groups, np.stack((weights, gray)), args.trees)
    score = export(train(x, right, np.stack((weights, gray)), args.trees))
    print(f"{len(x):,} detections, {right.sum():,} right. BIAS as fitted: {score.bias}\n")
    print("Held back from the fit, each kind with its weight, BIAS as fitted:\n")
    print_reliability(list(zip(held(0), right, strict=True)), args.bins, weights)
    print_kinds(samples, {f"held back, BIAS {args.bias:+}": held(args.bias), "present trees": samples.scores})
    score.bias += args.bias
    if args.write:
        write(score, args.write)
        print(f"wrote {len(score.trees)} trees and a BIAS of {score.bias} into {args.write}", file=sys.stderr)


def render(args, folder, pictures, objects, frames):
    """Renders and searches all frames."""
    shown = {o.digest: [f for f in frames if f.quads.get(o.digest) is not None] for o in objects}
    looks = len(objects) * len(CONDITIONS) * args.frames * (1 + STRANGERS) + looks_of_families(args.groups)
    looks += sum(map(len, shown.values()))
    models = len(objects) + len(FAMILIES) * args.groups * MEMBERS
    print(
        f"{looks:,} looks, some {looks * SECONDS / 60:.0f} minutes; {models:,} models of 2 MB in {folder}. "
        "A first look at the command: --frames 2 --groups 1 --posters 2",
        file=sys.stderr,
    )
    keygraph = Keygraph("fit", args.keygraph, folder, args.train)
    work = Set(args, folder, keygraph, pictures, Progress(looks, "looks"))
    for picture in objects:
        if shown[picture.digest]:
            work.given(picture, shown[picture.digest])
        work.object(picture, [o for o in objects if o.digest != picture.digest], args.frames)
    for family in FAMILIES:
        for group in range(args.groups):
            work.family(family, group)
    return work.samples


def weigh(kinds):
    """The weight of each detection."""
    each = {kind: FACTORS.get(kind, 1.0) / math.sqrt(np.count_nonzero(kinds == kind)) for kind in set(kinds)}
    return np.array([each[kind] for kind in kinds])


def train(x, right, weights, trees):
    """The model of `trees` trees.

    `weights` are two rows: of the detections, and of what they would be of pictures without colour. What is right and
    what is wrong in the first row weigh as much as each other.
    """
    weights = np.where(right, weights * weights[0, ~right].sum() / weights[0, right].sum(), weights)
    closely = (x[:, : len(PLAIN)] != PLAIN).any(1)
    near, colour = x[closely], np.random.default_rng(1).integers(*PALE[0], closely.sum())
    copies = (
        (lowered(near, GRAY_FRAME[0], 0), GRAY_FRAME[1] * weights[0]),
        (lowered(near, GRAY_PICTURE[0], 0), GRAY_PICTURE[1] * weights[1]),
        (lowered(near, ("colour",), colour), PALE[1] * weights[0]),
    )
    sets = [(x, right, weights[0]), *((rows, right[closely], weight[closely]) for rows, weight in copies)]
    x, right, weights = (np.concatenate(part) for part in zip(*sets, strict=True))
    model = HistGradientBoostingClassifier(
        max_iter=trees,
        max_depth=3,
        learning_rate=0.15,
        min_samples_leaf=10,
        l2_regularization=2,
        monotonic_cst=list(DIRECTIONS.values()),
        early_stopping=False,
        random_state=1,
    )
    return model.fit(x, right, sample_weight=weights)


def lowered(x, names, most):
    """A copy of `x` whose properties `names` are `most` at most: a number, or one a row."""
    copy = x.copy()
    for name in names:
        column = list(DIRECTIONS).index(name)
        copy[:, column] = np.minimum(copy[:, column], most)
    return copy


def hold_back(x, right, groups, weights, trees):
    """The scores of all detections, each by trees that do not know its group, for a change of BIAS."""
    names = sorted(set(groups))
    fold = np.array([names.index(group) % FOLDS for group in groups])
    known = [export(train(x[fold != i], right[fold != i], weights[:, fold != i], trees)) for i in range(FOLDS)]

    def scores(bias):
        held = np.zeros(len(x))
        for i, score in enumerate(known):
            held[fold == i] = Trees(score.bias + bias, score.trees).score(x[fold == i])
        return held

    return scores


def print_kinds(samples, scores):
    """Prints for each kind in how many looks the object is lost, and in how many something wrong is believed.

    A search goes on after what is not believed, so that the best score of a look decides. `scores` are those
    of all detections, by what they are of.
    """
    best = {of: {} for of in scores}  # (right, kind) -> look -> score
    for of, each in scores.items():
        for score, right, kind, look in zip(each, samples.right, samples.kinds, samples.looks, strict=True):
            seen = best[of].setdefault((bool(right), kind), {})
            seen[look] = max(score, seen.get(look, 0.0))
    for title, right in (("object lost", True), ("wrong believed", False)):
        print(f"\n| at {THRESHOLD:g}: {title}, in 100 | looks with a detection | {' | '.join(scores)} |")
        print(f"| --- | --- |{' --- |' * len(scores)}")
        for key in sorted(key for key in best[next(iter(best))] if key[0] == right):
            rows = [list(of[key].values()) for of in best.values()]
            shares = (100 * sum((score >= THRESHOLD) != right for score in row) / len(row) for row in rows)
            print(f"| {key[1]} | {len(rows[0]):,} | {' | '.join(f'{share:.1f}' for share in shares)} |")
