"""Nodes that were found by depth are taken for the objects that truly are there, and stay these."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from agents.scenario.format.scenario import parse_scenario
from agents.scenario.judge.found_names import NEAREST, FoundNames
from dsr import LocalNetwork, ManualClock, Memory, Pose
from dsr.vocabulary.perceived import BY_DEPTH

SCENARIO = parse_scenario("""
name = "found"
title = "Two blocks without tags, one cube with a tag"
duration = 9.0

[[object]]
name = "red"
type = "box"
position = [0.3, 0.1, 0.02]

[[object]]
name = "blue"
type = "box"
position = [0.3, -0.1, 0.02]

[[object]]
name = "cube_3"
marker_id = 3
position = [0.45, 0.0, 0.02]
""")
TRUTH = {spec.name: Pose(spec.position) for spec in SCENARIO.objects}


@pytest.fixture
def memory() -> Iterator[Memory]:
    clock = ManualClock()
    with Memory("test", "estimator", transport=LocalNetwork(clock).connect("estimator"), clock=clock) as memory:
        memory.add_node("world", "world")
        yield memory


def put(memory: Memory, name: str, pose: Pose, **attributes: str) -> None:
    if name not in memory:
        memory.add_node(name, "box", **attributes)
    memory.add_edge("world", name, "RT", pose=pose)


def test_a_node_is_what_is_there_when_it_is_first_seen_and_stays_that(memory: Memory) -> None:
    names = FoundNames(SCENARIO, memory)
    put(memory, "box_1", TRUTH["blue"], source=BY_DEPTH)
    names.update(TRUTH)
    assert (names.node("blue"), names.object("box_1")) == ("box_1", "blue")
    assert (names.node("red"), names.node("cube_3"), names.object("table")) == ("red", "cube_3", "table")
    put(memory, "box_1", TRUTH["red"])
    put(memory, "box_2", TRUTH["red"], source=BY_DEPTH)
    names.update(TRUTH)
    assert (names.node("blue"), names.node("red")) == ("box_1", "box_2")


def test_what_is_elsewhere_or_known_otherwise_is_none_of_them(memory: Memory) -> None:
    names = FoundNames(SCENARIO, memory)
    x, y, z = TRUTH["red"].t
    put(memory, "box_1", Pose((x, y + 1.1 * NEAREST, z)), source=BY_DEPTH)
    put(memory, "box_2", TRUTH["red"])
    put(memory, "box_3", TRUTH["cube_3"], source=BY_DEPTH)
    names.update(TRUTH)
    assert names.node("red") == "red"
    assert [names.object(node) for node in ("box_1", "box_2", "box_3")] == ["box_1", "box_2", "box_3"]
