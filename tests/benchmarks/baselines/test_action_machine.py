"""The published state machine."""

from __future__ import annotations

import math

import pytest

from benchmarks.baselines.action_machine import Machine, PublishedMachine, PublishedPolicy, State
from dsr.vocabulary.observed_actions import PICK, PLACE, RELEASE, Action
from tests.agents.action_inference.stage import Stage

NEEDED = math.ceil(math.log(0.85 / 0.1) / math.log(1.85))
"""Updates in a row until the least confidence has become 0.85."""


def updates(machine: Machine, count: int, *, perceived: bool, plausible: bool) -> list[str]:
    found = (machine.update(perceived, plausible) for _ in range(count))
    return [sure[0] for sure in found if sure]


def test_an_action_is_inferred_when_its_condition_has_held_long_enough():
    machine = Machine(PublishedMachine())
    assert updates(machine, NEEDED - 1, perceived=True, plausible=False) == []
    assert updates(machine, 1, perceived=True, plausible=False) == [PICK]
    assert machine.state is State.HELD


@pytest.mark.parametrize(
    ("perceived", "kind", "state"), [(True, PLACE, State.PLACED), (False, RELEASE, State.RELEASED)]
)
def test_what_is_held_is_placed_if_it_is_seen_and_else_released(perceived: bool, kind: str, state: State):
    machine = Machine(PublishedMachine(), State.HELD)
    assert updates(machine, 50, perceived=perceived, plausible=True) == [kind]
    assert machine.state is state


def test_a_condition_that_flickers_is_never_sure():
    machine = Machine(PublishedMachine())
    for _ in range(50):
        assert updates(machine, 1, perceived=True, plausible=False) == []
        assert updates(machine, 1, perceived=True, plausible=True) == []


def test_nothing_is_inferred_of_what_lies_and_of_what_is_hidden():
    machine = Machine(PublishedMachine())
    assert updates(machine, 50, perceived=True, plausible=True) == []
    assert updates(machine, 50, perceived=False, plausible=False) == []


def test_what_was_released_can_be_picked_again():
    machine = Machine(PublishedMachine(), State.RELEASED)
    assert updates(machine, 10, perceived=True, plausible=False) == [PICK]


def test_times_are_those_at_which_it_is_noticed_and_nobody_is_told():
    stage = Stage(PublishedPolicy())
    stage.add("cup")
    stage.run(1.0)
    stage.change("cup", plausible=False)
    stage.run(1.0)
    ((noticed, action),) = stage.actions
    assert action == Action(noticed, PICK, "cup", "unknown")


def test_it_takes_what_is_held_out_of_sight_for_released():
    stage = Stage(PublishedPolicy())
    stage.add("cup")
    stage.change("cup", plausible=False)
    stage.run(1.0)
    stage.change("cup", perceived=False, plausible=True)
    stage.run(2.0)
    assert stage.told == ["Pick(cup)", "Release(cup)"]


def test_an_earlier_run_is_continued():
    policy = PublishedPolicy()
    policy.recall(Action(1.0, PICK, "cup"))
    stage = Stage(policy)
    stage.add("cup")
    stage.run(1.0)
    assert stage.told == ["Place(cup)"]
