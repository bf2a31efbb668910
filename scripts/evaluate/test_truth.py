"""Tests of truth.py: truth files of each form."""

import contextlib
import io
import json
import os
import tempfile
import unittest
from dataclasses import dataclass

import truth

SIZE = (100, 50)
UPRIGHT = [(10, 20), (110, 20), (110, 70), (10, 70)]
MOVE = [1, 0, 10, 0, 1, 20, 0, 0, 1]


@dataclass
class Picture:
    """A picture whose digest is its file's name."""

    digest: str
    size: tuple = SIZE


def read_picture(path):
    return Picture(os.path.basename(path))


class TruthFiles(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = os.path.realpath(folder.name)

    def write(self, sets, name="truth.json"):
        path = os.path.join(self.folder, name)
        with open(path, "w", encoding="utf-8") as out:
            out.write(sets if isinstance(sets, str) else json.dumps(sets))
        return path

    def frame(self, **given):
        """The only frame of a truth file with this one entry."""
        path = self.write([{"name": "a", "model": "a.jpg", "frames": [{"image": "0.jpg", **given}]}])
        return truth.read_truth(path, read_picture)[1][0]

    def test_nine_numbers(self):
        frame = self.frame(H=MOVE)
        self.assertEqual(frame.path, os.path.join(self.folder, "0.jpg"))
        self.assertEqual(frame.quads, {"a.jpg": UPRIGHT})
        self.assertEqual(frame.may_show, {"a.jpg"})

    def test_three_rows(self):
        self.assertEqual(self.frame(H=[MOVE[:3], MOVE[3:6], MOVE[6:]]).quads, {"a.jpg": UPRIGHT})

    def test_corners(self):
        self.assertEqual(self.frame(corners=[list(c) for c in UPRIGHT]).quads, {"a.jpg": UPRIGHT})

    def test_null_says_that_the_object_is_not_there(self):
        for given in ({"H": None}, {"corners": None}, {}):
            frame = self.frame(**given)
            self.assertEqual((frame.quads, frame.may_show), ({}, set()), given)

    def test_a_training_frame_shows_the_object_nobody_knows_where(self):
        frame = self.frame(H=MOVE, train=True)
        self.assertEqual((frame.quads, frame.may_show), ({"a.jpg": None}, {"a.jpg"}))

    def test_one_set_without_a_list(self):
        path = self.write({"name": "a", "model": "a.jpg", "frames": [{"image": "0.jpg", "H": MOVE}]})
        self.assertEqual(len(truth.read_truth(path, read_picture)[1]), 1)

    def test_two_sets_of_the_same_frame_are_one_frame(self):
        sets = [
            {"model": "a.jpg", "frames": [{"image": "0.jpg", "H": MOVE}]},
            {"model": "b.jpg", "frames": [{"image": "0.jpg", "corners": None}, {"image": "1.jpg", "H": MOVE}]},
        ]
        pictures, frames = truth.read_truth(self.write(sets), read_picture)
        self.assertEqual([p.digest for p in pictures], ["a.jpg", "b.jpg"])
        self.assertEqual([set(f.quads) for f in frames], [{"a.jpg"}, {"b.jpg"}])

    def test_gather_joins_files_and_pictures(self):
        a = self.write({"model": "a.jpg", "frames": [{"image": "0.jpg", "H": MOVE}]}, "a.json")
        b = self.write({"model": "b.jpg", "frames": [{"image": "0.jpg", "H": MOVE}]}, "b.json")
        objects, frames = truth.gather([a, b], [Picture("a.jpg"), Picture("c.jpg")], read_picture)
        self.assertEqual([o.digest for o in objects], ["a.jpg", "c.jpg", "b.jpg"])
        self.assertEqual([set(f.quads) for f in frames], [{"a.jpg", "b.jpg"}])
        self.assertEqual(frames[0].may_show, {"a.jpg", "b.jpg"})

    def test_what_is_no_truth_file_is_told(self):
        frames = [{"image": "0.jpg", "H": MOVE[:8]}]
        wrong = {
            "not JSON": "{",
            "another shape": [{"image": "0.jpg", "objects": {}}],
            "eight numbers": [{"model": "a.jpg", "frames": frames}],
            "three corners": [{"model": "a.jpg", "frames": [{"image": "0.jpg", "corners": UPRIGHT[:3]}]}],
        }
        for what, sets in wrong.items():
            with self.subTest(what), self.assertRaisesRegex(SystemExit, "truth.json: not a truth file"):
                truth.read_truth(self.write(sets), read_picture)
        with contextlib.redirect_stderr(io.StringIO()), self.assertRaisesRegex(SystemExit, "No such file"):
            truth.read_truth(os.path.join(self.folder, "none.json"), read_picture)


if __name__ == "__main__":
    unittest.main()
