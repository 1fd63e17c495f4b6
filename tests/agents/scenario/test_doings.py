"""Expectations about inferred actions and what is inside of what, on made-up runs."""

from __future__ import annotations

import pytest

from agents.scenario.format.scenario import parse_scenario
from agents.scenario.judge.verdicts import judge_check
from agents.scenario.truth.history import History, Inferred, Sample
from dsr.errors import ConfigError
from dsr.vocabulary.observed_actions import PICK, PLACE, Action
from tests.agents.scenario.test_judge import FILE, TRUE, run, scenario_with

INFERRED = [
    Inferred(Action(3.0, PICK, "a", "human_hand_0"), 3.2, 0.9),
    Inferred(Action(5.0, PLACE, "a", "human_hand_0"), 5.1, 0.9),
    Inferred(Action(4.0, PICK, "b"), 5.3, 0.9),
]

HAND = "[[event]]\nat = 1.0\ndo = 'hand_enter'\nposition = [0.0, 0.0, 0.3]\n"


def history_of(expectation: str) -> History:
    def sample(time: float) -> Sample:
        edges = {("in", "a", "b")} if time < 6.0 else set()
        return Sample(time=time, truth=TRUE, beliefs=TRUE, edges=frozenset({("on", "a", "table"), *edges}))

    history = run(scenario_with(expectation), sample)
    history.actions = list(INFERRED)
    return history


@pytest.mark.parametrize(
    ("expectation", "holds"),
    [
        ("sequence = ['Pick(a)', 'Pick(b)', 'Place(a)']", True),
        ("sequence = ['Pick(a)', 'Place(a)', 'Pick(b)']", False),
        ("sequence = ['Pick(a)', 'Place(a)']", False),
        ("sequence = ['Pick(a, human_hand_0)', 'Place(a)']\nobjects = ['a']", True),
        ("sequence = ['Pick(a, gripper)', 'Place(a)']\nobjects = ['a']", False),
        ("sequence = ['Place(a)']\nobjects = ['a']\nafter = 4.0", True),
        ("sequence = ['Pick(a)']\nat = 5.0", True),
        ("sequence = []", False),
        ("sequence = []\nafter = 6.0", True),
        ("present = ['Pick(b)']\nabsent = ['Release', 'Place(b)']", True),
        ("absent = ['Place']", False),
        ("present = ['Release(a)']", False),
    ],
)
def test_inferred_actions_are_compared_in_the_order_in_which_they_happened(expectation: str, holds: bool):
    history = history_of(f"check = 'actions'\n{expectation}\n{HAND}")
    assert judge_check(history.scenario.expectations[0], history).passed is holds


@pytest.mark.parametrize(
    ("expectation", "holds"),
    [
        ("present = [['a', 'b']]\nat = 5.0", True),
        ("present = [['a', 'b']]", False),
        ("present = [['a', 'b']]\nafter = 2.0\nat = 5.0", True),
        ("present = [['a', 'b']]\nafter = 2.0", False),
        ("absent = [['a', 'b']]", True),
        ("absent = [['a', 'b']]\nafter = 5.0", False),
    ],
)
def test_what_is_inside_is_told_apart_from_what_it_stands_on(expectation: str, holds: bool):
    history = history_of(f"check = 'inside'\n{expectation}")
    assert judge_check(history.scenario.expectations[0], history).passed is holds


@pytest.mark.parametrize(
    ("expectation", "message"),
    [
        ("check = 'actions'", "expected `sequence`, `present` or `absent`"),
        ("check = 'actions'\nsequence = ['Push(a)']", "unknown action 'Push'; valid: Pick, Place, Release"),
        ("check = 'actions'\nsequence = ['Pick(a']", "expected an action such as"),
        ("check = 'actions'\nabsent = ['Pick(c)']", "unknown object 'c'"),
        ("check = 'actions'\nabsent = ['Pick(b)']\nobjects = ['a']", "'b' is not one of the `objects`"),
        ("check = 'inside'", "expected `present` or `absent`"),
        ("check = 'inside'\npresent = [['a', 'bee']]", "unknown object 'bee'"),
    ],
)
def test_a_mistake_is_found_before_the_run(expectation: str, message: str):
    with pytest.raises(ConfigError) as error:
        parse_scenario(f"{FILE}\n[[expect]]\n{expectation}\n")
    assert message in str(error.value)
