"""Every kind of frame is the same frame, and what is none is refused in words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import keygraph
import numpy as np
import pytest
from conftest import SEQUENCE, timeless
from formats import raw
from numpy.typing import NDArray
from PIL import Image

Frame = NDArray[np.uint8]
FORMATS = ["rgb", "gray", "yuyv", "uyvy", "nv12", "i420", "rgb565", "rgb565be"]


@pytest.fixture(scope="module")
def detector(model: keygraph.Model) -> keygraph.Detector:
    return keygraph.Detector(model, digests=True)


def result(detector: keygraph.Detector, frame: Any, **reading: Any) -> dict[str, Any]:
    """What is found in a frame, and the digests of all stages."""
    return timeless(detector.detect(frame, **reading).to_dict())


def near(found: keygraph.Detections, frame_corners: NDArray[Any], most_px: float) -> None:
    assert len(found) == 1
    assert np.abs(found[0].corners - frame_corners).max() < most_px


def test_views_of_arrays_are_the_same_frame(detector: keygraph.Detector, frame: Frame) -> None:
    expected = result(detector, frame)
    assert expected["detections"][0]["object"] == "astronaut"
    wide = np.zeros((500, 700, 3), np.uint8)
    wide[10:490, 30:670] = frame
    deep = np.zeros((480, 640, 4), np.uint8)
    deep[..., :3] = frame
    tall = np.repeat(frame, 2, axis=0)
    read_only = frame.copy()
    read_only.flags.writeable = False
    views = {
        "a part of a larger frame": wide[10:490, 30:670],
        "every second row": tall[::2],
        "without opacity": deep[..., :3],
        "columns first in memory": np.asfortranarray(frame),
        "transposed": np.ascontiguousarray(frame.transpose(1, 0, 2)).transpose(1, 0, 2),
        "channels first in memory": np.ascontiguousarray(frame.transpose(2, 0, 1)).transpose(1, 2, 0),
        "upside down in memory": np.ascontiguousarray(frame[::-1])[::-1],
        "mirrored in memory": np.ascontiguousarray(frame[:, ::-1])[:, ::-1],
        "blue first in memory": np.ascontiguousarray(frame[..., ::-1])[..., ::-1],
        "read only": read_only,
        "of a subclass": frame.view(np.recarray),
    }
    for name, view in views.items():
        assert result(detector, view) == expected, name
    assert result(detector, np.ascontiguousarray(frame[..., ::-1]), order="bgr") == expected
    assert result(detector, frame[..., ::-1], order="bgr") == expected
    assert result(detector, wide[10:490, 30:670][..., ::-1], order="bgr") == expected
    assert result(detector, Image.fromarray(frame)) == expected


def test_a_transposed_frame_is_another_frame(detector: keygraph.Detector, frame: Frame) -> None:
    turned = frame.transpose(1, 0, 2)
    assert result(detector, turned) == result(detector, np.ascontiguousarray(turned))
    assert (detector.detect(turned).width, detector.detect(turned).height) == (480, 640)


def test_gray(detector: keygraph.Detector, frame: Frame) -> None:
    gray = np.ascontiguousarray(frame[..., 1])
    expected = result(detector, gray)
    assert expected["detections"]
    wide = np.zeros((480, 700), np.uint8)
    wide[:, 20:660] = gray
    for view in (gray[..., None], wide[:, 20:660], np.asfortranarray(gray), frame[..., 1], frame[..., 1:2]):
        assert result(detector, view) == expected
    assert result(detector, Image.fromarray(gray)) == expected


@pytest.mark.parametrize("form", FORMATS)
def test_raw_bytes(form: str, detector: keygraph.Detector, frame: Frame) -> None:
    data, size = raw(frame, form), (640, 480)
    near(detector.detect(data.tobytes(), format=form, size=size), detector.detect(frame)[0].corners, 1.5)
    expected = result(detector, data.tobytes(), format=form, size=size)
    for other in (data, bytearray(data), memoryview(data.tobytes())):
        assert result(detector, other, format=form, size=size) == expected
    rows = 720 if form in ("nv12", "i420") else 480
    assert result(detector, data.reshape(rows, -1), format=form) == expected
    if form not in ("nv12", "i420"):
        deep = data.reshape(480, 640, -1)
        assert result(detector, deep, format=form) == expected
        wide = np.zeros((480, 660, deep.shape[2]), np.uint8)
        wide[:, 10:650] = deep
        assert result(detector, wide[:, 10:650], format=form) == expected
    # Rows with something between them.
    row = data.reshape(rows, -1) if form != "i420" else data.reshape(-1, 320)
    pad = 8 if form != "i420" else 4
    padded = np.pad(row, ((0, 0), (0, pad)), constant_values=99)
    stride = padded.shape[1] * (2 if form == "i420" else 1)
    if form == "i420":
        padded = np.concatenate(
            [np.pad(data[: 640 * 480].reshape(480, 640), ((0, 0), (0, 8))).ravel(), padded[960:].ravel()]
        )
    assert result(detector, padded.tobytes(), format=form, size=size, stride=stride) == expected


@pytest.mark.parametrize("form", FORMATS)
def test_raw_bytes_that_are_scaled_down_or_cut(form: str, model: keygraph.Model, frame: Frame) -> None:
    data, size = raw(frame, form).tobytes(), (640, 480)
    corners = keygraph.Detector(model).detect(frame)[0].corners
    near(keygraph.Detector(model, profile="qvga").detect(data, format=form, size=size), corners, 3)
    part = keygraph.Detector(model, roi=(20, 10, 600, 460)).detect(data, format=form, size=size)
    near(part, corners, 2)
    assert part.to_dict()["roi"] == [20, 10, 600, 460]
    mirrored = raw(np.ascontiguousarray(frame[:, ::-1]), form).tobytes()
    found = keygraph.Detector(model, mirror=True).detect(mirrored, format=form, size=size)
    near(found, corners * [-1, 1] + [639, 0], 2)
    assert np.linalg.det(found[0].homography) < 0


def test_an_odd_height_of_video_loses_its_last_row(model: keygraph.Model, frame: Frame) -> None:
    data = raw(frame, "yuyv").reshape(480, -1)[:479].tobytes()
    for profile in ("vga", "qvga"):
        assert len(keygraph.Detector(model, profile=profile).detect(data, format="yuyv", size=(640, 479))) == 1


def test_images_of_pil(detector: keygraph.Detector, frame: Frame, tmp_path: Path) -> None:
    image = Image.fromarray(frame)
    image.save(tmp_path / "f.png")
    with Image.open(tmp_path / "f.png") as lazy:
        assert result(detector, lazy) == result(detector, frame)
    opacity = Image.fromarray(np.tile(np.linspace(100, 255, 640).astype(np.uint8), (480, 1)))
    clear = image.copy()
    clear.putalpha(opacity)
    clear.save(tmp_path / "clear.png")
    # Files and images with opacity are mixed with white alike.
    of_file = result(detector, tmp_path / "clear.png")
    assert result(detector, clear) == {**of_file, "source": ""}
    assert detector.detect(image.quantize(256))[0].object == "astronaut"
    assert detector.detect(image.convert("CMYK"))[0].object == "astronaut"
    with pytest.raises(ValueError, match='mode "I;16" has more than 8 bits'):
        detector.detect(Image.new("I;16", (64, 64)))


def test_paths(detector: keygraph.Detector) -> None:
    path = SEQUENCE[5]
    assert result(detector, str(path)) == result(detector, path)
    assert detector.detect(path).to_dict()["source"] == str(path)
    assert detector.detect(path).to_dict(source="camera", frame=7)["source"] == "camera"


def test_the_array_is_not_changed_and_not_kept_by_a_detection(detector: keygraph.Detector, frame: Frame) -> None:
    import sys

    mine = frame.copy()
    before = sys.getrefcount(mine)
    (detection,) = detector.detect(mine)
    assert sys.getrefcount(mine) == before
    assert np.array_equal(mine, frame)
    assert detection.object == "astronaut"


@pytest.mark.parametrize(
    ("given", "reading", "error", "said"),
    [
        (np.zeros((480, 640, 3)), {}, TypeError, r"uint8, got float64: .*\(frame \* 255\)"),
        (np.zeros((480, 640, 3), np.int8), {}, TypeError, "got int8"),
        (np.zeros((480, 640), bool), {}, TypeError, "got bool"),
        (np.zeros((480, 640, 4), np.uint8), {}, ValueError, r"got \(480, 640, 4\): leave opacity out"),
        (np.zeros((480, 640, 2), np.uint8), {}, ValueError, 'format="yuyv"'),
        (np.zeros((3, 480, 640), np.uint8), {}, ValueError, r"got \(3, 480, 640\): channels come last"),
        (np.zeros((2, 480, 640, 3), np.uint8), {}, ValueError, "one by one"),
        (np.zeros(100, np.uint8), {}, ValueError, r"got \(100,\): give format="),
        (np.uint8(3), {}, TypeError, "got uint8"),
        (np.array(3, np.uint8), {}, ValueError, r"got \(\)"),
        (np.zeros((0, 0, 3), np.uint8), {}, ValueError, "0x0 is too small; each side must have at least 16 px"),
        (np.zeros((480, 0, 3), np.uint8), {}, ValueError, "0x480 is too small"),
        (np.zeros((15, 640, 3), np.uint8), {}, ValueError, "640x15 is too small"),
        (np.zeros((15, 640, 3), np.uint8)[:, ::-1], {}, ValueError, "640x15 is too small"),
        (np.zeros((20, 3000, 3), np.uint8), {}, ValueError, "3000x20 px, 640x4 at this profile.*too small"),
        (np.zeros((480, 640), np.uint8), {"order": "bgr"}, ValueError, r'"bgr" expects an array of shape \(H, W, 3\)'),
        (np.zeros((480, 640, 3), np.uint8), {"order": "gbr"}, ValueError, 'order: expected "rgb" or "bgr", got "gbr"'),
        (np.zeros((480, 640, 3), np.uint8), {"size": (640, 480)}, ValueError, "size and stride go with format"),
        (b"\0" * 100, {}, ValueError, 'bytes have no shape: give format="yuyv"'),
        (b"\0" * 100, {"format": "yuyv"}, ValueError, "size is missing"),
        (b"\0" * 100, {"format": "yuv9", "size": (4, 4)}, ValueError, 'expected one of "rgb", .*, got "yuv9"'),
        (b"\0" * 100, {"format": "yuyv", "size": (64, 48)}, ValueError, "buffer has 100 bytes.*has 6144"),
        (b"\0" * 6144, {"format": "yuyv", "size": (65, 48)}, ValueError, "width 65 is odd"),
        (b"\0" * 6144, {"format": "nv12", "size": (64, 49)}, ValueError, "height 49 is odd"),
        (b"\0" * 6144, {"format": "yuyv", "size": (64, 48), "stride": 100}, ValueError, "stride of 100 bytes"),
        (b"\0" * 6144, {"format": "gray", "size": (1 << 40, 1 << 40)}, ValueError, "do not fit"),
        (b"\0" * 6144, {"format": "gray", "size": (64, 48), "stride": 2**63}, ValueError, "a frame of this size"),
        (b"\0" * 6144, {"format": "yuyv", "size": (64, 48), "order": "bgr"}, ValueError, "and not with format"),
        (b"\0" * 6144, {"format": "yuyv", "size": (-64, 48)}, OverflowError, "negative"),
        (np.zeros((48, 128), np.uint8)[:, ::2], {"format": "gray"}, ValueError, "must be contiguous"),
        ([[1, 2], [3, 4]], {}, TypeError, "expected a numpy array of uint8, a PIL image.*got list"),
        (None, {}, TypeError, "got NoneType"),
        (7, {}, TypeError, "got int"),
        ("no/such/file.png", {}, FileNotFoundError, "no/such/file.png"),
        (__file__, {}, ValueError, "is not a PNG, JPEG"),
        (__file__, {"format": "yuyv", "size": (64, 48)}, ValueError, "not with a path"),
        (Image.new("L", (64, 64)), {"format": "gray", "size": (64, 64)}, ValueError, "not with a PIL image"),
    ],
)
def test_what_is_no_frame(
    given: Any, reading: dict[str, Any], error: type[Exception], said: str, detector: keygraph.Detector
) -> None:
    with pytest.raises(error, match=said):
        detector.detect(given, **reading)


def test_a_folder_is_no_frame(detector: keygraph.Detector, tmp_path: Path) -> None:
    with pytest.raises(OSError, match="cannot be read"):
        detector.detect(tmp_path)
