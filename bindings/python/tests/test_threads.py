"""Threads: the interpreter is released, and results do not depend on who else searches."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import keygraph
import pytest
from conftest import PICTURES, SEQUENCE, timeless

FRAMES = [keygraph.imread(path) for path in SEQUENCE[::3]]


def results(detector: keygraph.Detector) -> list[dict[str, Any]]:
    return [timeless(detector.detect(frame).to_dict()) for frame in FRAMES]


def test_detectors_of_several_threads(model: keygraph.Model) -> None:
    expected = results(keygraph.Detector(model))
    with ThreadPoolExecutor(4) as pool:
        own = pool.map(results, [keygraph.Detector(model) for _ in range(4)])
        assert all(found == expected for found in own)
        one = keygraph.Detector(model)
        shared = pool.map(results, [one] * 4)
        assert all(found == expected for found in shared)


def test_trackers_and_training_of_several_threads(compact: keygraph.Model) -> None:
    def tracked(_: int) -> list[dict[str, Any]]:
        tracker = keygraph.Tracker(compact)
        return [timeless(tracker.track(frame).to_dict()) for frame in FRAMES]

    def trained(_: int) -> keygraph.Model:
        return keygraph.train(PICTURES / "astronaut.jpg", preset="compact")

    with ThreadPoolExecutor(4) as pool:
        tracks, models = pool.map(tracked, range(4)), pool.map(trained, range(4))
        expected = tracked(0)
        assert all(found == expected for found in tracks)
        assert all(model == compact for model in models)


def test_several_threads_search_one_frame(model: keygraph.Model) -> None:
    expected = results(keygraph.Detector(model))
    assert results(keygraph.Detector(model, threads=2)) == expected
    alone, together = keygraph.Tracker(model), keygraph.Tracker(model, threads=3)
    for frame in FRAMES:
        assert timeless(together.track(frame).to_dict()) == timeless(alone.track(frame).to_dict())


def test_a_forked_child_searches_alone(model: keygraph.Model) -> None:
    detector = keygraph.Detector(model, threads=2)
    expected = timeless(detector.detect(FRAMES[0]).to_dict())
    child = os.fork()
    if child == 0:
        signal.alarm(60)  # a child that waits for threads which it does not have
        os._exit(0 if timeless(detector.detect(FRAMES[0]).to_dict()) == expected else 1)
    assert os.waitpid(child, 0)[1] == 0


TRIES = 50


def is_released(work: Callable[[], Any]) -> bool:
    """Whether another thread of Python takes a step while `work` runs. The interpreter takes nothing
    from a thread meanwhile: a step is taken only where `work` gives way. A search may end before the
    system lets the other thread run, so there are some tries."""
    steps, ended, begun = 0, threading.Event(), threading.Event()

    def walk() -> None:
        nonlocal steps
        while not ended.is_set():
            steps += 1
            begun.set()
            time.sleep(0)  # This thread gives way after each step.

    usual = sys.getswitchinterval()
    # Before the other thread waits for its turn: a wait that has begun keeps its time.
    sys.setswitchinterval(1000)
    walker = threading.Thread(target=walk)
    try:
        walker.start()
        begun.wait()
        before = steps
        for _ in range(TRIES):
            work()
            if steps > before:
                return True
        return False
    finally:
        ended.set()
        walker.join()
        sys.setswitchinterval(usual)


def test_the_interpreter_is_released(model: keygraph.Model) -> None:
    detector, tracker, frame = keygraph.Detector(model), keygraph.Tracker(model), FRAMES[0]
    picture = keygraph.imread(PICTURES / "coffee.jpg")
    assert is_released(lambda: detector.detect(frame))
    assert is_released(lambda: tracker.track(frame))
    assert is_released(lambda: keygraph.train(picture, preset="compact"))
    assert is_released(lambda: keygraph.assess(picture, profile="qqvga", views=1))


def test_the_test_of_release_can_fail() -> None:
    assert not is_released(lambda: sum(range(100_000)))


def test_the_end_of_a_thread_that_failed_does_not_lock_a_detector(model: keygraph.Model) -> None:
    detector = keygraph.Detector(model)
    with ThreadPoolExecutor(2) as pool:
        for _ in range(8):
            with pytest.raises(ValueError, match="too small"):
                pool.submit(detector.detect, b"\0", format="gray", size=(1, 1)).result()
    assert detector.detect(FRAMES[0])
