"""Texts of attributes are whatever somebody wrote: no such text takes long, ends its reader or tells absurd numbers."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from typing import Any

import msgspec
import pytest

from dsr import GoalError, Pose
from dsr.believing.distribution import decoded
from dsr.persistence.cortex_values import Note
from dsr.vocabulary.calibration import CALIBRATION, Report, read_report
from dsr.vocabulary.explained import changes_of
from dsr.vocabulary.goals import parse_goal
from tests.dsr.conftest import Net

LONG = 50_000
NESTED = '{"x": ' + "[" * 10_000
REPORT = Report("camera", "world", "", False, "", (0.0,) * 6 + (1.0,), (0.0,) * 6 + (1.0,), (0.0,) * 36, 0.0, 0.0, 1.0,
                False, 1, 1, 1, ())  # fmt: skip


def whereabouts(**place: Any) -> str:
    one = {"weight": 1.0, "worlds": [0], "gone": False, "at": [0.0, 0.0, 0.0], "turn": [0.0, 0.0, 0.0, 1.0], **place}
    return msgspec.json.encode({"island": [], "weights": [1.0], "alternatives": [one]}).decode()


@pytest.mark.parametrize(
    "read",
    [
        lambda: changes_of({}, "a" * LONG),
        lambda: changes_of({}, "a(" * LONG),
        lambda: parse_goal("on(a,b)" + " " * LONG),
        lambda: parse_goal("\t" * LONG),
    ],
    ids=["a word", "words", "spaces after a goal", "spaces"],
)
def test_no_text_takes_long(read: Callable[[], object]) -> None:
    """Each took a time with the square of the length before: two hours for the longest text."""
    begin = time.process_time()
    with contextlib.suppress(GoalError):
        read()
    assert time.process_time() - begin < 1.0


def test_goals_and_changes_are_read_as_before() -> None:
    assert str(parse_goal(" on(a, b)  &\n clear(c) \n ")) == "on(a,b) & clear(c)"
    (one, other) = changes_of({}, "turned(cube) & moved_with_supports(cube_3; cube_4, cube_5)")
    assert (one.kind, other.groups) == ("turned", (("cube_3",), ("cube_4", "cube_5")))


def test_nested_texts_end_nobody(net: Net) -> None:
    memory = net.join("a")
    memory.add_node("request", CALIBRATION, report=NESTED)
    assert read_report(memory, "request") is None
    assert decoded("cube", NESTED, None) is None
    assert Note.decoded(NESTED) == Note()
    assert changes_of({"changes": "[" * 10_000}) == ()


def test_a_place_in_a_text_is_no_farther_than_a_pose_may_be() -> None:
    """A pose beyond that is taken away by all replicas; in a text nobody looked at it before."""
    assert decoded("cube", whereabouts(), None) is not None
    assert decoded("cube", whereabouts(at=[1e13, 0.0, 0.0]), None) is None
    assert decoded("cube", whereabouts(covariance=[1e13] + [0.0] * 20), Pose()) is None


def test_a_report_of_a_calibration_tells_no_absurd_pose(net: Net) -> None:
    memory = net.join("a")
    memory.add_node("request", CALIBRATION, report=msgspec.json.encode(REPORT).decode())
    assert read_report(memory, "request") == REPORT
    told = msgspec.to_builtins(REPORT) | {"after": [1e13, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]}
    memory.update_node("request", report=msgspec.json.encode(told).decode())
    assert read_report(memory, "request") is None
