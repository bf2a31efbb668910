"""Tests of pages.py, and of the figures on the pages themselves."""

import os
import unittest

from packages import missing_for_tests

if missing_for_tests(["cv2"]):
    raise unittest.SkipTest("packages are missing")

import pages
import shots
from places import ROOT
from record import read_record


class Figures(unittest.TestCase):
    def test_the_pages_say_what_the_records_say(self):
        self.assertEqual(pages.check(), [])

    def test_a_table_is_written_from_its_record(self):
        text, lacking = pages.with_tables("before\n<!-- table: growth -->\n| old |\n<!-- end -->\nafter\n")
        self.assertTrue(text.startswith("before\n<!-- table: growth -->\n| objects | found |"), text)
        self.assertTrue(text.endswith("|\n<!-- end -->\nafter\n"), text)
        self.assertEqual((pages.with_tables(text), lacking), ((text, []), []))

    def test_a_table_of_no_record_is_told(self):
        page = "<!-- table: no-such -->\n| old |\n<!-- end -->\n"
        text, lacking = pages.with_tables(page)
        self.assertEqual((text, len(lacking)), (page, 1))
        self.assertIn("no record", pages.compare("12", ["growth.no_such"])[0])

    def test_figures_are_looked_for_in_their_order(self):
        shown = pages.formatted("growth.objects.0.frames")
        most = pages.formatted("growth.objects.3.objects")
        self.assertEqual((shown, most), ("120", "1,000"))
        places = ["growth.objects.0.frames", "growth.objects.3.objects"]
        self.assertEqual(pages.compare(f"{shown} frames, {most} objects", places), [])
        self.assertEqual(len(pages.compare(f"{most} objects, {shown} frames", places)), 1)

    def test_a_part_of_a_number_is_not_the_number(self):
        place = ["growth.objects.0.frames"]
        for text in ("1120", "120.5", "1,120", "1200"):
            self.assertEqual(len(pages.compare(text, place)), 1, text)
        for text in ("120", "120.", "(120)", "120,"):
            self.assertEqual(pages.compare(text, place), [], text)

    def test_a_figure_without_a_source_is_told(self):
        page = pages.WHOLE[0]
        self.assertEqual(len(pages.problems(page, "All of it takes 5 ms.\n")), 1)
        self.assertEqual(pages.problems(page, "All of it takes 5 ms. <!-- given: a goal -->\n"), [])
        self.assertEqual(pages.problems(page, "```\n5 ms\n```\n\nSee [there](0014.md) and `5`.\n"), [])
        wrong = pages.problems(page, "Of 121 frames.\n<!-- measured: growth.objects.0.frames -->\n")
        self.assertIn('"120" (growth.objects.0.frames)', wrong[0])


class Pictures(unittest.TestCase):
    def test_the_pictures_are_those_that_were_drawn_by_this_build(self):
        drawn = read_record("pictures")["sha256"]
        self.assertLessEqual(set(shots.DRAWN), set(drawn))
        for name, digest in drawn.items():
            self.assertEqual(
                shots.digest(os.path.join(ROOT, name)), digest, f"{name}: scripts/measure pictures draws it"
            )


if __name__ == "__main__":
    unittest.main()
