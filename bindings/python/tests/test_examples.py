"""The examples run, and find what they look for."""

from __future__ import annotations

import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import PICTURES, ROOT

EXAMPLES = ROOT / "bindings/python/examples"


def run(name: str, *arguments: object) -> str:
    done = subprocess.run(
        [sys.executable, EXAMPLES / name, *map(str, arguments)], capture_output=True, text=True, cwd="/"
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_tutorial(tmp_path: Path) -> None:
    said = run("tutorial.py", tmp_path)
    assert "astronaut #0 tracked" in said and "score " in said and "ambiguous: False" in said
    for name in ("heat.png", "found.png", "upright.png", "pose.png"):
        assert (tmp_path / name).stat().st_size > 10_000


def test_the_webcam(monkeypatch: pytest.MonkeyPatch) -> None:
    cv2 = pytest.importorskip("cv2")
    # A video of the sequence instead of a camera, and a window that keeps what it is shown.
    shown: list[np.ndarray] = []
    video = cv2.VideoCapture(str(ROOT / "assets/sequence/%04d.jpg"))
    monkeypatch.setattr(cv2, "VideoCapture", lambda _: video)
    monkeypatch.setattr(cv2, "waitKey", lambda _: 27 if len(shown) == 6 else -1)
    monkeypatch.setattr(cv2, "imshow", lambda _, frame: shown.append(frame))
    monkeypatch.setattr(sys, "argv", ["webcam.py", str(PICTURES / "astronaut.jpg")])
    runpy.run_path(str(EXAMPLES / "webcam.py"), run_name="__main__")
    assert len(shown) == 6
    for frame in shown:
        assert (frame == (80, 220, 64)).all(-1).sum() > 1500, "an outline is drawn"


def test_the_benchmark_finds_what_its_rivals_find() -> None:
    pytest.importorskip("cv2")
    said = run("speed.py", 1, 6)
    rows = {line[:24].strip(): line.split()[-1] for line in said.splitlines() if line[:24].strip()}
    assert int(rows["keygraph"]) >= 5 and int(rows["OpenCV SIFT"]) >= 5, said
    apart = [float(line.split(" lie ")[1].split()[0]) for line in said.splitlines() if " lie " in line]
    assert len(apart) == 2 and max(apart) < 5, "the outlines are of one object"
