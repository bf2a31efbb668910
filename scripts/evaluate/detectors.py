"""Keygraph as a detector: the command, run over frames on disk."""

import copy
import json
import math
import os
import subprocess
import sys

from scoring import THRESHOLD, Detection, Search

# Most bytes of the presets of `keygraph train`, smallest first.
PRESETS = [("compact", 512 << 10), ("standard", 1_500_000), ("large", 2_000_000)]


class Refused(Exception):
    """A detector cannot be trained on a picture."""


def check_command(command):
    """Ends the program when the command is not there."""
    if not os.path.exists(command):
        sys.exit(f"{command} is not there: `cargo build --release` makes it; --keygraph says where else it is")


class Keygraph:
    """The command with one set of `train` options; models are kept in a folder."""

    def __init__(self, label, command, folder, train=(), threads=1, threshold=THRESHOLD):
        check_command(command)
        self.label, self.command, self.folder, self.train = label, command, folder, list(train)
        self.threads, self.threshold, self.options = threads, threshold, []
        self.models = {}  # digest of the picture -> (path of the model, its bytes), or why it was refused

    def thorough(self, threshold):
        """The detector with another least score, and thorough; the two share their models."""
        other = copy.copy(self)
        other.threshold, other.options = threshold, ["--thorough"]
        return other

    def model(self, picture):
        """The path and the bytes of the picture's model; raises Refused."""
        if picture.digest not in self.models:
            self.models[picture.digest] = self.learn(picture)
        model = self.models[picture.digest]
        if isinstance(model, Refused):
            raise model
        return model

    def learn(self, picture):
        """Trains a model of the picture: its path and bytes, or a Refused."""
        path = os.path.join(self.folder, f"{self.label}-{picture.digest[:16]}.kgm".replace(" ", "-"))
        run = [self.command, "train", picture.path, "-o", path, "--json", *self.train]
        done = subprocess.run(run, capture_output=True, text=True, check=False)
        if done.returncode == 2:
            sys.exit(done.stderr)
        return Refused(done.stderr.strip()) if done.returncode else (path, json.loads(done.stdout)["bytes"])

    def size(self, picture):
        """Bytes of the model."""
        return self.model(picture)[1]

    def search(self, picture, frames):
        """A `Search` for each of `frames`."""
        run = [self.command, "detect", "-m", self.model(picture)[0], "--json"]
        run += ["--threshold", str(self.threshold), *self.options, "--threads", str(self.threads)]
        done = subprocess.run(run + [f.path for f in frames], stdout=subprocess.PIPE, text=True, check=False)
        lines = [json.loads(line) for line in done.stdout.splitlines()]
        if done.returncode or len(lines) != len(frames):
            sys.exit(f"`keygraph detect` ended with {done.returncode}: {len(lines)} lines for {len(frames)} frames")
        searches = []
        for line in lines:
            detections = [Detection(d["score"], d["corners"], d["visible"]) for d in line["detections"]]
            searches.append(Search(sorted(detections, key=lambda d: -d.score), line["time_ms"]["total"]))
        return searches


def try_search(detector, picture, frames):
    """Each frame with its `Search`; a detector that refuses the picture finds nothing."""
    try:
        searches = detector.search(picture, frames)
    except Refused:
        searches = [Search([], math.nan) for _ in frames]
    return zip(frames, searches, strict=True)
