"""The element in pipelines of gst-launch-1.0, beside this machine's program.

In: KEYGRAPH, the program; GST_PLUGIN_PATH, the folder of the plugin. `scripts/test-gstreamer` runs it.
"""

import json
import os
import re
import subprocess
import tempfile
import unittest
from pathlib import Path

ASSETS = Path(__file__).parents[3] / "assets"
FRAMES = 24
SOURCE = ["multifilesrc", f"location={ASSETS}/sequence/%04d.jpg", f"stop-index={FRAMES - 1}"]
DECODED = [*SOURCE, "caps=image/jpeg,framerate=15/1", "!", "jpegdec", "!", "videoconvert", "!"]
MESSAGE = re.compile(r'\(element\): keygraph, json=\(string\)"(.*?)(?<!\\)"[,;]')


def launch(*pipeline):
    """Runs a pipeline: its exit status, and what it prints."""
    run = ["gst-launch-1.0", "-m", "-v", *map(str, pipeline)]
    done = subprocess.run(run, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=120)
    return done.returncode, done.stdout


def lines(told):
    """The lines of the messages."""
    return [json.loads(re.sub(r"\\(.)", r"\1", text)) for text in MESSAGE.findall(told)]


def lasting(line):
    """A line without what differs: times, the name of the source, the number of a picture."""
    return {key: value for key, value in line.items() if key not in ("source", "frame", "time_ms")}


class Element(unittest.TestCase):
    """One folder with a model for all tests."""

    @classmethod
    def setUpClass(cls):
        cls.room = tempfile.TemporaryDirectory(prefix="keygraph-gst-")
        cls.folder = Path(cls.room.name)
        cls.model = cls.folder / "astronaut.kgm"
        cls.keygraph("train", ASSETS / "pictures/astronaut.jpg", "-o", cls.model)

    @classmethod
    def tearDownClass(cls):
        cls.room.cleanup()

    @classmethod
    def keygraph(cls, *arguments):
        run = [os.environ["KEYGRAPH"], *map(str, arguments)]
        return subprocess.run(run, stdout=subprocess.PIPE, text=True, check=True).stdout

    def detect(self, *arguments):
        printed = self.keygraph("detect", "-m", self.model, "--json", *arguments)
        return [lasting(json.loads(line)) for line in printed.splitlines()]

    def frames(self, caps, *options):
        """The lines of the sequence in one format."""
        element = ["keygraphdetect", f"model={self.model}", *options]
        status, told = launch(*DECODED, f"video/x-raw,format={caps}", "!", *element, "!", "fakesink")
        self.assertEqual(status, 0, told[-2000:])
        found = lines(told)
        self.assertEqual([line["frame"] for line in found], list(range(FRAMES)))
        return [lasting(line) for line in found]

    def test_rgb_frames_give_the_lines_of_the_command(self):
        sink = ["pngenc", "!", "multifilesink", f"location={self.folder}/rgb%04d.png"]
        launch(*DECODED, "video/x-raw,format=RGB", "!", *sink)
        expected = self.detect(*sorted(self.folder.glob("rgb*.png")))
        self.assertEqual(self.frames("RGB", "track=false"), expected)
        self.assertGreater(sum(len(line["detections"]) for line in expected), FRAMES // 2)

    def test_yuv_frames_give_the_lines_of_the_command_and_are_followed_as_it_follows_them(self):
        film = self.folder / "film.y4m"
        launch(*DECODED, "video/x-raw,format=I420", "!", "y4menc", "!", "filesink", f"location={film}")
        expected = self.detect("--threads", "1", film)
        for caps in ("I420", "NV12"):
            self.assertEqual(self.frames(caps, "track=false"), expected, caps)
        self.assertEqual(self.frames("I420"), self.detect("--track", film))
        self.assertEqual(self.frames("I420", "smooth=6"), self.detect("--track", "--smooth=6", film))
        for options, flags in (
            (["roi=10%,5%,80%,90%", "surface=plane"], ["--roi", "10%,5%,80%,90%", "--surface", "plane"]),
            (["mirror=true", "all-names=true"], ["--mirror", "--all-names"]),
            (["thorough=true", "profile=qvga"], ["--thorough", "--profile", "qvga"]),
            (["wide=true"], ["--wide"]),
        ):
            expected = self.detect("--threads", "1", *flags, film)
            self.assertEqual(self.frames("I420", "track=false", *options), expected, options)

    def test_gray_frames_and_odd_sizes_pass(self):
        self.assertTrue(any(line["detections"] for line in self.frames("GRAY8")))
        for caps in ("I420", "NV12", "RGB"):
            size = f"{caps},width=641,height=481"
            status, told = launch(
                "videotestsrc",
                "num-buffers=2",
                "!",
                f"video/x-raw,format={size}",
                "!",
                "keygraphdetect",
                f"model={self.model}",
                "!",
                "fakesink",
            )
            self.assertEqual((status, len(lines(told))), (0, 2), told[-2000:])

    def test_metas_stand_in_the_buffers(self):
        pipeline = [*DECODED, "keygraphdetect", f"model={self.model}", "!", "identity", "silent=false", "!", "fakesink"]
        # With -v each change of a property is printed; with -m it is a message, too.
        told = [line for line in launch(*pipeline)[1].splitlines() if line.startswith("/GstPipeline")]
        metas = sum(line.count("GstVideoRegionOfInterestMeta") for line in told)
        found = sum(len(line["detections"]) for line in self.frames("I420"))
        self.assertEqual(metas, found)

    def test_outlines_are_drawn_where_objects_are(self):
        for name, overlay in (("plain", "false"), ("drawn", "true")):
            element = ["keygraphdetect", f"model={self.model}", f"overlay={overlay}"]
            sink = ["filesink", f"location={self.folder}/{name}.gray"]
            launch(*DECODED, "video/x-raw,format=GRAY8", "!", *element, "!", *sink)
        plain, drawn = ((self.folder / f"{name}.gray").read_bytes() for name in ("plain", "drawn"))
        size = 640 * 480
        for i, line in enumerate(self.frames("GRAY8")):
            before, after = plain[i * size : (i + 1) * size], drawn[i * size : (i + 1) * size]
            self.assertEqual(before != after, bool(line["detections"]), f"frame {i}")
            for corners in (d["corners"] for d in line["detections"]):
                for (x, y), (u, v) in zip(corners, corners[1:] + corners[:1], strict=True):
                    middle = [round((x + u) / 2), round((y + v) / 2)]
                    if 0 <= middle[0] < 640 and 0 <= middle[1] < 480:
                        self.assertEqual(after[middle[1] * 640 + middle[0]], 255)

    def test_mistakes_are_told(self):
        # gst-launch-1.0 (seen with 1.22, with any element) can wait for ever for a sink that an error kept from its
        # first buffer: this one is not waited for.
        sink = ["fakesink", "async=false"]
        damaged = self.folder / "damaged.kgm"
        damaged.write_bytes(self.model.read_bytes()[:-1])
        for options, told in [
            ([], "set model=FILE.kgm"),
            (["model=/nowhere.kgm"], "/nowhere.kgm: No such file"),
            ([f"model={damaged}"], "damaged.kgm"),
            ([f"model={self.model}", "profile=4k"], "expected one of hd, vga, qvga, qqvga; got 4k"),
            ([f"model={self.model}", "surface=round"], "expected one of any, plane; got round"),
            ([f"model={self.model}", "roi=1,2"], "roi: "),
            ([f"model={self.model}", "wide=true"], "wide: set track=false"),
            ([f"model={self.model}", "track=false", "smooth=3"], "smooth: for outlines that are followed"),
        ]:
            status, printed = launch("videotestsrc", "num-buffers=1", "!", "keygraphdetect", *options, "!", *sink)
            self.assertNotEqual(status, 0)
            self.assertIn(told, printed)
        small = ["videotestsrc", "num-buffers=1", "!", "video/x-raw,width=8,height=8"]
        status, printed = launch(*small, "!", "keygraphdetect", f"model={self.model}", "!", *sink)
        self.assertNotEqual(status, 0)
        self.assertIn("8x8 px", printed)


if __name__ == "__main__":
    unittest.main()
