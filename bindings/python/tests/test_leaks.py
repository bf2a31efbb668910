"""Calls leave nothing behind. `leaks.py` makes more of them."""

from __future__ import annotations

import sys

import keygraph
import pytest
from leaks import Caller, Rare, growth

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the memory of a process is read in /proc")

# The least that a frame could leave behind is its results, 2 KB.
CALLS, MOST_BYTES, MOST_BLOCKS = 1000, 1 << 20, 60


def test_calls_leave_nothing_behind() -> None:
    caller = Caller()
    grown, blocks = growth(caller, CALLS)
    assert grown < MOST_BYTES and blocks < MOST_BLOCKS, f"{CALLS} calls leave {grown} bytes and {blocks} blocks"
    grown, blocks = growth(Rare(caller), 100)
    assert grown < 2 * MOST_BYTES and blocks < MOST_BLOCKS, f"100 calls leave {grown} bytes and {blocks} blocks"


def test_the_test_of_leaks_can_fail() -> None:
    caller, kept = Caller(), list[keygraph.Detections]()
    grown, blocks = growth(lambda: kept.append(caller.detector.detect(caller.frame)), CALLS)
    assert grown > MOST_BYTES and blocks > MOST_BLOCKS
