"""Seconds of the view: as the story of the run counts them."""

from __future__ import annotations

import logging
import math

import msgspec
import pytest
import rerun as rr

from agents.inbox import Message
from agents.viewer.elapsed import Elapsed
from dsr.vocabulary.replayed import Replayed
from dsr.vocabulary.scenario_start import LEAD, Start

T = 1_700_000_000.0


def elapsed(*, awaits_start: bool) -> Elapsed:
    return Elapsed(rr.RecordingStream("test"), awaits_start, logging.getLogger("test"))


def start(stamp: float) -> Message:
    return Message(T, "key", msgspec.msgpack.encode(Start(stamp)))


def test_seconds_count_from_the_first_look() -> None:
    time = elapsed(awaits_start=False)
    assert [time.seconds(T), time.seconds(T + 2.5), time.seconds(T - 1.0)] == [0.0, 2.5, -1.0]


def test_seconds_count_from_the_start_of_a_scenario() -> None:
    time = elapsed(awaits_start=True)
    assert [time.seconds(T), time.seconds(T + 9.0)] == [-LEAD, -LEAD]
    time.note_start(start(T + 10.0))
    assert time.seconds(T + 12.0) == 2.0
    assert time.text(T + 22.5) == "  12.5 s"


def test_nothing_is_drawn_before_what_was_drawn_while_the_start_was_awaited() -> None:
    time = elapsed(awaits_start=True)
    before = time.seconds(T)
    time.note_start(start(T + LEAD))
    assert time.seconds(T) >= before


def test_a_view_that_joins_a_scenario_counts_from_its_start() -> None:
    time = elapsed(awaits_start=False)
    assert time.seconds(T) == 0.0
    time.note_start(start(T - 30.0))
    assert time.seconds(T + 1.0) == 31.0


@pytest.mark.parametrize("stamp", [1e300, -1e300, math.nan, math.inf, 0.0])
def test_what_is_no_time_is_told_so(stamp: float) -> None:
    time = elapsed(awaits_start=False)
    time.set(T)
    time.set(stamp)
    assert time.text(stamp) == "at no time"


def test_malformed_starts_are_counted() -> None:
    time = elapsed(awaits_start=True)
    for payload in (b"", b"soon", msgspec.msgpack.encode(Start(math.inf))):
        time.note_start(Message(T, "key", payload))
    assert time.malformed == 3 and time.seconds(T) == -LEAD


def test_the_time_of_a_replay_is_that_of_the_recording() -> None:
    time = elapsed(awaits_start=False)
    assert time.now(T) == T
    time.note_replayed(Message(T, "key", msgspec.msgpack.encode(Replayed(1_000_012.5, 1_000_000.0))))
    assert time.now(T) == 1_000_012.5 and time.seconds(time.now(T)) == 12.5


def test_malformed_times_of_a_replay_are_counted() -> None:
    time = elapsed(awaits_start=False)
    for payload in (b"", b"soon", msgspec.msgpack.encode(Replayed(math.nan, 0.0))):
        time.note_replayed(Message(T, "key", payload))
    assert time.malformed == 3 and time.now(T) == T
