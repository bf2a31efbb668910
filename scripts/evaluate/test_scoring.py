"""Tests of scoring.py."""

import math
import unittest

import scoring
from scoring import Detection, Verdict

# A rectangle of 200x50 px: its size is 100 px.
TRUTH = [(100, 100), (300, 100), (300, 150), (100, 150)]


def moved(dx, dy=0.0):
    """The rectangle, moved by so many px."""
    return [(x + dx, y + dy) for x, y in TRUTH]


def found(*offsets):
    """Detections at the rectangle, moved to the right by so many px each, best first."""
    return [Detection(0.9 - 0.1 * i, moved(dx)) for i, dx in enumerate(offsets)]


class Outlines(unittest.TestCase):
    def test_outline_of_a_scaled_and_moved_picture(self):
        corners = scoring.outline([2, 0, 10, 0, 3, 20, 0, 0, 1], (100, 50))
        self.assertEqual(corners, [(10, 20), (210, 20), (210, 170), (10, 170)])

    def test_outline_divides_by_the_third_coordinate(self):
        corners = scoring.outline([1, 0, 0, 0, 1, 0, 0.01, 0, 1], (100, 50))
        self.assertEqual(corners, [(0, 0), (50, 0), (50, 25), (0, 50)])

    def test_rows_and_flat_numbers_are_the_same(self):
        flat = [1, 2, 3, 4, 5, 6, 7, 8, 9]
        rows = [[1, 2, 3], [4, 5, 6], [7, 8, 9]]
        self.assertEqual(scoring.outline(flat, (3, 2)), scoring.outline(rows, (3, 2)))

    def test_eight_numbers_are_no_homography(self):
        with self.assertRaisesRegex(ValueError, "nine numbers, not 8"):
            scoring.outline([1, 0, 0, 0, 1, 0, 0, 0], (3, 2))

    def test_area_does_not_depend_on_the_direction(self):
        self.assertEqual(scoring.area(TRUTH), 10_000)
        self.assertEqual(scoring.area(TRUTH[::-1]), 10_000)

    def test_area_of_a_slanted_shape(self):
        self.assertEqual(scoring.area([(0, 0), (10, 0), (14, 5), (4, 5)]), 50)


class Errors(unittest.TestCase):
    def test_no_error_at_the_truth(self):
        self.assertEqual(scoring.corner_error(TRUTH, TRUTH), 0)

    def test_corner_error_is_a_distance(self):
        self.assertAlmostEqual(scoring.corner_error(moved(3, -4), TRUTH), 5)

    def test_corner_error_is_a_mean(self):
        one_off = [(108, 100), *TRUTH[1:]]
        self.assertAlmostEqual(scoring.corner_error(one_off, TRUTH), 2)

    def test_corners_in_another_order_are_an_error(self):
        turned = TRUTH[1:] + TRUTH[:1]
        self.assertAlmostEqual(scoring.corner_error(turned, TRUTH), (200 + 50 + 200 + 50) / 4)

    def test_three_corners_are_no_outline(self):
        with self.assertRaises(ValueError):
            scoring.corner_error(TRUTH[:3], TRUTH)

    def test_relative_error_is_a_share_of_the_true_size(self):
        self.assertAlmostEqual(scoring.relative_error(moved(7), TRUTH), 0.07)
        doubled = [(2 * x, 2 * y) for x, y in TRUTH]
        doubled_and_moved = [(2 * x, 2 * y) for x, y in moved(7)]
        self.assertAlmostEqual(scoring.relative_error(doubled_and_moved, doubled), 0.07)

    def test_the_size_is_the_object_s_not_the_outline_s(self):
        # Half as large, around the same middle: each corner is off by half of half the diagonal.
        half = [(150, 112.5), (250, 112.5), (250, 137.5), (150, 137.5)]
        self.assertAlmostEqual(scoring.relative_error(half, TRUTH), math.hypot(50, 12.5) / 100)

    def test_mean_shift_has_a_direction(self):
        self.assertEqual(scoring.mean_shift(moved(3, -4), TRUTH), (3, -4))
        spread = [(99, 100), (301, 100), (301, 150), (99, 150)]
        self.assertEqual(scoring.mean_shift(spread, TRUTH), (0, 0))


class Verdicts(unittest.TestCase):
    def judge(self, *offsets, truth=TRUTH):
        return scoring.judge(found(*offsets), truth)

    def test_tight_is_under_3_per_cent(self):
        self.assertEqual(self.judge(2.9), [Verdict.TIGHT])
        self.assertEqual(self.judge(3.1), [Verdict.FOUND])

    def test_found_is_under_10_per_cent(self):
        self.assertEqual(self.judge(9.9), [Verdict.FOUND])
        self.assertEqual(self.judge(10.1), [Verdict.WRONG_PLACE])

    def test_a_second_outline_at_the_place_is_wrong(self):
        self.assertEqual(self.judge(5, 0), [Verdict.FOUND, Verdict.WRONG_PLACE])

    def test_the_right_one_may_come_second(self):
        self.assertEqual(self.judge(500, 0), [Verdict.WRONG_PLACE, Verdict.TIGHT])

    def test_what_is_not_there_cannot_be_found(self):
        self.assertEqual(self.judge(0, 5, truth=None), [Verdict.ABSENT, Verdict.ABSENT])

    def test_nothing_detected(self):
        self.assertEqual(self.judge(), [])

    def test_only_tight_and_found_are_right(self):
        self.assertEqual([v for v in Verdict if v.right], [Verdict.TIGHT, Verdict.FOUND])

    def test_an_object_is_found_when_the_best_detection_is_right(self):
        self.assertTrue(scoring.is_found(found(5), TRUTH))
        self.assertFalse(scoring.is_found(found(500, 0), TRUTH))
        self.assertFalse(scoring.is_found(found(), TRUTH))
        self.assertFalse(scoring.is_found(found(0), None))

    def test_what_shows_too_little_is_left_out(self):
        half = [Detection(0.9, moved(0), 0.5), Detection(0.85, moved(500), 0.7)]
        looks = [(half, TRUTH), ([], TRUTH)]
        self.assertEqual(scoring.shares_of(looks, [0, 0.5, 0.6], scoring.is_found), [0.5, 0.5, 0])
        self.assertEqual(scoring.shares_of(looks, [0, 0.6, 0.8], lambda found, _: found), [0.5, 0.5, 0])


class Reliability(unittest.TestCase):
    def test_bins_hold_counts_means_and_shares(self):
        bins = scoring.reliability([(0.82, True), (0.88, False), (0.05, False)], 10)
        self.assertEqual([(b.low, b.high, b.count) for b in bins], [(0.0, 0.1, 1), (0.8, 0.9, 2)])
        self.assertAlmostEqual(bins[1].mean_score, 0.85)
        self.assertAlmostEqual(bins[1].share_right, 0.5)
        self.assertAlmostEqual(bins[1].gap, 0.35)

    def test_a_score_on_an_edge_belongs_to_the_bin_above(self):
        self.assertEqual([b.low for b in scoring.reliability([(0.5, True)], 4)], [0.5])

    def test_a_score_of_1_belongs_to_the_last_bin(self):
        bins = scoring.reliability([(1.0, True), (0.0, False)], 5)
        self.assertEqual([(b.low, b.count) for b in bins], [(0.0, 1), (0.8, 1)])

    def test_weights_move_means_and_shares_but_not_counts(self):
        (row,) = scoring.reliability([(0.82, True), (0.88, False)], 10, [3, 1])
        self.assertEqual(row.count, 2)
        self.assertAlmostEqual(row.mean_score, (3 * 0.82 + 0.88) / 4)
        self.assertAlmostEqual(row.share_right, 0.75)

    def test_mean_gap_weighs_bins_by_their_detections(self):
        # Three at 0.95, all right: a gap of 0.05. One at 0.25, right: a gap of 0.75.
        bins = scoring.reliability([(0.95, True)] * 3 + [(0.25, True)], 10)
        self.assertAlmostEqual(scoring.mean_gap(bins), (3 * 0.05 + 0.75) / 4)

    def test_no_detections_have_no_gap(self):
        self.assertEqual(scoring.mean_gap(scoring.reliability([], 10)), 0)

    def test_histogram_starts_at_the_threshold(self):
        rows = scoring.histogram([0.05, 0.62, 0.7, 0.99, 1.0], 0.6, bins=4)
        self.assertEqual(rows, [(0.6, 0.75, 2), (0.75, 1.0, 2)])

    def test_histogram_cuts_the_bin_of_the_threshold(self):
        self.assertEqual(scoring.histogram([0.6, 0.7], 0.65, bins=2)[0], (0.65, 1.0, 1))


class Limits(unittest.TestCase):
    def test_no_false_alarm_leaves_three(self):
        self.assertEqual(scoring.upper_limit(0), 3.0)

    def test_the_limit_leaves_5_per_cent_to_a_poisson_count(self):
        for count in (0, 1, 2, 5, 20, 100):
            mean = scoring.upper_limit(count)
            terms = (math.exp(k * math.log(mean) - mean - math.lgamma(k + 1)) for k in range(count + 1))
            self.assertAlmostEqual(sum(terms), 0.05, delta=0.002, msg=f"{count} seen, limit {mean}")


if __name__ == "__main__":
    unittest.main()
