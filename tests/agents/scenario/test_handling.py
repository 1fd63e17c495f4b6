"""Hands in scenario files: those that move are there, and those that are named are in the file."""

from __future__ import annotations

import pytest

from agents.scenario.format.scenario import parse_scenario
from tests.agents.scenario.test_format import BASE, refusal

ENTER = "do = 'hand_enter'\nposition = [0.3, 0.0, 0.2]\n"
MOVE = "do = 'hand_move'\nby = [0.0, 0.0, 0.1]\n"
RELEASE, LEAVE = "do = 'hand_release'\n", "do = 'hand_leave'\n"
LIFT = "do = 'lift'\nobject = 'a'\nheight = 0.1\n"
WAIT = "when = 'resting(a)'\n"


def at(seconds: float) -> str:
    return f"at = {seconds}\n"


def with_events(*events: str, expected: str = "") -> str:
    return BASE + "".join(f"\n[[event]]\n{event}" for event in events) + expected


@pytest.mark.parametrize(
    ("events", "number", "name"),
    [
        ([MOVE + at(1)], 1, "hand_move"),
        ([MOVE + WAIT], 1, "hand_move"),
        ([RELEASE + at(1)], 1, "hand_release"),
        ([LEAVE + at(1)], 1, "hand_leave"),
        ([MOVE + at(1), ENTER + at(2)], 1, "hand_move"),
        ([ENTER + at(1) + "delay = 3", MOVE + at(2)], 2, "hand_move"),
        ([ENTER + at(1) + "hand = 1\n", MOVE + at(2)], 2, "hand_move"),
        ([LIFT + at(1), MOVE + at(2)], 2, "hand_move"),
        ([ENTER + at(1), LEAVE + at(2), RELEASE + at(5)], 3, "hand_release"),
    ],
)
def test_a_hand_that_moves_must_be_there(events: list[str], number: int, name: str):
    message = f"event.{number}: {name}: hand 0 is not in the scene then; expected hand_enter or hand_grasp before"
    assert message in refusal(with_events(*events))


@pytest.mark.parametrize(
    "events",
    [
        [ENTER + at(1), MOVE + at(2), RELEASE + at(3), LEAVE + at(4)],
        [MOVE + at(2), ENTER + at(1)],
        [ENTER + at(1), MOVE + at(1)],
        [LIFT + at(1) + "hand = 0\n", MOVE + at(2)],
        [ENTER + at(1), LEAVE + at(2), ENTER + at(4), MOVE + at(5)],
        [ENTER + WAIT, MOVE + at(5)],
        [ENTER + at(1), MOVE + WAIT],
        [ENTER + at(1), LEAVE + WAIT, MOVE + at(5)],
    ],
)
def test_a_hand_that_may_be_there_may_move(events: list[str]):
    assert len(parse_scenario(with_events(*events)).events) == len(events)


def expecting(*terms: str) -> str:
    return f"\n[[expect]]\ncheck = 'actions'\npresent = {list(terms)}\n"


def test_who_shall_have_done_something_is_in_the_file():
    text = with_events(ENTER + at(1), expected=expecting("Place(a)", "Pick(a, human_hand_7)"))
    assert "expect.1.present.2: nobody is called 'human_hand_7' here; valid: human_hand_0, " in refusal(text)
    assert "nobody is called 'human_hand_0'" in refusal(BASE + expecting("Pick(a, human_hand_0)"))
    fine = expecting("Pick(a, human_hand_1)", "Pick(a, gripper)", "Pick(a, unknown)")
    parse_scenario(with_events(LIFT + at(1) + "hand = 1\n", expected=fine))


@pytest.mark.parametrize(
    ("event", "message"),
    [
        (
            "do = 'tilt'\nobject = 'a'\nangle = 1.0\naxis = [0, 0, 0]",
            "event.1.axis: expected a direction along x, y and",
        ),
        ("do = 'topple'\nobject = 'a'\ndirection = [0, 0]", "event.1.direction: expected a direction along x and y"),
        ("do = 'hand_grasp'\nobject = 'a'\nside = [0, 0]", "event.1.side: expected a direction along x and y"),
    ],
)
def test_directions_are_not_zero(event: str, message: str):
    assert message in refusal(with_events(f"{event}\nat = 1\n"))


def test_fingertips_are_at_what_they_take():
    grasp = "do = 'hand_grasp'\nobject = 'a'\nat = 1\nabove = {}\n"
    message = "event.1.above: 5.0 m from the centre of 'a' there is nothing of it; expected at most 0.02 m"
    assert message in refusal(with_events(grasp.format(5.0)))
    assert "event.1.above: -0.021 m from" in refusal(with_events(grasp.format(-0.021)))
    parse_scenario(with_events(grasp.format(0.02)))
