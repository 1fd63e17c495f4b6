"""The default policy: each deed of the belief is told once, as probable as it is."""

from __future__ import annotations

import pytest

from agents.action_inference.believed import BelievedPolicy
from dsr.vocabulary.observed_actions import PICK, PLACE, RELEASE, UNKNOWN, Action, Deed
from tests.agents.action_inference.stage import Stage

HAND = "human_hand_0"
TAKEN, PUT = Deed(PICK, 99.0, HAND, 0.8), Deed(PLACE, 100.5, HAND, 0.7)


@pytest.fixture
def stage() -> Stage:
    stage = Stage(BelievedPolicy())
    stage.add("cup")
    return stage


def test_a_deed_is_told_once_with_its_time_and_probability(stage: Stage) -> None:
    stage.run(1.0)
    assert stage.told == []
    stage.do("cup", TAKEN)
    stage.run(1.0)
    stage.do("cup", TAKEN, PUT)
    stage.run(1.0)
    assert [action for _, action in stage.actions] == [
        Action(99.0, PICK, "cup", HAND),
        Action(100.5, PLACE, "cup", HAND),
    ]
    assert stage.confidences == [0.8, 0.7]


def test_two_deeds_that_become_known_at_once_are_told_in_order(stage: Stage) -> None:
    stage.do("cup", TAKEN, Deed(RELEASE, 99.5, UNKNOWN, 0.5))
    stage.run(0.1)
    assert stage.told == [f"Pick(cup, {HAND})", "Release(cup)"]


def test_deeds_with_several_things_are_told_in_the_order_of_their_times(stage: Stage) -> None:
    stage.add("bowl")
    stage.do("bowl", PUT)
    stage.do("cup", TAKEN)
    stage.run(0.1)
    assert stage.told == [f"Pick(cup, {HAND})", f"Place(bowl, {HAND})"]


def test_a_new_thing_of_the_same_name_has_deeds_of_its_own(stage: Stage) -> None:
    stage.do("cup", PUT)
    stage.run(0.1)
    del stage.things["cup"]
    stage.run(0.1)
    stage.add("cup")
    stage.do("cup", TAKEN)
    stage.run(0.1)
    assert stage.told == [f"Place(cup, {HAND})", f"Pick(cup, {HAND})"]


def test_what_an_earlier_run_has_told_is_not_told_again(stage: Stage) -> None:
    stage.policy.recall(Action(99.0, PICK, "cup", HAND))
    stage.do("cup", TAKEN)
    stage.run(1.0)
    assert stage.told == []
    stage.do("cup", TAKEN, PUT)
    stage.run(1.0)
    assert stage.told == [f"Place(cup, {HAND})"]
