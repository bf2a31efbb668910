"""Tests of frames.py and detectors.py, with programs that stand in for the real ones."""

import contextlib
import io
import json
import math
import os
import random
import sys
import tempfile
import unittest
from dataclasses import dataclass

import frames
from detectors import Keygraph, Refused, try_search
from truth import Frame

# Answers each request with the pictures' paths, at 10, 20; ends with status 1 when told to.
RENDERER = """
import json, sys
for line in sys.stdin:
    request = json.loads(line)
    if request["noise"] > 100:
        sys.exit(1)
    open(request["out"], "w").write(line)
    pictures = [{"path": p["path"], "homography": [1, 0, 10, 0, 1, 20, 0, 0, 1]} for p in request["pictures"]]
    print(json.dumps({"out": request["out"], "pictures": pictures}), flush=True)
"""

# Trains any picture but "blank"; detects two outlines, the worse one first, in each frame
# that is named last but not in "missing".
COMMAND = """#!/usr/bin/env python3
import json, sys
if sys.argv[1] == "train":
    if "blank" in sys.argv[2]:
        sys.exit("too little to hold on to")
    print(json.dumps({"bytes": 1234}))
else:
    found = [{"score": s, "corners": [[s, 0], [1, 0], [1, 1], [0, 1]], "visible": s / 2} for s in (0.3, 0.9)]
    for frame in sys.argv[sys.argv.index("--threads") + 2:]:
        if "missing" not in frame:
            print(json.dumps({"detections": found, "time_ms": {"total": 2.5}}))
"""


@dataclass
class Picture:
    """A picture of 100x50 px whose digest is its name."""

    name: str
    size: tuple = (100, 50)

    @property
    def digest(self):
        return self.name

    @property
    def path(self):
        return f"{self.name}.jpg"


class Folder(unittest.TestCase):
    """A test with a folder of its own."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name

    def program(self, name, text):
        path = os.path.join(self.folder, name)
        with open(path, "w", encoding="utf-8") as out:
            out.write(text)
        os.chmod(path, 0o755)
        return path


class Factors(unittest.TestCase):
    def test_ranges_are_drawn_from_and_numbers_stay(self):
        rng = random.Random(1)
        for _ in range(100):
            values = frames.draw(rng, {"scale": 0.3, "light": (0.15, 0.3)})
            self.assertEqual(set(values), set(frames.PLAIN))
            self.assertEqual(values["scale"], 0.3)
            self.assertTrue(0.15 <= values["light"] <= 0.3)
            self.assertTrue(0 <= values["tilt"] <= 20)
        self.assertNotEqual(frames.draw(rng, {}), frames.draw(rng, {}))

    def test_hard_factors_are_two_conditions(self):
        rng = random.Random(1)
        sizes = {len(frames.hard_factors(rng)) for _ in range(100)}
        self.assertEqual(sizes, {1, 2, 3})

    def test_every_sweep_moves_a_factor(self):
        self.assertEqual(
            [s.factor for s in frames.SWEEPS], list(frames.PLAIN)[:3] + ["occlusion", "blur", "light", "noise", "cast"]
        )


class Studio(Folder):
    def studio(self, seed=1):
        renderer = frames.Renderer([sys.executable, self.program("renderer.py", RENDERER)])
        studio = frames.Studio(self.folder, [Picture(n) for n in "abcd"], seed, renderer)
        self.addCleanup(renderer.close)
        return studio

    def request(self, frame):
        with open(frame.path, encoding="utf-8") as text:
            return json.load(text)

    def test_the_truth_is_the_renderer_s(self):
        frame = self.studio().shoot(Picture("a"), {}, "key")
        self.assertEqual(frame.quads, {"a": [(10, 20), (110, 20), (110, 70), (10, 70)]})

    def test_what_is_behind_and_before_is_never_the_object(self):
        studio = self.studio()
        for n in range(20):
            frame = studio.shoot(Picture("a"), {"occlusion": 0.3}, n)
            request = self.request(frame)
            shown = request["pictures"][0]
            others = {request["background"], shown["hidden"]["by"]}
            self.assertEqual(len(others), 2)
            self.assertEqual({f"{d}.jpg" for d in frame.may_show - {"a"}}, {os.path.basename(p) for p in others})
            self.assertEqual(shown["hidden"]["share"], 0.3)

    def test_nothing_hides_where_nothing_is_to_be_hidden(self):
        self.assertNotIn("hidden", self.request(self.studio().shoot(Picture("a"), {}, "key"))["pictures"][0])

    def test_factors_become_the_request(self):
        factors = {"scale": 0.5, "rotation": 30, "tilt": 10, "blur": 2, "light": 0.3, "noise": 6, "cast": 0.1}
        request = self.request(self.studio().shoot(Picture("a"), factors, "key"))
        pose = request["pictures"][0]["pose"]
        self.assertEqual((pose["side_px"], pose["rotation_deg"], pose["tilt_deg"]), (210, 30, 10))
        self.assertEqual((request["blur_px"], request["light"], request["noise"]), (2, 0.3, 6))
        self.assertTrue(all(0.9 <= c <= 1.1 for c in request["cast"]))
        self.assertEqual(len(set(request["cast"])), 3)

    def test_a_frame_depends_on_the_seed_and_the_key_alone(self):
        shoot = lambda seed, key: self.request(self.studio(seed).shoot(Picture("a"), {}, key))  # noqa: E731
        self.assertEqual(shoot(1, "x"), shoot(1, "x"))
        self.assertNotEqual(shoot(1, "x"), shoot(1, "y"))
        self.assertNotEqual(shoot(1, "x"), shoot(2, "x"))

    def test_a_renderer_that_ends_is_told(self):
        studio = self.studio()
        with self.assertRaisesRegex(SystemExit, "exit status 1"):
            studio.shoot(Picture("a"), {"noise": 200}, "key")

    def test_frames_are_deleted(self):
        studio = self.studio()
        frame = studio.shoot(Picture("a"), {}, "key")
        studio.clear([frame])
        self.assertFalse(os.path.exists(frame.path))


class Command(Folder):
    def keygraph(self):
        return Keygraph("a label", self.program("keygraph", COMMAND), self.folder)

    def test_detections_come_best_first(self):
        search = self.keygraph().search(Picture("a"), [Frame("0.jpg"), Frame("1.jpg")])[1]
        self.assertEqual([d.score for d in search.detections], [0.9, 0.3])
        self.assertEqual(search.detections[0].corners[0], [0.9, 0])
        self.assertEqual(search.detections[0].visible, 0.45)
        self.assertEqual(search.ms, 2.5)

    def test_size_is_what_training_says(self):
        self.assertEqual(self.keygraph().size(Picture("a")), 1234)

    def test_another_threshold_needs_no_other_model(self):
        keygraph = self.keygraph()
        low = keygraph.thorough(0.0)
        self.assertEqual((keygraph.threshold, low.threshold), (0.8, 0.0))
        self.assertEqual((keygraph.options, low.options), ([], ["--thorough"]))
        self.assertIs(keygraph.model(Picture("a")), low.model(Picture("a")))

    def test_a_missing_line_is_told(self):
        with self.assertRaisesRegex(SystemExit, "1 lines for 2 frames"):
            self.keygraph().search(Picture("a"), [Frame("0.jpg"), Frame("missing.jpg")])

    def test_a_refused_picture_is_found_nowhere(self):
        keygraph = self.keygraph()
        with self.assertRaisesRegex(Refused, "too little to hold on to"):
            keygraph.size(Picture("blank"))
        ((frame, search),) = try_search(keygraph, Picture("blank"), [Frame("0.jpg")])
        self.assertEqual((frame.path, search.detections), ("0.jpg", []))
        self.assertTrue(math.isnan(search.ms))

    def test_no_command_is_told(self):
        with contextlib.redirect_stderr(io.StringIO()), self.assertRaisesRegex(SystemExit, "cargo build --release"):
            Keygraph("label", os.path.join(self.folder, "none"), self.folder)


if __name__ == "__main__":
    unittest.main()
