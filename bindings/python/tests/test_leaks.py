"""Calls leave nothing behind. `leaks.py` makes more of them."""

from __future__ import annotations

import platform
from collections.abc import Callable

import pytest
from leaks import Caller, Rare, growth

pytestmark = pytest.mark.skipif(
    platform.libc_ver()[0] != "glibc", reason="the allocator is asked, which glibc's answers"
)

# The least that a call could leave behind is one block, or the 700 bytes of a frame. Measuring leaves some ten blocks
# or takes a few away.
CALLS, MOST_BYTES, MOST_BLOCKS = 40, 3_000, 30


def leaks(call: Callable[[], object]) -> str | None:
    """What `CALLS` calls leave behind, if it is as much as something for each of them."""
    grown, blocks = growth(call, CALLS)
    if grown < MOST_BYTES and blocks < MOST_BLOCKS:
        return None
    return f"{CALLS} calls leave {grown} bytes and {blocks} blocks"


def test_calls_leave_nothing_behind() -> None:
    caller = Caller()
    assert leaks(caller) is None
    assert leaks(Rare(caller)) is None


def test_the_test_of_leaks_can_fail() -> None:
    kept = list[object]()
    assert leaks(lambda: kept.append(object())) is not None
    kept = list[object]()
    caller = Caller()
    assert leaks(lambda: kept.append(caller.detector.detect(caller.frame))) is not None
    kept = list[object]()
    assert leaks(lambda: kept.append(bytearray(700))) is not None
