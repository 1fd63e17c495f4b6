"""Containers and hands between a graph and the belief, in lockstep; and what is wrong with them."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import to_numbers
from dsr.math3d.transforms import Pose
from dsr.vocabulary.observed_actions import PICK, deeds_of
from dsr.vocabulary.perceived import MOST_HANDS
from simulation_handler import SimulationHandler
from simulation_handler.graph_io.hand_nodes import hand_nodes
from simulation_handler.hands.state import FINGERS
from tests.simulation_handler.occluded import BOX, standing
from tests.simulation_handler.test_agent import NAME, Table
from tests.simulation_handler.worlds import CUBE, WALL, container, cube_at

AT_THE_CUBE: tuple[Vector3, ...] = ((0.4, 0.128, 0.02), (0.4, 0.072, 0.02))


@pytest.fixture
def table() -> Iterator[Table]:
    scene = Table()
    yield scene
    scene.lockstep.close()


def show_hand(table: Table, tips: tuple[Vector3, ...], perceived: bool = True) -> None:
    """Write a hand as the hand tracker does."""
    memory, now = table.memory, table.lockstep.clock.now()
    if "human_hand_0" not in memory:
        memory.add_node("human_hand_0", "hand", perceived=True, side="right")
        for k in range(len(tips)):
            memory.add_node(f"human_hand_0_finger_{k}", "finger", perceived=True)
            memory.add_edge("human_hand_0", f"human_hand_0_finger_{k}", "has")
    memory.update_node("human_hand_0", perceived=perceived, last_seen=now)
    memory.add_edge("world", "human_hand_0", "RT", pose=Pose((tips[0][0] - 0.1, 0.1, 0.08)).with_stamp(now))
    for k, tip in enumerate(tips):
        memory.add_edge("world", f"human_hand_0_finger_{k}", "RT", pose=Pose(tip).with_stamp(now))
    memory.flush()


def run_with_hand(table: Table, tips: tuple[Vector3, ...], seconds: float) -> None:
    for _ in range(round(seconds / 0.1)):
        show_hand(table, tips)
        table.run(0.1)


def test_what_is_in_a_container_is_written(table: Table) -> None:
    table.memory.add_node("box", "container", size=BOX, shape=to_numbers(container(BOX)), mass=0.2)
    table.truths["box"] = standing(0.4, 0.1, BOX)
    table.add("cube_1", standing(0.41, 0.11, CUBE, on=WALL))
    table.run(2.0)
    edge = table.memory.edge("cube_1", "box", "in")
    assert edge["source"] in ("contact", "explanation")
    assert edge["since"] < table.lockstep.clock.now() - 1.0
    assert ("cube_1", "box") in table.relations()
    table.truths["cube_1"] = cube_at(0.2, -0.1)
    table.run(2.0)
    assert table.memory.edges("in") == []


def test_a_grasp_is_written_and_ends(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.run(2.0)
    run_with_hand(table, AT_THE_CUBE, 1.0)
    edge = table.memory.edge("human_hand_0", "cube_1", "grasping")
    assert (edge["source"], edge["handling"]) == ("contact", "pinching")
    assert math.dist(edge["held_at"].t, (0.1, 0.0, -0.06)) < 0.01
    run_with_hand(table, ((0.4, 0.17, 0.02), (0.4, 0.03, 0.02)), 1.0)
    assert table.memory.edges("grasping") == []


def test_what_was_done_with_a_thing_is_written_and_recalled(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.run(2.0)
    run_with_hand(table, AT_THE_CUBE, 1.0)
    for k in range(1, 11):
        table.truths["cube_1"] = cube_at(0.4, 0.1, 0.02 + 0.01 * k)
        run_with_hand(table, tuple((x, y, z + 0.01 * k) for x, y, z in AT_THE_CUBE), 0.1)
    (picked,) = deeds_of(table.memory.node("cube_1"))
    assert (picked.kind, picked.by) == (PICK, "human_hand_0") and picked.probability > 0.7
    table.lockstep.kill(NAME)
    table.lockstep.restart(NAME)
    run_with_hand(table, tuple((x, y, z + 0.1) for x, y, z in AT_THE_CUBE), 1.0)
    assert deeds_of(table.memory.node("cube_1")) == (picked,)
    table.memory.update_node("cube_1", deeds="?")
    table.lockstep.kill(NAME)
    table.lockstep.restart(NAME)
    table.run(0.5)
    assert table.error("cube_1") < 0.02, "the rest is recalled all the same"


def test_grasps_of_grippers_are_left_alone(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.memory.add_node("gripper", "gripper")
    table.memory.add_edge("world", "gripper", "RT", pose=Pose((0.4, 0.1, 0.2)))
    table.memory.add_edge("gripper", "cube_1", "grasping", source="gripper")
    table.run(2.0)
    run_with_hand(table, AT_THE_CUBE, 1.0)
    assert [(edge.src, edge.dst) for edge in table.memory.edges("grasping")] == [("gripper", "cube_1")]


def test_a_hand_that_nobody_reports_any_more_grasps_nothing(table: Table) -> None:
    table.add("cube_1", cube_at(0.2, -0.1))
    table.run(2.0)
    run_with_hand(table, AT_THE_CUBE, 1.0)
    table.run(1.5)
    table.truths["cube_1"] = cube_at(0.4, 0.1)  # where the fingertips were
    table.run(2.0)
    assert table.memory.node("human_hand_0")["perceived"] is True
    assert table.error("cube_1") < 0.005
    assert table.memory.edges("grasping") == []


def test_after_a_restart_a_hand_out_of_sight_still_holds(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.run(2.0)
    run_with_hand(table, AT_THE_CUBE, 1.0)
    table.truths.clear()
    show_hand(table, AT_THE_CUBE, perceived=False)
    table.run(1.0)
    table.lockstep.kill(NAME)
    table.lockstep.restart(NAME)
    table.run(2.0)
    assert [edge["handling"] for edge in table.memory.edges("grasping", dst="cube_1")] == ["pinching"]


def test_after_a_restart_a_hand_in_sight_holds_all_the_time(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.run(2.0)
    run_with_hand(table, AT_THE_CUBE, 1.0)
    since = table.memory.edge("human_hand_0", "cube_1", "grasping")["since"]
    table.lockstep.kill(NAME)
    table.lockstep.restart(NAME)
    for _ in range(10):
        run_with_hand(table, AT_THE_CUBE, 0.1)
        edge = table.memory.edge("human_hand_0", "cube_1", "grasping")
        assert (edge["since"], edge["handling"]) == (since, "pinching")
    table.lockstep.kill(NAME)
    table.lockstep.restart(NAME)
    run_with_hand(table, ((0.4, 0.17, 0.02), (0.4, 0.03, 0.02)), 1.0)
    assert table.memory.edges("grasping") == []


@pytest.mark.parametrize(
    "shape",
    [
        (1.0, 2.0),
        to_numbers(container((0.3, 0.3, 0.3))),
        (7.0, *to_numbers(container(BOX))[1:]),
        to_numbers(container(BOX)) * 4,  # more parts than a body may have
    ],
)
def test_a_malformed_shape_is_skipped_and_said(table: Table, shape: tuple[float, ...]) -> None:
    table.memory.add_node("box", "container", size=BOX, shape=shape)
    table.add("cube_1", cube_at(0.4, 0.1))
    table.run(1.0)
    assert "shape" in table.lockstep.runner(NAME).agent.degraded
    assert table.memory.get_edge("world", "box", "Virtual_RT") is None
    assert table.error("cube_1") < 0.005


@pytest.mark.parametrize("kind", ["no pose", "far away", "no fingers", "strange fingers", "only its fingers"])
def test_malformed_hands_do_no_harm(table: Table, kind: str) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.run(2.0)
    memory, now = table.memory, table.lockstep.clock.now()
    memory.add_node("human_hand_0", "hand")
    if kind == "far away":
        memory.add_edge("world", "human_hand_0", "RT", pose=Pose((1e9, 0.0, 0.0)).with_stamp(now))
    elif kind != "no pose":
        memory.add_edge("world", "human_hand_0", "RT", pose=Pose((0.3, 0.1, 0.1)).with_stamp(now))
    if kind == "strange fingers":
        memory.add_node("finger", "finger")
        memory.add_edge("human_hand_0", "finger", "has")
        memory.add_edge("human_hand_0", "cube_1", "has")
        memory.add_edge("world", "finger", "RT", pose=Pose((0.4, 0.1, 1e12)).with_stamp(now))
    if kind == "only its fingers":
        memory.add_node("human_hand_1_finger_0", "finger")
        memory.add_edge("world", "human_hand_1_finger_0", "RT", pose=Pose((0.4, 0.1, 0.04)).with_stamp(now))
    table.run(1.0)
    assert table.memory.edges("grasping") == []
    assert table.error("cube_1") < 0.003
    agent = table.lockstep.runner(NAME).agent
    assert isinstance(agent, SimulationHandler)
    assert ("at most" in agent.degraded) is (kind in ("far away", "strange fingers"))


def test_however_many_hands_somebody_makes_up_those_of_others_count(table: Table) -> None:
    liar = table.lockstep._join("liar", "liar-1", None)
    now = table.lockstep.clock.now()
    for number in range(3 * MOST_HANDS):
        liar.add_node(f"a_{number}", "hand", perceived=True, last_seen=now)
        liar.add_edge("world", f"a_{number}", "RT", pose=Pose((0.4, 0.1, 0.1)).with_stamp(now))
    run_with_hand(table, ((0.4, 0.1, 0.04), (0.44, 0.1, 0.04)), 0.1)
    liar.poll()
    for number in range(50):
        liar.add_node(f"a_finger_{number}", "finger", perceived=True)
        liar.add_edge("human_hand_0", f"a_finger_{number}", "has")
        liar.add_edge("world", f"a_finger_{number}", "RT", pose=Pose((0.4, 0.1, 0.04)).with_stamp(now))
    liar.flush()
    run_with_hand(table, ((0.4, 0.1, 0.04), (0.44, 0.1, 0.04)), 0.5)
    hands = {node.name: parts for node, parts in hand_nodes(table.memory, table.lockstep.clock.now())}
    assert len(hands) == MOST_HANDS and len(hands["human_hand_0"]) == FINGERS
    assert {"human_hand_0_finger_0", "human_hand_0_finger_1"} <= {finger.name for finger in hands["human_hand_0"]}
    belief = table.lockstep.runner(NAME).agent.belief
    assert belief._touching.hands.keys() <= hands.keys() and "human_hand_0" in belief._touching.hands
