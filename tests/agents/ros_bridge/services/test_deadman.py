"""The process that cancels motions of an arm in ROS: when signs of life end, and when the driver dies."""

from __future__ import annotations

import os
import secrets
import threading
from collections.abc import Iterator
from contextlib import suppress

import pytest

from agents.ros_bridge.services.deadman import Deadman, watch
from dsr.clock import WALL_CLOCK

PATIENCE = 0.2


class Watched:
    """`watch` in a thread, at the other end of a pipe."""

    def __init__(self) -> None:
        self.source, self.pipe = os.pipe()
        self.cancelled = threading.Semaphore(0)
        self.thread = threading.Thread(target=watch, args=(self.source, PATIENCE, self.cancelled.release), daemon=True)
        self.thread.start()

    def close(self) -> None:
        with suppress(OSError):
            os.close(self.pipe)
        self.thread.join(10.0)
        os.close(self.source)


@pytest.fixture
def watched() -> Iterator[Watched]:
    one = Watched()
    yield one
    one.close()


def pause(seconds: float) -> None:
    WALL_CLOCK.wait(threading.Event(), seconds)


def test_silence_after_a_sign_of_life_cancels_once_and_another_sign_begins_anew(watched: Watched) -> None:
    for _ in range(2):
        os.write(watched.pipe, b".")
        assert watched.cancelled.acquire(timeout=10.0)
        pause(2 * PATIENCE)
        assert not watched.cancelled.acquire(blocking=False)


def test_nothing_is_cancelled_before_the_first_sign_of_life_and_after_a_farewell(watched: Watched) -> None:
    pause(2 * PATIENCE)
    os.write(watched.pipe, b"..q")
    watched.thread.join(10.0)
    assert not watched.thread.is_alive() and not watched.cancelled.acquire(blocking=False)


def test_a_driver_whose_own_way_is_blocked_may_ask_for_it(watched: Watched) -> None:
    os.write(watched.pipe, b"c")
    assert watched.cancelled.acquire(timeout=10.0)
    os.write(watched.pipe, b"cq")
    assert watched.cancelled.acquire(timeout=10.0)
    watched.thread.join(10.0)
    assert not watched.thread.is_alive()


def test_a_driver_that_dies_without_a_word_has_its_motions_cancelled(watched: Watched) -> None:
    os.write(watched.pipe, b".")
    os.close(watched.pipe)
    assert watched.cancelled.acquire(timeout=10.0)
    watched.thread.join(10.0)
    assert not watched.thread.is_alive()


def test_the_process_prints_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    domain = 20 + secrets.randbelow(200)
    deadman = Deadman({"transport": "dds", "domain": domain}, "/follow", 60.0)
    deadman.alive()
    deadman.close()
    assert deadman.ended and capfd.readouterr() == ("", "")
