"""Tests of lookalikes.py and disturbances.py, on photographs of noise."""

import tempfile
import unittest
from dataclasses import dataclass

from packages import missing_for_tests

SKIP = missing_for_tests(["cv2", "numpy"])
if not SKIP:
    import cv2
    import disturbances
    import lookalikes
    import numpy as np
    from lookalikes import FAMILIES, FEWEST, MEMBERS


def photograph(seed):
    """Coarse noise, 200x160 px."""
    noise = np.random.default_rng(seed).integers(0, 256, (20, 25, 3), dtype=np.uint8)
    return cv2.resize(noise, (200, 160))


@dataclass
class Picture:
    """A picture that is not on disk."""

    pixels: object
    digest: int


@unittest.skipIf(SKIP, "packages are missing")
class Families(unittest.TestCase):
    def group(self, family, seed=1, group=0):
        photographs = [[photograph(10 * seed + i)] for i in range(MEMBERS)]
        return [lookalikes.member(family, photographs, seed, group, i) for i in range(MEMBERS)]

    def test_members_have_one_size_and_differ(self):
        for family in FAMILIES:
            members = self.group(family)
            self.assertEqual(len({m.shape for m in members}), 1, family)
            self.assertTrue(200 <= min(members[0].shape[:2]) <= max(members[0].shape[:2]) <= 720, family)
            for i, member in enumerate(members):
                for other in members[:i]:
                    differ = np.mean(np.abs(np.int32(member) - other).max(2) > 30)
                    self.assertGreater(differ, 0.005, family)

    def test_members_share_a_part_of_their_look(self):
        for family in FAMILIES:
            first, second = (np.int32(m) for m in self.group(family)[:2])
            alike = np.mean(np.abs(first - second).max(2) < 8)
            self.assertTrue(0.15 < alike < 0.99, f"{family}: {alike:.2f}")

    def test_seed_and_group_decide(self):
        for family in FAMILIES:
            members = self.group(family)
            for member, again in zip(members, self.group(family), strict=True):
                self.assertTrue((member == again).all(), family)
            for other in (self.group(family, group=1), self.group(family, seed=2)):
                same = members[0].shape == other[0].shape and (members[0] == other[0]).all()
                self.assertFalse(same, family)

    def test_cards_do_not_look_the_same_upside_down(self):
        for pixels in self.group("playing cards") + self.group("decks"):
            differ = np.mean(np.abs(np.int32(pixels) - pixels[::-1, ::-1]).max(2) > 30)
            self.assertGreater(differ, 0.002)

    def test_signs_differ_in_their_colours_alone(self):
        first, *others = self.group("signs")
        for other in others:
            self.assertGreater(np.mean(np.abs(np.int32(first) - other).max(2) > 30), 0.3)
            gray = [np.int32(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)) for pixels in (first, other)]
            self.assertLess(np.abs(gray[0] - gray[1]).max(), 6)

    def test_no_photograph_is_used_twice(self):
        for n in (FEWEST, 20, 41):
            parts, backgrounds = lookalikes.share(list(range(n)), 1, 0)
            self.assertEqual(sorted(sum(parts, backgrounds)), list(range(n)))
            self.assertEqual(len(parts), MEMBERS)
            self.assertTrue(all(parts) and len(backgrounds) >= 2)

    def test_siblings_are_written(self):
        pictures = [Picture(photograph(i), i) for i in range(FEWEST)]
        with tempfile.TemporaryDirectory() as folder:
            members, backgrounds = lookalikes.siblings("one brand", pictures, 1, 0, folder)
            self.assertEqual([m.name for m in members], [f"one-brand-0-{i}" for i in range(MEMBERS)])
            self.assertEqual(len({m.digest for m in members}), MEMBERS)
            self.assertEqual(len(backgrounds), 2)


@unittest.skipIf(SKIP, "packages are missing")
class Disturbances(unittest.TestCase):
    def setUp(self):
        self.pixels, self.ground = photograph(1), np.zeros((50, 50, 3), np.uint8)

    def test_a_flat_print_is_where_it_was_laid(self):
        flat = disturbances.lay(self.pixels, self.ground, lambda x, y: (x, y))
        margin = int(disturbances.MARGIN * 200)
        corners = np.array([(0, 0), (200, 0), (200, 160), (0, 160)]) + margin
        self.assertTrue(np.allclose(flat.corners, corners, atol=0.01), flat.corners)
        self.assertTrue((flat.pixels[margin : margin + 160, margin : margin + 200] == self.pixels).all())
        self.assertEqual(flat.pixels[:margin].max(), 0)

    def test_the_corners_of_a_print_are_those_of_what_is_seen(self):
        white = np.full((160, 200, 3), 255, np.uint8)
        for change in (disturbances.bend, disturbances.crumple):
            for seed in range(8):
                flat = change(np.random.default_rng(seed), white, self.ground)
                there = flat.pixels.max(2) > 60
                area = cv2.contourArea(np.float32(flat.corners))
                self.assertLess(abs(there.sum() / area - 1), 0.2, f"{change.__name__} {seed}")
                for x, y in flat.corners:
                    near = there[max(0, int(y) - 6) : int(y) + 7, max(0, int(x) - 6) : int(x) + 7]
                    self.assertTrue(near.any() and not near.all(), f"{change.__name__} {seed}: {x} {y}")

    def test_what_is_in_front_hides_some_and_not_all(self):
        quad = np.array([(40, 40), (160, 40), (160, 120), (40, 120)], float)
        for seed in range(20):
            frame = disturbances.cover(np.random.default_rng(seed), self.pixels, quad, photograph(2))
            hidden = np.mean((frame != self.pixels).any(2)[40:120, 40:160])
            self.assertTrue(0.02 < hidden < 0.95, f"{seed}: {hidden:.2f}")

    def test_light_changes_and_the_size_stays(self):
        quad = np.array([(40, 40), (160, 40), (160, 120), (40, 120)], float)
        for seed in range(20):
            frame = disturbances.spoil(np.random.default_rng(seed), self.pixels, quad)
            self.assertEqual((frame.shape, frame.dtype), (self.pixels.shape, np.uint8))
            self.assertFalse((frame == self.pixels).all())


if __name__ == "__main__":
    unittest.main()
