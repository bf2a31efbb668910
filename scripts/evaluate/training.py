"""What the score is fitted to: properties of detections in frames whose truth is known.

Objects are rendered in twelve conditions, half of the frames of most with glare, shadows and the like.
Each is looked for in its frames, and so are two other objects. Members of the families of
look-alikes are looked for in their own frames, also hidden, and in those of their siblings.
host/examples/scrutiny.rs searches, and tells the properties.
"""

import itertools
import json
import os
import subprocess
import sys
from dataclasses import dataclass, field

import cv2
import disturbances
import numpy as np
from detectors import Refused
from frames import Renderer, Studio, build_example, build_renderer
from lookalikes import FAMILIES, MEMBERS, siblings
from pictures import read_picture
from posters import poster, read_textures
from scoring import Detection, judge

MIXED = {"tilt": (0.0, 45.0), "light": (0.3, 1.3), "noise": (1.0, 6.0), "blur": (0.3, 2.5), "cast": (0.0, 0.2)}
CONDITIONS = {
    "plain": {**MIXED, "scale": (0.25, 1.5)},
    "far": {**MIXED, "scale": (0.13, 0.3)},
    "near": {**MIXED, "scale": (1.8, 3.2)},
    "dark": {**MIXED, "scale": (0.4, 1.2), "light": (0.05, 0.25)},
    "blurred": {**MIXED, "scale": (0.4, 1.2), "blur": (2.5, 5.0)},
    "behind a box": {**MIXED, "scale": (0.5, 1.1), "occlusion": (0.25, 0.6)},
    "mostly hidden": {**MIXED, "scale": (0.5, 1.1), "occlusion": (0.45, 0.7)},
    "behind something": {**MIXED, "scale": (0.5, 1.2)},
    "half hidden": {"scale": (0.5, 1.1), "tilt": (0.0, 20.0), "light": (0.6, 1.3), "noise": (3.0, 5.0)},
    "bent": {**MIXED, "scale": (0.6, 1.4)},
    "crumpled": {**MIXED, "scale": (0.5, 1.4)},
    "worn": {**MIXED, "scale": (0.5, 1.4)},
}
NOT_FLAT = {"bent": disturbances.bend, "crumpled": disturbances.crumple, "worn": disturbances.wear}
MEMBER = {"scale": (0.5, 1.1), "tilt": (0.0, 25.0), "light": (0.4, 1.25), "noise": (1.0, 5.0), "cast": (0.0, 0.1)}
STRANGERS = 2  # other objects that are looked for in the frames of an object


@dataclass
class Look:
    """A model that is looked for in a frame, the object's outline there or None, and what the look is for."""

    model: str
    frame: str
    truth: list
    kind: str


@dataclass
class Samples:
    """Detections: properties, whether they are right, kind, group, number of the look, and present score."""

    properties: list = field(default_factory=list)
    right: list = field(default_factory=list)
    kinds: list = field(default_factory=list)
    groups: list = field(default_factory=list)
    looks: list = field(default_factory=list)
    scores: list = field(default_factory=list)
    total: int = 0  # looks so far

    def add(self, looks, group):
        """Searches, and adds every detection. A fit knows all of a group, or nothing of it."""
        requests = "".join(json.dumps({"model": x.model, "frame": os.path.abspath(x.frame)}) + "\n" for x in looks)
        run = subprocess.run(
            [build_example("scrutiny")], input=requests, stdout=subprocess.PIPE, text=True, check=False
        )
        if run.returncode:
            sys.exit("the example scrutiny has ended: standard error says why")
        seen = set()
        for told in map(json.loads, run.stdout.splitlines()):
            # A search may come to a pose more than once.
            pose = (told["pair"], told["object"], *itertools.chain(*told["corners"]))
            if pose in seen:
                continue
            seen.add(pose)
            look = looks[told["pair"]]
            (verdict,) = judge([Detection(told["score"], told["corners"])], look.truth)
            self.properties.append(told["properties"])
            self.right.append(verdict.right)
            self.kinds.append(look.kind if verdict.right or look.truth is None else "elsewhere")
            self.groups.append(group)
            self.looks.append(self.total + told["pair"])
            self.scores.append(told["score"])
        self.total += len(looks)


class Set:
    """Renders frames and searches them; holds what came of it."""

    def __init__(self, args, folder, keygraph, pictures, progress):
        self.seed, self.folder, self.keygraph, self.pictures = args.seed, folder, keygraph, pictures
        self.progress, self.samples = progress, Samples()

    def studio(self, backgrounds):
        """A studio of its own for each object and group: a renderer keeps all pictures that it has read."""
        return Studio(self.folder, backgrounds, self.seed, Renderer([build_renderer()]))

    def search(self, looks, group):
        """Looks for what can be trained, and deletes the frames."""
        known = [look for look in looks if look.model]
        self.samples.add(known, group)
        for path in {look.frame for look in looks}:
            os.remove(path)
        self.progress.add(len(looks))

    def model(self, picture):
        """The path of the picture's model; None when it cannot be trained."""
        try:
            return self.keygraph.model(picture)[0]
        except Refused:
            return None

    def given(self, picture, frames):
        """Looks for an object in frames that were given, which stay."""
        looks = [Look(self.model(picture), f.path, f.quads[picture.digest], "real") for f in frames]
        self.samples.add([look for look in looks if look.model], picture.name)
        self.progress.add(len(looks))

    def object(self, picture, others, frames):
        """The frames of one object, in which it and some of the `others` are looked for."""
        behind, looks = [p for p in self.pictures if p.digest != picture.digest], []
        with self.studio(behind) as studio:
            for condition, n in itertools.product(CONDITIONS, range(frames)):
                rng = np.random.default_rng((self.seed, *picture.name.encode(), *condition.encode(), n))
                frame, quad = shoot(studio, rng, picture, condition, n)
                looks.append(Look(self.model(picture), frame.path, quad, condition))
                absent = [o for o in others if o.digest not in frame.may_show]
                for i in rng.permutation(len(absent))[:STRANGERS]:
                    looks.append(Look(self.model(absent[i]), frame.path, None, "unlike"))
        self.search(looks, picture.name)

    def family(self, family, group):
        """The frames of one group of look-alikes, in which all members are looked for."""
        members, backgrounds = siblings(family, self.pictures, self.seed, group, self.folder)
        looks = []
        with self.studio(backgrounds) as studio:
            for index, shown in enumerate(members):
                rng = np.random.default_rng((self.seed, *family.encode(), group, index))
                frame, quad = shoot_member(studio, rng, shown, family, group, index)
                own = Look(self.model(shown), frame.path, quad, "members")
                others = [Look(self.model(m), frame.path, None, family) for m in members if m is not shown]
                frame, quad = shoot_member(studio, rng, shown, family, group, index, hidden=True)
                looks += [own, *others, Look(self.model(shown), frame.path, quad, "hidden members")]
        self.search(looks, f"{family} {group}")


def shoot(studio, rng, picture, condition, n):
    """A frame of an object in one condition, and the object's outline in it."""
    other = studio.backgrounds[rng.integers(len(studio.backgrounds))]
    if condition in NOT_FLAT:
        flat = NOT_FLAT[condition](rng, picture.pixels, other.pixels)
        frame, quad = shoot_print(studio, flat, picture, condition, n)
    else:
        frame = studio.shoot(picture, CONDITIONS[condition], condition, n)
        quad = frame.quads[picture.digest]
    frame.may_show |= {picture.digest, other.digest}
    if condition == "half hidden":
        pixels = disturbances.cover_by_box(rng, cv2.imread(frame.path), np.float64(quad), other.pixels)
        cv2.imwrite(frame.path, pixels, [cv2.IMWRITE_JPEG_QUALITY, 90])
        return frame, quad
    hide = condition == "behind something"
    disturb(rng, frame.path, quad, other if hide else None, rng.random() < 0.5)
    return frame, quad


def shoot_print(studio, flat, picture, condition, n):
    """A frame of a print that is not flat, and the outline of the picture on it."""
    # The renderer reads each file once: every print needs a name of its own.
    path = os.path.join(studio.folder, f"{picture.name}-{condition}-{n}.png")
    cv2.imwrite(path, flat.pixels)
    ground = read_picture(path)
    frame = studio.shoot(ground, CONDITIONS[condition])
    os.remove(path)
    w, h = ground.size
    corners = np.float32([(0, 0), (w, 0), (w, h), (0, h)])
    there = cv2.getPerspectiveTransform(corners, np.float32(frame.quads[ground.digest]))
    return frame, cv2.perspectiveTransform(np.float64(flat.corners)[:, None], there)[:, 0].tolist()


def shoot_member(studio, rng, shown, family, group, index, hidden=False):
    """A frame of a member of a family, perhaps behind a box or something else, and its outline there."""
    box = {"occlusion": (0.25, 0.6)} if hidden and index % 2 else {}
    frame = studio.shoot(shown, {**MEMBER, **box}, family, group, index, *(["hidden"] if hidden else []))
    quad = frame.quads[shown.digest]
    front = studio.backgrounds[rng.integers(len(studio.backgrounds))] if hidden and not box else None
    disturb(rng, frame.path, quad, front, not hidden and rng.random() < 0.25)
    return frame, quad


def disturb(rng, path, quad, front, spoiled):
    """Changes a frame on disk: puts a part of the picture `front` before the object, and spoils the light."""
    if front is None and not spoiled:
        return
    pixels, quad = cv2.imread(path), np.float64(quad)
    if front is not None:
        pixels = disturbances.cover(rng, pixels, quad, front.pixels)
    if spoiled:
        pixels = disturbances.spoil(rng, pixels, quad)
    cv2.imwrite(path, pixels, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(70, 95))])


def draw_posters(n, folder):
    """`n` drawn objects."""
    drawn, textures = [], read_textures()
    for i in range(n):
        path = os.path.join(folder, f"poster-{i:02}.png")
        cv2.imwrite(path, poster(i, textures))
        drawn.append(read_picture(path))
    return drawn


def looks_of_families(groups):
    """How many looks `groups` groups of each family are."""
    return len(FAMILIES) * groups * MEMBERS * (MEMBERS + 1)
