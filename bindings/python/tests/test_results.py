"""Results: their types, shapes, pictures and words."""

from __future__ import annotations

import math
import sys
import types
from pathlib import Path
from typing import Any

import keygraph
import numpy as np
import pytest
from conftest import PICTURES, SEQUENCE
from numpy.typing import NDArray

Frame = NDArray[np.uint8]
CAMERA = (600, 600, 319.5, 239.5)


@pytest.fixture(scope="module")
def found(model: keygraph.Model, frame: Frame) -> keygraph.Detections:
    return keygraph.Detector(model).detect(frame)


def test_arrays_have_their_types_and_shapes(found: keygraph.Detections) -> None:
    (d,) = found
    expected: list[tuple[NDArray[Any], tuple[int, ...], type]] = [
        (d.corners, (4, 2), np.float32),
        (d.homography, (3, 3), np.float64),
        (d.xyxy, (4,), np.float32),
        (found.corners, (1, 4, 2), np.float32),
        (found.xyxy, (1, 4), np.float32),
        (found.scores, (1,), np.float32),
        (found.indices, (1,), np.int64),
        (found.polygons[0], (4, 2), np.int32),
    ]
    for array, shape, kind in expected:
        assert array.shape == shape and array.dtype == kind
    assert found.ids is None and d.id is None and d.state == "found" and d.unseen == 0
    assert (found.width, found.height, found.complete, found.searched, found.lost) == (640, 480, True, True, [])
    assert found.time_ms["total"] > 0 and "corners" in found.time_ms
    assert 0.8 <= d.score <= 1 and 0 < d.visible <= 1 and d.votes > 0 and d.agreeing > 0 and d.index == 0


def test_corners_are_the_picture_by_the_homography(found: keygraph.Detections) -> None:
    (d,) = found
    picture = np.array([[0, 0, 1], [512, 0, 1], [512, 512, 1], [0, 512, 1]], np.float64)
    mapped = picture @ d.homography.T
    # The outline runs along the rims of the outer pixels, half a pixel from their centres.
    assert np.abs(mapped[:, :2] / mapped[:, 2:] - d.corners).max() < 1.5
    assert np.allclose(d.xyxy, [*d.corners.min(0), *d.corners.max(0)])
    assert np.array_equal(found.polygons[0], np.rint(d.corners))


def test_nothing_found(model: keygraph.Model) -> None:
    empty = keygraph.Detector(model).detect(PICTURES / "rocket.jpg")
    assert empty == [] and isinstance(empty, list)
    assert (empty.xyxy.shape, empty.corners.shape, empty.scores.shape) == ((0, 4), (0, 4, 2), (0,))
    assert empty.to_dict()["detections"] == []


def test_rivals(model: keygraph.Model, frame: Frame) -> None:
    picture = keygraph.imread(PICTURES / "astronaut.jpg")
    changed = picture.copy()
    changed[:100, :100] = keygraph.imread(PICTURES / "coffee.jpg")[:100, :100]
    twin = keygraph.train(changed, "twin")
    (d,) = keygraph.Detector([model, twin], threshold=0.3).detect(frame)
    assert (d.object, [name for name, _ in d.rivals]) == ("astronaut", ["twin"])
    assert all(0 <= score <= 1 for _, score in d.rivals)
    assert [r["object"] for r in d.to_dict()["rivals"]] == ["twin"]


def test_drawings(found: keygraph.Detections, frame: Frame) -> None:
    drawn = found.draw()
    assert drawn.shape == (480, 640, 3) and drawn.dtype == np.uint8
    changed = (drawn != frame).any(-1)
    assert 0.005 < changed.mean() < 0.2
    # The middle of each side is drawn over.
    corners = found[0].corners
    for a, b in zip(corners, np.roll(corners, -1, 0), strict=True):
        x, y = np.rint((a + b) / 2).astype(int)
        if 0 <= x < 640 and 0 <= y < 480:
            assert changed[y, x]
    pose = keygraph.pose(found[0], (600, 600, 319.5, 239.5), 200)
    assert pose is not None
    with_axes = keygraph.draw(frame, found, poses=[pose, None])
    x, y = np.rint(pose.axes[0]).astype(int)
    assert (with_axes[y, x] != drawn[y, x]).any()
    other = np.ascontiguousarray(frame[..., ::-1])
    assert np.array_equal(found.draw(other, order="bgr"), drawn)
    assert keygraph.draw(frame[..., 0], []).shape == (480, 640, 3)


def test_pictures_are_written_and_read(frame: Frame, tmp_path: Path) -> None:
    keygraph.imwrite(tmp_path / "f.png", frame)
    assert np.array_equal(keygraph.imread(tmp_path / "f.png"), frame)
    keygraph.imwrite(tmp_path / "f.png", frame, order="bgr")
    assert np.array_equal(keygraph.imread(tmp_path / "f.png"), frame[..., ::-1])
    keygraph.imwrite(tmp_path / "f.jpg", frame)
    assert np.abs(keygraph.imread(tmp_path / "f.jpg").astype(int) - frame).mean() < 5
    with pytest.raises(ValueError, match=r"expected a name with \.png, \.jpg or \.jpeg, got"):
        keygraph.imwrite(tmp_path / "f.gif", frame)
    with pytest.raises(OSError, match="cannot write"):
        keygraph.imwrite(tmp_path / "no" / "f.png", frame)


def test_notebooks_get_pictures(found: keygraph.Detections, model: keygraph.Model, frame: Frame) -> None:
    assert found._repr_png_()[:8] == b"\x89PNG\r\n\x1a\n"
    blue_first = keygraph.Detector(model).detect(frame[..., ::-1], order="bgr")
    raw = keygraph.Detector(model).detect(frame.tobytes(), format="rgb", size=(640, 480))
    of_file = keygraph.Detector(model).detect(SEQUENCE[5])
    assert found._repr_png_() == blue_first._repr_png_() == raw._repr_png_() == of_file._repr_png_()
    html = found[0]._repr_html_()
    assert "<polygon" in html and "<b>astronaut</b>" in html
    odd = keygraph.train(PICTURES / "astronaut.jpg", name="<script>&")
    (d,) = keygraph.Detector(odd).detect(frame)
    assert "<script>" not in d._repr_html_() and "&lt;script&gt;&amp;" in d._repr_html_()
    assert repr(d).startswith('Detection("<script>&", score=')


def test_supervision_gets_what_it_takes(
    found: keygraph.Detections, model: keygraph.Model, frame: Frame, monkeypatch: pytest.MonkeyPatch
) -> None:
    stand_in = types.ModuleType("supervision")
    stand_in.Detections = types.SimpleNamespace  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "supervision", stand_in)
    got = found.to_supervision()
    assert np.array_equal(got.xyxy, found.xyxy) and got.tracker_id is None
    assert got.data["class_name"].tolist() == ["astronaut"]
    assert keygraph.Tracker(model).track(frame).to_supervision().tracker_id.tolist() == [0]


def test_poses(found: keygraph.Detections) -> None:
    pose = keygraph.pose(found[0], (600, 600, 319.5, 239.5), 200)
    assert pose is not None
    assert pose.rotation.shape == (3, 3) and pose.rotation.dtype == np.float64
    assert np.allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-5)
    assert math.isclose(np.linalg.det(pose.rotation), 1, abs_tol=1e-5)
    assert (pose.translation_mm.shape, pose.axes.shape) == ((3,), (4, 2))
    assert 200 < pose.translation_mm[2] < 400 and pose.error_px < 1 and not pose.ambiguous
    assert pose.mirrored.error_px > pose.error_px
    assert np.array_equal(pose.mirrored.mirrored.rotation, pose.rotation)
    assert repr(pose).startswith("Pose(translation_mm=[")


@pytest.mark.parametrize(
    ("intrinsics", "width_mm", "error", "said"),
    [
        ((600, 600, 320), 200, TypeError, "fx, fy, cx, cy"),
        ("600", 200, TypeError, "camera matrix"),
        (np.eye(4), 200, TypeError, "camera matrix"),
        ([[600, 5, 320], [0, 600, 240], [0, 0, 1]], 200, ValueError, "without skew"),
        ((0, 600, 320, 240), 200, ValueError, "focal lengths above 0"),
        ((600, 600, math.nan, 240), 200, ValueError, "focal lengths above 0"),
        ((600, 600, 320, 240), 0, ValueError, "width_mm: expected a number of mm above 0, got 0"),
        ((600, 600, 320, 240), math.inf, ValueError, "width_mm"),
    ],
)
def test_what_is_no_camera(
    intrinsics: Any, width_mm: float, error: type[Exception], said: str, found: keygraph.Detections
) -> None:
    with pytest.raises(error, match=said):
        keygraph.pose(found[0], intrinsics, width_mm)


def test_a_surface_is_a_grid_seen_through_the_lens(model: keygraph.Model, frame: Frame) -> None:
    (plain,) = keygraph.Detector(model).detect(frame)
    assert plain.surface is None, "a plane explains what is seen"
    (seen,) = keygraph.Detector(model, intrinsics=CAMERA, distortion=np.zeros((1, 5))).detect(frame)
    assert seen.surface is not None
    assert seen.surface.shape == (9, 9, 2)
    assert seen.surface.dtype == np.float32
    assert np.abs(seen.surface[[0, 0, -1, -1], [0, -1, -1, 0]] - plain.corners).max() < 1.5
    ours, theirs = keygraph.pose(seen, CAMERA, 200), keygraph.pose(plain, CAMERA, 200)
    assert ours is not None
    assert theirs is not None
    assert np.abs(ours.translation_mm - theirs.translation_mm).max() < 2


def test_mirrored_frames_have_no_pose(model: keygraph.Model, frame: Frame) -> None:
    (d,) = keygraph.Detector(model, mirror=True).detect(frame[:, ::-1])
    with pytest.raises(ValueError, match="mirrored frames has no pose"):
        keygraph.pose(d, (600, 600, 320, 240), 200)


def test_assessments() -> None:
    good = keygraph.assess(PICTURES / "coffee.jpg", profile="qqvga", views=1)
    assert good.object == "coffee" and 0 < good.score <= 100
    assert list(good.table) == ["scale", "rotation", "tilt", "blur", "darkness", "noise"]
    assert all(0 <= rate <= 1 for cells in good.table.values() for _, rate in cells)
    assert good.heat.shape == (*keygraph.imread(PICTURES / "coffee.jpg").shape[:2], 3)
    assert good._repr_png_()[:4] == b"\x89PNG" and str(good).startswith("object")
    assert repr(good).startswith('Assessment("coffee", score=')
    assert all("--" not in text for _, text in good.limits), "words of Python, not of the command line"
    plain = keygraph.assess(np.full((200, 200, 3), 128, np.uint8), name="plain")
    assert (plain.score, plain.limits[0][0], plain.table) == (0, "refused", {})
    assert plain.heat.shape == (200, 200, 3)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"views": 0}, "views: expected 1 to 1000"),
        ({"threads": 9}, "threads: expected 1 to 8"),
        ({"profile": "4k"}, 'profile: expected "hd"'),
        ({"preset": "x"}, "preset: expected"),
    ],
)
def test_what_is_no_assessment(options: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        keygraph.assess(PICTURES / "coffee.jpg", **options)


def test_an_assessment_is_of_one_object(model: keygraph.Model, coffee: keygraph.Model) -> None:
    with pytest.raises(ValueError, match="expected one object, got 2"):
        keygraph.assess(PICTURES / "coffee.jpg", keygraph.pack([model, coffee]))
    with pytest.raises(ValueError, match="512x512"):
        keygraph.assess(PICTURES / "coffee.jpg", model)


@pytest.mark.parametrize(
    ("options", "error", "said"),
    [
        ({"profile": "svga"}, ValueError, 'profile: expected "hd", "vga", "qvga" or "qqvga", got "svga"'),
        ({"threshold": 1.5}, ValueError, "threshold: expected 0 to 1, got 1.5"),
        ({"threshold": math.nan}, ValueError, "threshold"),
        ({"threshold": "high"}, TypeError, "threshold"),
        ({"min_visible": -1}, ValueError, "min_visible: expected 0 to 1"),
        ({"budget_ms": 0}, ValueError, "budget_ms: expected a number of ms above 0"),
        ({"threads": 0}, ValueError, "threads: expected 1 to 8, got 0"),
        ({"roi": (0, 0, 0, 10)}, ValueError, "above 0"),
        ({"roi": (0, 0, 10)}, ValueError, "roi: "),
        ({"roi": 4}, TypeError, r"roi: expected \(x, y, width, height\)"),
        ({"roi": "90%,0,20%,10%"}, ValueError, "beyond 100 %"),
        ({"surface": "can"}, ValueError, 'surface: expected "any" or "plane", got "can"'),
        ({"distortion": [0, 0, 0, 0]}, ValueError, "both intrinsics and distortion"),
        ({"intrinsics": CAMERA, "distortion": [0, 0, 0]}, ValueError, "4, 5 or 8 coefficients"),
        (
            {"intrinsics": CAMERA, "distortion": [0] * 5, "fisheye": True},
            ValueError,
            "4 coefficients of a fisheye lens",
        ),
        ({"intrinsics": CAMERA, "distortion": "0,0,0,0"}, TypeError, "expected a list of numbers"),
        ({"intrinsics": CAMERA, "distortion": [0] * 4, "mirror": True}, ValueError, "not mirrored"),
        ({"widest": True}, TypeError, "widest"),
    ],
)
def test_what_is_no_option(options: dict[str, Any], error: type[Exception], said: str, compact: keygraph.Model) -> None:
    for kind in (keygraph.Detector, keygraph.Tracker):
        with pytest.raises(error, match=said):
            kind(compact, **options)


def test_a_region_that_leaves_the_frame(compact: keygraph.Model, frame: Frame) -> None:
    detector = keygraph.Detector(compact, roi=(600, 0, 100, 100))
    for given in (frame, frame[:, ::-1], SEQUENCE[5]):
        with pytest.raises(ValueError, match=r"^roi 600,0,100,100 leaves the frame, which has 640x480 px"):
            detector.detect(given)
    assert keygraph.Detector(compact, roi=(600, 0, 100, 100)).detect(np.zeros((480, 700, 3), np.uint8)) == []


def test_a_search_that_is_stopped_says_so(model: keygraph.Model, frame: Frame) -> None:
    stopped = keygraph.Detector(model, budget_ms=1e-6).detect(frame)
    assert not stopped.complete and stopped.to_dict()["complete"] is False
    assert keygraph.Detector(model, budget_ms=1e6).detect(frame).complete


def test_what_they_say_of_themselves(model: keygraph.Model) -> None:
    detector, tracker = keygraph.Detector(model, "qvga", 0.5), keygraph.Tracker(model)
    assert repr(detector) == 'Detector(astronaut, profile="qvga", threshold=0.5)'
    assert repr(tracker) == 'Tracker(astronaut, profile="vga", threshold=0.8)'
    assert (detector.profile, detector.threshold, detector.model) == ("qvga", 0.5, model)
    for thing in (keygraph.train, keygraph.Detector, keygraph.Detector.detect, keygraph.Tracker.track, keygraph.pose):
        assert thing.__doc__ and "px" in thing.__doc__


def test_a_tracker_starts_anew(model: keygraph.Model, frame: Frame) -> None:
    tracker = keygraph.Tracker(model)
    first = [tracker.track(frame) for _ in range(3)]
    assert [f[0].state for f in first] == ["found", "tracked", "tracked"]
    assert [f.searched for f in first] == [True, False, False]
    assert {f[0].id for f in first} == {0} and first[0].ids is not None
    tracker.search_next()
    assert tracker.track(frame).searched
    tracker.reset()
    assert (tracker.track(frame)[0].id, tracker.track(frame[:470])[0].id) == (1, 2), "ids are not used again"
    (lost,) = tracker.track(np.zeros((470, 640, 3), np.uint8)).lost
    assert (lost.state, lost.id, lost.unseen, lost.rivals) == ("lost", 2, 1, [])
    with pytest.raises(ValueError, match="too small"):
        tracker.track(np.zeros((4, 4), np.uint8))
