"""The package computes what the command line computes, to the bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import keygraph
import numpy as np
import pytest
from conftest import PICTURES, SEQUENCE, Command, timeless
from PIL import Image

FEW = SEQUENCE[0:48:6]
CAMERA = ["--intrinsics", "600,600,319.5,239.5"]
LENS = {"intrinsics": (600, 600, 319.5, 239.5)}


def assert_equal(lines: list[dict[str, Any]], results: list[dict[str, Any]]) -> None:
    assert len(lines) == len(results) > 0
    for line, result in zip(lines, results, strict=True):
        assert timeless(result) == timeless(line)
        assert result["time_ms"].keys() == line["time_ms"].keys()


def test_models_have_the_same_bytes(model: keygraph.Model, command: Command, tmp_path: Path) -> None:
    path = tmp_path / "m.kgm"
    command("train", PICTURES / "astronaut.jpg", "-o", path)
    assert model.bytes() == path.read_bytes()
    options = ["--preset", "compact", "--luma", "--crop", "50,40,400,300", "--name", "cup"]
    command("train", PICTURES / "coffee.jpg", *options, "-o", path)
    ours = keygraph.train(PICTURES / "coffee.jpg", "cup", "compact", luma=True, crop=(50, 40, 400, 300))
    assert ours.bytes() == path.read_bytes()


def test_the_sequence_with_all_digests(model: keygraph.Model, model_file: Path, command: Command) -> None:
    lines = command("detect", "-m", model_file, "--json", "--digests", *SEQUENCE)
    detector = keygraph.Detector(model, digests=True)
    assert_equal(lines, [detector.detect(path).to_dict() for path in SEQUENCE])
    # Frames in memory are the same frames.
    arrays = [detector.detect(keygraph.imread(path)).to_dict(source=str(path)) for path in SEQUENCE]
    assert_equal(lines, arrays)
    assert sum(bool(line["detections"]) for line in lines) >= 30, "the sequence shows the astronaut"


def test_the_sequence_tracked(model: keygraph.Model, model_file: Path, command: Command) -> None:
    lines = command("detect", "-m", model_file, "--json", "--track", *SEQUENCE)
    tracker = keygraph.Tracker(model)
    results = [tracker.track(path) for path in SEQUENCE]
    assert_equal(lines, [result.to_dict() for result in results])
    states = [[(d.id, d.state) for d in result] for result in results]
    assert states == [[(d["id"], d["state"]) for d in line["detections"]] for line in lines]
    lost = [[(d.id, d.state, d.unseen) for d in result.lost] for result in results]
    assert lost == [[(d["id"], d["state"], d["unseen"]) for d in line["lost"]] for line in lines]
    assert [d.to_dict() for result in results for d in result.lost] == [d for line in lines for d in line["lost"]]
    assert {state for found in states for _, state in found} == {"found", "tracked"}
    assert any(lost), "an object is lost once"


def test_the_sequence_smoothed(model: keygraph.Model, model_file: Path, command: Command) -> None:
    lines = command("detect", "-m", model_file, "--json", "--track", "--smooth=5", *SEQUENCE)
    smooth, plain = keygraph.Tracker(model, smooth=5), keygraph.Tracker(model)
    results = [smooth.track(path).to_dict() for path in SEQUENCE]
    assert_equal(lines, results)
    as_they_come = [plain.track(path).to_dict() for path in SEQUENCE]
    assert list(map(timeless, results)) != list(map(timeless, as_they_come))
    for frames in (-1, 256):
        with pytest.raises(ValueError, match="smooth: expected 0 to 255"):
            keygraph.Tracker(model, smooth=frames)


@pytest.mark.parametrize(
    ("arguments", "options"),
    [
        (["--profile", "qvga"], {"profile": "qvga"}),
        (["--profile", "qqvga"], {"profile": "qqvga"}),
        (["--profile", "hd", "--threshold", "0.5"], {"profile": "hd", "threshold": 0.5}),
        (["--min-visible", "0.9"], {"min_visible": 0.9}),
        (["--roi", "40,30,500,400"], {"roi": (40, 30, 500, 400)}),
        (["--roi", "10%,0,80%,100%", "--profile", "qvga"], {"roi": ("10%", 0, "80%", "100%"), "profile": "qvga"}),
        (["--roi", "41,31,501,401", "--mirror"], {"roi": "41,31,501,401", "mirror": True}),
        (["--mirror"], {"mirror": True}),
        (["--surface", "plane"], {"surface": "plane"}),
        ([*CAMERA, "--distortion", "-0.1,0.02,0,0"], {**LENS, "distortion": np.array([[-0.1, 0.02, 0, 0]])}),
        (
            [*CAMERA, "--distortion", "-0.1,0.02,0,0,0.01", "--profile", "qvga", "--roi", "40,30,500,400"],
            {**LENS, "distortion": [-0.1, 0.02, 0, 0, 0.01], "profile": "qvga", "roi": (40, 30, 500, 400)},
        ),
    ],
    ids=lambda v: " ".join(v) if isinstance(v, list) else "",
)
def test_options(
    arguments: list[str], options: dict[str, Any], model: keygraph.Model, model_file: Path, command: Command
) -> None:
    lines = command("detect", "-m", model_file, "--json", "--digests", *arguments, *FEW)
    detector = keygraph.Detector(model, digests=True, **options)
    assert_equal(lines, [detector.detect(path).to_dict() for path in FEW])
    assert_equal(lines, [detector.detect(keygraph.imread(path)).to_dict(source=str(path)) for path in FEW])


def test_a_thorough_search(model: keygraph.Model, model_file: Path, command: Command) -> None:
    lines = command("detect", "-m", model_file, "--json", "--thorough", *SEQUENCE[4:6])
    detector = keygraph.Detector(model, thorough=True)
    assert_equal(lines, [detector.detect(path).to_dict() for path in SEQUENCE[4:6]])


def test_a_wide_search(model: keygraph.Model, model_file: Path, command: Command, tmp_path: Path) -> None:
    """A picture that is a seventh as wide as it is high, as it is seen from far to the side."""
    shown = Image.new("RGB", (1000, 750), (128, 128, 128))
    shown.paste(Image.open(PICTURES / "astronaut.jpg").resize((90, 640), Image.Resampling.BOX), (430, 60))
    shown.save(tmp_path / "steep.png")
    assert keygraph.Detector(model).detect(tmp_path / "steep.png") == []
    detector = keygraph.Detector(model, wide=True)
    (found,) = detector.detect(tmp_path / "steep.png")
    assert np.abs(found.corners - [[430, 60], [520, 60], [520, 700], [430, 700]]).max() < 6
    lines = command("detect", "-m", model_file, "--json", "--wide", tmp_path / "steep.png", *FEW)
    frames = [tmp_path / "steep.png", *FEW]
    assert_equal(lines, [detector.detect(path).to_dict() for path in frames])
    # Bytes of a camera, and a part of the frame.
    gray = shown.convert("L").tobytes()
    detector = keygraph.Detector(model, wide=True, roi=(300, 0, 400, 750))
    (found,) = detector.detect(gray, format="gray", size=(1000, 750))
    assert np.abs(found.corners - [[430, 60], [520, 60], [520, 700], [430, 700]]).max() < 6
    with pytest.raises(ValueError, match="wide: leave out distortion and digests"):
        keygraph.Detector(model, wide=True, digests=True)


def test_several_objects(
    model: keygraph.Model, coffee: keygraph.Model, model_file: Path, command: Command, tmp_path: Path
) -> None:
    coffee.save(tmp_path / "coffee.kgm")
    files = ["-m", model_file, "-m", tmp_path / "coffee.kgm"]
    cases: list[tuple[list[str], dict[str, Any]]] = [
        ([], {}),
        (["--all-names", "--threshold", "0.2"], {"all_names": True, "threshold": 0.2}),
    ]
    for flags, options in cases:
        lines = command("detect", *files, "--json", *flags, *FEW)
        detector = keygraph.Detector([model, coffee], **options)
        assert_equal(lines, [detector.detect(path).to_dict() for path in FEW])
    command("pack", model_file, tmp_path / "coffee.kgm", "-o", tmp_path / "all.kgm")
    assert keygraph.pack([model, tmp_path / "coffee.kgm"]).bytes() == (tmp_path / "all.kgm").read_bytes()


def test_poses(model: keygraph.Model, model_file: Path, command: Command) -> None:
    camera = ["--intrinsics", "600,600,319.5,239.5", "--width-mm", "200"]
    lines = command("detect", "-m", model_file, "--json", *camera, *FEW)
    matrix = np.array([[600.0, 0, 319.5], [0, 600, 239.5], [0, 0, 1]])
    detector, count = keygraph.Detector(model), 0
    for path, line in zip(FEW, lines, strict=True):
        for detection, expected in zip(detector.detect(path), line["detections"], strict=True):
            for intrinsics in (matrix, (600, 600, 319.5, 239.5)):
                pose = keygraph.pose(detection, intrinsics, 200)
                assert pose is not None
                assert pose.to_dict() == expected["pose"]
            count += 1
    assert count > 0


def test_assessments(command: Command) -> None:
    picture = PICTURES / "coffee.jpg"
    (line,) = command("assess", picture, "--json", "--profile", "qqvga", "--views", "1")
    assert keygraph.assess(picture, profile="qqvga", views=1).to_dict() == line
    model = keygraph.train(picture, preset="large")
    assert keygraph.assess(picture, model, profile="qqvga", views=1).to_dict() == line
