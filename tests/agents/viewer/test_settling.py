"""What came or went is told once it lasts, with the time at which it did."""

from __future__ import annotations

from agents.viewer.settling import Settling, Shift

HAND = ("hand", "", "")
CUBE = ("cube", "", "")
ON = ("cube", "table", "on")


def told(settling: Settling, now: float) -> list[tuple[float, list[tuple[str, bool]]]]:
    return [
        (together[0].time, [(settled.shift.subject[0], settled.shift.is_there) for settled in together])
        for together in settling.settled(now)
    ]


def test_what_lasts_is_told_once() -> None:
    settling = Settling()
    settling.note(Shift(CUBE, True), 5.0)
    assert told(settling, 5.5) == []
    assert told(settling, 6.0) == [(5.0, [("cube", True)])]
    assert told(settling, 7.0) == []


def test_what_flickers_is_not_told() -> None:
    settling = Settling()
    for step in range(10):
        settling.note(Shift(HAND, step % 2 == 0), step * 0.4)
        assert told(settling, step * 0.4) == []
    assert told(settling, 100.0) == []


def test_a_short_absence_is_not_told() -> None:
    settling = Settling()
    settling.note(Shift(HAND, True), 0.0)
    assert told(settling, 1.0) == [(0.0, [("hand", True)])]
    settling.note(Shift(HAND, False), 2.0)
    settling.note(Shift(HAND, True), 2.5)
    assert told(settling, 10.0) == []
    settling.note(Shift(HAND, False), 11.0)
    assert told(settling, 12.0) == [(11.0, [("hand", False)])]


def test_what_came_at_the_same_time_is_together_and_the_earlier_first() -> None:
    settling = Settling()
    settling.note(Shift(HAND, True), 2.0)
    settling.note(Shift(CUBE, True), 1.0)
    settling.note(Shift(ON, True), 1.0)
    assert told(settling, 9.0) == [(1.0, [("cube", True), ("cube", True)]), (2.0, [("hand", True)])]


def test_a_replay_that_goes_back_keeps_nothing_waiting() -> None:
    settling = Settling()
    settling.note(Shift(CUBE, True), 50.0)
    assert told(settling, 10.0) == [(50.0, [("cube", True)])]
