"""Tests of trees.py, fit.py and training.py."""

import contextlib
import io
import os
import re
import tempfile
import unittest
from unittest import mock

from packages import missing_for_tests
from places import BELIEF

SKIP = missing_for_tests(["cv2", "numpy", "matplotlib", "sklearn"])
if not SKIP:
    import fit
    import numpy as np
    import training
    import trees
    from training import Look, Samples
    from trees import Tree, Trees

# Answers as host/examples/scrutiny.rs does: one pose for each pair, at 0, 0 to 10, 10, which it comes to twice.
SCRUTINY = """#!/usr/bin/env python3
import json, sys
for at, line in enumerate(sys.stdin):
    corners = [[0, 0], [10, 0], [10, 10], [0, 10]]
    for _ in range(2):
        print(json.dumps({"pair": at, "object": 0, "score": 0.9, "corners": corners, "properties": [at] * 12}))
"""


@unittest.skipIf(SKIP, "packages are missing")
class Export(unittest.TestCase):
    def data(self, n=3000):
        """Rows of random properties, and whether they are right: mostly where two of them are large."""
        rng = np.random.default_rng(1)
        x = rng.integers(0, 256, (n, len(fit.DIRECTIONS)))
        return x, x[:, 0] + x[:, 11] + rng.normal(0, 60, n) > 260

    def test_integer_trees_score_as_the_model_does(self):
        x, right = self.data()
        model = fit.train(x, right, np.ones((2, len(x))), 37)
        score = trees.export(model)
        self.assertEqual(len(score.trees), 37)
        off = np.abs(score.score(x) - model.predict_proba(x)[:, 1])
        self.assertLess(off.max(), 0.06)
        self.assertLess(off.mean(), 0.01)

    def test_trees_fit_into_bytes(self):
        x, right = self.data()
        for tree in trees.export(fit.train(x, right, np.ones((2, len(x))), 10)).trees:
            self.assertEqual([len(v) for v in (tree.property, tree.limit, tree.leaf)], [7, 7, 8])
            self.assertTrue(
                all(0 <= p < len(fit.DIRECTIONS) for p in tree.property) and all(0 <= v <= 255 for v in tree.limit)
            )
            self.assertTrue(all(-127 <= v <= 127 for v in tree.leaf))

    def test_what_a_gray_picture_does_not_tell_is_learnt_from_copies(self):
        # What is right is told by its colour alone; nothing weighs but the copies of gray pictures.
        x, right = self.data()
        colour = list(fit.DIRECTIONS).index("colour")
        x[:, colour] = np.where(right, 200, 50)
        model = fit.train(x, right, np.stack((np.ones(len(x)), np.full(len(x), 100.0))), 20)
        gray = x.copy()
        gray[:, [list(fit.DIRECTIONS).index(name) for name in fit.GRAY_PICTURE[0]]] = 0
        told = trees.export(model).score(gray)
        self.assertGreater(told[right].mean(), 0.7)
        self.assertLess(told[~right].mean(), 0.3)

    def test_a_paler_picture_is_believed_as_well(self):
        # What is right has bright colours, what is wrong has none. `agree` and `votes` tell them apart as well.
        x, right = self.data()
        colour = list(fit.DIRECTIONS).index("colour")
        x[:, colour] = np.where(right, 200, 0)
        pale = x.copy()
        pale[right, colour] = 60
        told = trees.export(fit.train(x, right, np.ones((2, len(x))), 20)).score(pale)
        self.assertGreater(told[right].mean(), 0.7)
        self.assertLess(told[~right].mean(), 0.3)

    def test_what_is_held_back_is_scored_by_others(self):
        x, right = self.data(600)
        groups = np.array([f"object {i % 7}" for i in range(len(x))])
        held = fit.hold_back(x, right, groups, np.ones((2, len(x))), 10)
        self.assertGreater(np.mean((held(0) > 0.5) == right), 0.7)
        self.assertTrue((held(32) > held(0)).all())

    def test_a_node_leads_to_the_second_when_it_is_above_its_limit(self):
        tree = Tree([0, 1, 1, 2, 2, 2, 2], [9] * 7, list(range(0, 256, 32)))
        rows = np.array([[9, 9, 9], [9, 9, 10], [9, 10, 9], [10, 9, 9], [10, 10, 10]])
        odds = np.exp([0, 1, 2, 4, 7])
        self.assertTrue(np.allclose(Trees(0, [tree]).score(rows), odds / (1 + odds)))


@unittest.skipIf(SKIP, "packages are missing")
class Core(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = os.path.join(folder.name, "belief.rs")
        with open(BELIEF, encoding="utf-8") as text:
            self.text = text.read()
        self.write(self.text)

    def write(self, text):
        with open(self.path, "w", encoding="utf-8") as out:
            out.write(text)

    def written(self, score):
        trees.write(score, self.path)
        with open(self.path, encoding="utf-8") as text:
            return text.read()

    def test_the_present_trees_are_written_as_they_are(self):
        rows = re.findall(r"Tree::new\(\[(.*)\], \[(.*)\], \[(.*)\]\)", self.text)
        present = [Tree(*([int(v) for v in part.split(", ")] for part in row)) for row in rows]
        bias = int(re.search(r"const BIAS: i32 = (-?\d+)", self.text)[1])
        self.assertEqual(self.written(Trees(bias, present)), self.text)

    def test_fewer_trees_and_another_bias_are_written(self):
        text = self.written(Trees(-5, [Tree([1] * 7, [2] * 7, [-3] * 8)] * 2))
        self.assertIn("const BIAS: i32 = -5;", text)
        self.assertIn("const TREES: [Tree; 2] = [\n    Tree::new([1, 1,", text)
        self.assertEqual(text.count("    Tree::new("), 2)

    def test_a_file_without_trees_is_told(self):
        self.write("fn main() {}")
        with self.assertRaisesRegex(SystemExit, "no table of trees"):
            trees.write(Trees(0, []), self.path)

    def test_the_properties_are_those_of_the_core(self):
        with open(os.path.join(os.path.dirname(BELIEF), "scrutiny.rs"), encoding="utf-8") as file:
            text = file.read()
        names = re.search(r"NAMES: \[&str; PROPERTIES\] =\s*\[(.*?)\];", text, re.DOTALL)[1]
        self.assertEqual(re.findall(r'"(\w+)"', names), list(fit.DIRECTIONS))
        plain = re.search(r"PLAIN_CELLS: \[u8; OF_CELLS\] = \[(.*?)\];", text)[1]
        self.assertEqual(tuple(map(int, plain.split(","))), fit.PLAIN)

    def test_every_factor_is_of_a_kind(self):
        kinds = {*training.CONDITIONS, *fit.FAMILIES, "members", "hidden members", "real", "unlike", "elsewhere"}
        self.assertLessEqual(set(fit.FACTORS), kinds)


@unittest.skipIf(SKIP, "packages are missing")
class Labels(unittest.TestCase):
    def test_a_detection_is_right_at_the_object_s_place_alone(self):
        there, elsewhere = ([(x, y), (x + 10, y), (x + 10, y + 10), (x, y + 10)] for x, y in ((0, 0.5), (50, 50)))
        looks = [Look("m", "f", quad, kind) for quad, kind in ((there, "far"), (elsewhere, "far"), (None, "unlike"))]
        samples = Samples()
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "scrutiny")
            with open(path, "w", encoding="utf-8") as out:
                out.write(SCRUTINY)
            os.chmod(path, 0o755)
            with mock.patch.object(training, "build_example", lambda name: path):
                samples.add(looks, "group")
        self.assertEqual(samples.right, [True, False, False])
        self.assertEqual(samples.kinds, ["far", "elsewhere", "unlike"])
        self.assertEqual([row[0] for row in samples.properties], [0, 1, 2])
        self.assertEqual((samples.looks, samples.total), ([0, 1, 2], 3))

    def test_the_best_score_of_a_look_decides(self):
        right, kinds, looks = [True, True, False], ["far", "far", "icons"], [0, 0, 1]
        samples = Samples(right=right, kinds=kinds, looks=looks)
        with contextlib.redirect_stdout(io.StringIO()) as out:
            fit.print_kinds(samples, {"new": [0.5, 0.9, 0.9], "old": [0.5, 0.6, 0.1]})
        self.assertIn("| far | 1 | 0.0 | 100.0 |", out.getvalue())
        self.assertIn("| icons | 1 | 100.0 | 0.0 |", out.getvalue())

    def test_kinds_weigh_as_the_roots_of_their_numbers(self):
        weights = fit.weigh(np.array(["plain"] * 4 + ["far"]))
        self.assertTrue(np.allclose(weights, [0.5] * 4 + [1]))


if __name__ == "__main__":
    unittest.main()
