"""What the tests share: pictures of the repository, models of them, and the command line."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import keygraph
import numpy as np
import pytest
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[3]
PICTURES = ROOT / "assets/pictures"
SEQUENCE = sorted((ROOT / "assets/sequence").glob("*.jpg"))

Command = Callable[..., list[dict[str, Any]]]


@pytest.fixture(scope="session")
def model() -> keygraph.Model:
    """The astronaut, as the command line trains it unless told otherwise."""
    return keygraph.train(PICTURES / "astronaut.jpg")


@pytest.fixture(scope="session")
def coffee() -> keygraph.Model:
    return keygraph.train(PICTURES / "coffee.jpg")


@pytest.fixture(scope="session")
def compact() -> keygraph.Model:
    return keygraph.train(PICTURES / "astronaut.jpg", preset="compact")


@pytest.fixture(scope="session")
def frame() -> NDArray[np.uint8]:
    """A frame of 640 x 480 px that shows the astronaut."""
    return keygraph.imread(SEQUENCE[5])


@pytest.fixture(scope="session")
def model_file(model: keygraph.Model, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("models") / "astronaut.kgm"
    model.save(path)
    return path


@pytest.fixture(scope="session")
def command() -> Command:
    """Runs the command line, whose binary is in KEYGRAPH, on standard input that is given, and returns its lines of
    JSON."""
    binary = os.environ.get("KEYGRAPH")
    if not binary:
        if os.environ.get("KEYGRAPH_MUST_NOT_SKIP"):
            pytest.fail("KEYGRAPH names no binary, and nothing may be skipped")
        pytest.skip("KEYGRAPH names no binary of the command line: run scripts/test-python")

    def run(*arguments: object, given: bytes = b"") -> list[dict[str, Any]]:
        done = subprocess.run([binary, *map(str, arguments)], check=True, stdout=subprocess.PIPE, input=given)
        return [json.loads(line) for line in done.stdout.splitlines() if line.startswith(b"{")]

    return run


def timeless(line: dict[str, Any]) -> dict[str, Any]:
    """A line without its times, which differ from run to run."""
    return {key: value for key, value in line.items() if key != "time_ms"}
