"""Calls leave nothing behind. `leaks.py` makes more of them."""

from __future__ import annotations

import platform

import keygraph
import pytest
from leaks import Caller, Rare, growth

pytestmark = pytest.mark.skipif(
    platform.libc_ver()[0] != "glibc", reason="the allocator is asked, which glibc's answers"
)

# Measuring takes some 30 blocks twice. The least that a frame could leave behind is one block, or its 700 bytes.
CALLS, MOST_BYTES, MOST_BLOCKS = 240, 20_000, 150


def test_calls_leave_nothing_behind() -> None:
    caller = Caller()
    grown, blocks = growth(caller, CALLS)
    assert grown < MOST_BYTES and blocks < MOST_BLOCKS, f"{CALLS} calls leave {grown} bytes and {blocks} blocks"
    grown, blocks = growth(Rare(caller), CALLS // 2)
    assert grown < MOST_BYTES and blocks < MOST_BLOCKS, f"{CALLS // 2} calls leave {grown} bytes and {blocks} blocks"


def test_the_test_of_leaks_can_fail() -> None:
    caller, kept = Caller(), list[keygraph.Detections]()
    grown, blocks = growth(lambda: kept.append(caller.detector.detect(caller.frame)), CALLS)
    assert grown > MOST_BYTES and blocks > MOST_BLOCKS
