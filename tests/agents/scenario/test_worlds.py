"""Expectations about worlds beside the base."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from agents.scenario.format.expectations import Check, Edges, KnownIn, WorldsCheck
from agents.scenario.format.model import ObjectSpec, Scenario
from agents.scenario.judge.verdicts import judge_check
from agents.scenario.judge.worlds import WorldWatch
from agents.scenario.truth.history import History, Sample
from dsr import LocalNetwork, ManualClock, Memory, Pose

CUBE = ObjectSpec(name="cube", position=(0.1, 0.0, 0.02))
HERE, THERE = Pose((0.1, 0.0, 0.02)), Pose((0.4, 0.0, 0.02))


@pytest.fixture
def memory() -> Iterator[Memory]:
    clock = ManualClock()
    with Memory("g", "tester", transport=LocalNetwork(clock).connect("a"), clock=clock) as memory:
        memory.replica.synchroniser.nobody_there()
        memory.add_node("world", "world")
        yield memory


def judged(memory: Memory, check: Check, *truths: Pose) -> tuple[bool, str]:
    """The verdict after moments in which the cube was truly there."""
    scenario = Scenario(name="s", title="", duration=10.0, objects=[CUBE], expectations=[check])
    history, watch = History(scenario), WorldWatch(scenario, memory)
    for time, truth in enumerate(truths or (HERE,), start=1):
        history.add(Sample(time=float(time), truth={"cube": truth}, worlds=watch.look()))
    verdict = judge_check(check, history)
    return verdict.passed, verdict.actual


def with_cube(memory: Memory, pose: Pose | None, **attributes: Any) -> Memory:
    world = memory.create_world("view")
    world.add_node("cube", "cube", **attributes)
    if pose is not None:
        world.add_edge("world", "cube", "RT", pose=pose)
    return world


def known(**fields: Any) -> KnownIn:
    return KnownIn(world="view", objects=("cube",), **fields)


def test_what_is_known_and_where(memory: Memory) -> None:
    with_cube(memory, HERE, perceived=True)
    assert judged(memory, known(right=True, perceived=True, position=(0.1, 0.0, 0.02)))[0]
    assert judged(memory, known(right=False), THERE) == (True, "cube: at (0.100, 0.000, 0.020), 300.00 mm off")
    assert not judged(memory, known(right=True), THERE)[0]
    assert not judged(memory, known(position=(0.2, 0.0, 0.02)))[0]
    assert not judged(memory, known(perceived=False))[0]
    assert not judged(memory, known(value=False))[0]


def test_at_every_moment_of_a_window(memory: Memory) -> None:
    with_cube(memory, HERE)
    assert judged(memory, known(right=True, after=1.0), HERE, HERE)[0]
    passed, text = judged(memory, known(right=True, after=1.0), THERE, HERE)
    assert not passed and "at 1.00 s" in text


@pytest.mark.parametrize(("pose", "attributes"), [(None, {}), (HERE, {"present": False})], ids=["nowhere", "gone"])
def test_what_is_not_known(memory: Memory, pose: Pose | None, attributes: dict[str, Any]) -> None:
    with_cube(memory, pose, **attributes)
    assert judged(memory, known(value=False))[0] and not judged(memory, known())[0]


def test_a_world_that_is_not_there(memory: Memory) -> None:
    for check in (known(), known(value=False), Edges(world="view", present=(("cube", "cup"),))):
        passed, text = judged(memory, check)
        assert not passed and "no world 'view'" in text


def test_edges_in_a_world(memory: Memory) -> None:
    world = with_cube(memory, HERE)
    world.add_node("cup", "cup")
    world.add_edge("cube", "cup", "in")
    inside = (("cube", "cup"),)
    assert judged(memory, Edges(type="in", world="view", present=inside)) == (True, "cube -> cup")
    assert not judged(memory, Edges(type="in", world="view", absent=inside))[0]
    assert judged(memory, Edges(type="in", absent=inside))[0], "not in the base"


def test_which_worlds_there_are(memory: Memory) -> None:
    memory.create_world("view")
    assert judged(memory, WorldsCheck(present=("view",), absent=("idea",))) == (True, "view")
    assert (
        not judged(memory, WorldsCheck(present=("idea",)))[0] and not judged(memory, WorldsCheck(absent=("view",)))[0]
    )
