"""What a person believes, told from the person's world beside the base, as when Sally was away."""

from __future__ import annotations

import pytest

from dsr import ConfigError, Memory, Pose
from dsr.narration import Basis, Moment, person_account
from tests.dsr.narration.conftest import NOW


@pytest.fixture
def sally(memory: Memory) -> Memory:
    """Sally's world: she saw `ball` in `cup`, sees `cube_3`, and has seen that the place of `cube_9` is empty."""
    memory.add_node("sally", "person", perceived=True, last_seen=NOW)
    world = memory.create_world("view_of_sally")
    world.add_node("world", "world")
    world.add_node("table", "table", size=(1.2, 1.2, 0.04))
    for name, kind, at, perceived in (
        ("cup", "cup", (0.3, 0.09, 0.05), True),
        ("ball", "ball", (0.3, 0.09, 0.03), False),
        ("cube_3", "cube", (0.3, -0.2, 0.06), True),
    ):
        world.add_node(name, kind, perceived=perceived, present=True, last_seen=NOW if perceived else NOW - 31.0)
        world.add_edge("world", name, "RT", pose=Pose(at))
    world.add_edge("ball", "cup", "in")
    world.add_edge("cup", "table", "on")
    world.add_node("cube_9", "cube", perceived=False, present=False, last_seen=NOW - 9.0)
    return world


def test_a_false_belief_is_told_with_what_the_robot_knows(memory: Memory, sally: Memory) -> None:
    texts = [one.text for one in person_account(Moment.of(memory), "sally")]
    assert texts[:2] == [
        "sally believes that ball is in cup: sally saw it last 31.0 s ago.",
        "But ball is believed to be in box: unseen for 3 min 20 s, out of the sight of camera.",
    ]
    assert "sally sees cup and believes that it rests on table, at x 0.30 m, y 0.09 m." in texts
    assert "sally has never seen box." in texts
    assert "sally does not know where cube_9 is: sally saw it last 9.0 s ago." in texts


def test_all_that_a_person_believes_is_marked_as_belief(memory: Memory, sally: Memory) -> None:
    told = person_account(Moment.of(memory), "sally")
    assert {one.basis for one in told if one.text.startswith("sally")} == {Basis.BELIEVED}
    sally.remove_edge("cup", "table", "on")
    sally.add_edge("world", "cup", "RT", pose=Pose((0.9, 0.0, 0.05)))
    texts = [one.text for one in person_account(Moment.of(memory), "sally")]
    assert "The robot knows otherwise: cup rests on table, at x 0.30 m, y 0.09 m." in texts


def test_persons_that_are_not_there_or_have_no_world(memory: Memory) -> None:
    memory.add_node("anne", "person")
    with pytest.raises(ConfigError, match="there is no person 'ann'; did you mean 'anne'"):
        person_account(Moment.of(memory), "ann")
    with pytest.raises(ConfigError, match="nobody keeps the world of anne"):
        person_account(Moment.of(memory), "anne")
