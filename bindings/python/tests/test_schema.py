"""Lines of the command line and of `to_dict` against docs/schema/detection.json and docs/detection.md."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import keygraph
import pytest
from conftest import PICTURES, ROOT, SEQUENCE, Command
from jsonschema import Draft202012Validator, ValidationError

SCHEMA: dict[str, Any] = json.loads((ROOT / "docs/schema/detection.json").read_text())


def strict(schema: dict[str, Any]) -> dict[str, Any]:
    """The schema that also refuses fields that it does not describe."""
    closed: dict[str, Any] = json.loads(json.dumps(schema))
    for part in closed["$defs"].values():
        if (
            part.get("type") == "object"
            and "additionalProperties" not in part
            and part is not closed["$defs"]["motion"]
        ):
            part["unevaluatedProperties" if "$ref" in part else "additionalProperties"] = False
    # What others refer to, and add to, is closed where it is referred to.
    closed["$defs"]["detection"].pop("additionalProperties", None)
    for name in ("frame",):
        closed["$defs"][name]["properties"]["detections"]["items"]["unevaluatedProperties"] = False
        closed["$defs"][name]["properties"]["lost"]["items"]["unevaluatedProperties"] = False
    closed["$defs"]["pose"]["unevaluatedProperties"] = False
    closed["$defs"]["pose"]["properties"]["mirrored"]["unevaluatedProperties"] = False
    return closed


CHECK = Draft202012Validator(strict(SCHEMA))


def lines(command: Command, model: keygraph.Model, file: Path, empty: Path) -> Iterator[dict[str, Any]]:
    """Lines with every field that there is."""
    camera = ["--intrinsics", "600,600,319.5,239.5", "--width-mm", "200"]
    yield from command("detect", "-m", file, "--json", "--digests", *camera, *SEQUENCE[::8])
    yield from command("detect", "-m", file, "--json", "--distortion", "0,0,0,0", *camera, SEQUENCE[5])
    yield from command("detect", "-m", file, "--json", "--track", *SEQUENCE)
    yield from command("detect", "-m", file, "--json", "--mirror", "--roi", "0,0,90%,90%", SEQUENCE[5])
    yield from command("detect", "-m", file, "--json", "--budget-ms", "0.000001", SEQUENCE[5])
    # Pictures one after the other are those of a camera, with times of day.
    motion = b"".join(path.read_bytes() for path in SEQUENCE[4:6])
    yield from command("detect", "-m", file, "--json", "-", given=motion)
    detector, tracker = keygraph.Detector(model, digests=True), keygraph.Tracker(model)
    for path in SEQUENCE:
        yield detector.detect(path).to_dict()
        yield tracker.track(keygraph.imread(path)).to_dict()
    yield keygraph.Detector([model, keygraph.train(empty, "other")], all_names=True, threshold=0).detect(path).to_dict()


def fields(value: Any) -> set[str]:
    """All keys in a value."""
    if isinstance(value, list):
        return set().union(*map(fields, value))
    if not isinstance(value, dict):
        return set()
    return set(value) | set().union(*(fields(v) for k, v in value.items() if k not in ("stages", "time_ms", "digests")))


def described() -> set[str]:
    """The fields that the schema describes."""
    parts = [part.get("properties", {}) for name, part in SCHEMA["$defs"].items() if name != "counts"]
    return set().union(*parts)


def test_the_schema_is_one() -> None:
    Draft202012Validator.check_schema(SCHEMA)
    Draft202012Validator.check_schema(strict(SCHEMA))


def test_real_lines_match_and_show_every_field(command: Command, model: keygraph.Model, model_file: Path) -> None:
    seen: set[str] = set()
    for line in lines(command, model, model_file, PICTURES / "coffee.jpg"):
        CHECK.validate(line)
        seen |= fields(line)
    # Axes are in lines of a camera, and the sequence shows no can.
    cylinder = {"cylinder", "radius_mm", "axis", "centre_mm"}
    assert seen == described() - {"error", "axes"} - cylinder


def test_a_frame_that_cannot_be_read(tmp_path: Path, model_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import os
    import subprocess

    binary = os.environ.get("KEYGRAPH")
    if not binary:
        pytest.skip("KEYGRAPH names no binary")
    (tmp_path / "no.png").write_bytes(b"no picture")
    done = subprocess.run(
        [binary, "detect", "-m", model_file, "--json", tmp_path / "no.png"], capture_output=True, text=True
    )
    line = json.loads(done.stdout)
    CHECK.validate(line)
    assert "is not a PNG, JPEG" in line["error"]


@pytest.mark.parametrize(
    "change",
    [
        {"detections": [{"object": "a"}]},
        {"surprise": 1},
        {"width": 0},
        {"time_ms": None},
        {"time": "2026-11-29 20:31:05"},
        {"complete": True},
        {"lost": [{"state": "found"}]},
    ],
)
def test_the_schema_refuses(change: dict[str, Any], model: keygraph.Model) -> None:
    line = keygraph.Detector(model).detect(SEQUENCE[5]).to_dict()
    CHECK.validate(line)
    with pytest.raises(ValidationError):
        CHECK.validate({**line, **change})
    wrong = json.loads(json.dumps(line))
    wrong["detections"][0]["score"] = 1.5
    with pytest.raises(ValidationError):
        CHECK.validate(wrong)


def test_the_document_describes_the_fields_of_the_schema() -> None:
    text = (ROOT / "docs/detection.md").read_text()
    rows = [line.split("|")[1] for line in text.splitlines() if line.startswith("| `")]
    named = {name for row in rows for name in re.findall(r"`(\w+)`", row)}
    assert named == described()
    assert "version 1" in SCHEMA["title"] and "**version 1**" in text
