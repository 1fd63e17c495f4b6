"""Speed and separation near hands and people: slower the nearer they are, still when too near, then on again."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from agents.arm_controller.model.arm_model import load_arm
from agents.arm_controller.model.figure import Figure
from agents.arm_controller.model.kinematics import JointChain
from agents.arm_controller.model.urdf import load_robot
from agents.arm_controller.motion.trajectory import PERIOD
from agents.arm_controller.safety.separation import PeopleNearby, Separation
from dsr import Pose
from dsr.vocabulary.intentions import DONE, RUNNING
from tests.agents.arm_controller.conftest import DOWN, GEN3, HOME, Table

GOAL = Pose((0.4, -0.2, 0.3), DOWN)
FAR, NEAR = (-1.5, 0.0, 0.2), (0.45, 0.25, 0.35)
"""m, world: of a hand beyond all reach, and beside the way"""


@pytest.fixture
def table(make_bench: Callable[..., Any]) -> Table:
    bench = make_bench(Table)
    assert isinstance(bench, Table)
    bench.lay()
    bench.memory.update_node("arm", target_speed=1.0)
    return bench


def show(table: Table, place: tuple[float, float, float], kind: str = "hand") -> None:
    table.memory.add_node("human_1", kind, present=True)
    table.memory.add_edge("world", "human_1", "RT", pose=Pose(place))
    table.run(0.04)


def speeds(table: Table) -> list[float]:
    """Greatest speed of the tool point (m/s) of each trajectory that was commanded."""
    chain = JointChain(load_robot(GEN3).between("base_link", "tool_link"))
    found = []
    for told in table.arm.told:
        if told[0] == "follow":
            tips = chain.frames(np.array(told[2]))[:, -1, :3, 3]
            found.append(float(np.linalg.norm(np.diff(tips, axis=0), axis=1).max()) / PERIOD)
    return found


@pytest.mark.parametrize("speed", [0.3, 0.5, 1.0])
def test_the_allowed_speed_keeps_the_protective_distance(speed: float) -> None:
    numbers = Separation()
    assert numbers.allowed(numbers.distance(speed, numbers.human_speed)) == pytest.approx(speed)
    # 5.5.4: S_h = v_h (T_r + T_s), S_r = v_r T_r, S_s = v_r T_s / 2 for a constant deceleration, C + Z
    stopping = speed / numbers.deceleration
    parts = (1.6 * (0.1 + stopping), speed * 0.1, speed * stopping / 2, numbers.uncertainty)
    assert numbers.distance(speed, 1.6) == pytest.approx(sum(parts))


def test_close_by_the_speed_is_reduced_and_closer_yet_it_is_nothing() -> None:
    numbers = Separation()
    assert numbers.allowed(math.inf) == math.inf
    assert numbers.allowed(0.2) == numbers.reduced
    assert numbers.allowed(numbers.distance(numbers.reduced, 0.0)) == 0.0
    assert numbers.allowed(0.0) == 0.0


def test_however_many_hands_somebody_makes_up_the_shape_of_the_arm_is_worked_out_once(
    table: Table, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 3000 hands, each tick of a moving arm took 0.8 s, forty times its period."""
    figure, looks = Figure(load_arm(GEN3)), list[float]()
    people, boxes = PeopleNearby(table.memory, figure, "arm"), figure.boxes

    def counted(positions: Any, opening: float) -> Any:
        looks.append(opening)
        return boxes(positions, opening)

    monkeypatch.setattr(figure, "boxes", counted)
    assert people.nearest(np.array(HOME), 0.05) == (math.inf, "") and not looks
    rng, distances = np.random.default_rng(1), {}
    for number in range(100):
        name, place = f"hand_{number}", Pose(rng.uniform(-0.8, 0.8, 3))
        table.memory.add_node(name, "hand")
        table.memory.add_edge("arm", name, "RT", pose=place)
        distances[name] = people._gaps(np.array([place.t]), np.array(HOME), 0.05).item() - 0.1
    table.memory.add_node("hand_nowhere", "hand")
    looks.clear()
    distance, name = people.nearest(np.array(HOME), 0.05)
    assert len(looks) == 1
    assert distance == pytest.approx(distances[name]) == min(distances.values())


def test_far_from_people_the_arm_is_as_fast_as_without_any(table: Table) -> None:
    assert table.act("move", target_pose=GOAL)[0] == DONE
    alone = speeds(table)[-1]
    table.act("observe")
    show(table, FAR)
    assert table.act("move", target_pose=GOAL)[0] == DONE
    assert speeds(table)[-1] == pytest.approx(alone, rel=0.05)
    assert alone > Separation().reduced


def test_near_a_hand_the_arm_has_reduced_speed(table: Table) -> None:
    show(table, NEAR)
    assert table.act("move", target_pose=GOAL)[0] == DONE
    assert max(speeds(table)) <= Separation().reduced


def test_a_person_reaches_further_than_a_hand(table: Table) -> None:
    show(table, (0.4, 1.1, 0.4), "person")
    assert table.act("move", target_pose=GOAL)[0] == DONE
    assert max(speeds(table)) <= Separation().reduced


def test_an_arm_stands_still_while_a_hand_is_too_near_and_goes_on_afterwards(table: Table) -> None:
    x, y, z = table.memory.transform("world", "gripper").t
    show(table, (x, y, z - 0.1))
    name = table.request("move", target_pose=GOAL)
    table.run(1.0)
    assert speeds(table) == []
    assert table.said(name) == (RUNNING, "stands still: human_1 is near")
    show(table, FAR)
    assert table.finish(name)[0] == DONE


def test_a_hand_that_comes_near_stops_a_motion_and_it_goes_on_more_slowly(table: Table) -> None:
    name = table.request("move", target_pose=GOAL)
    table.run(0.5)
    assert table.arm.velocities.any() and len(speeds(table)) == 1
    show(table, NEAR)
    assert ("stop",) in table.arm.told
    assert table.finish(name)[0] == DONE
    assert len(speeds(table)) == 2 and speeds(table)[1] <= Separation().reduced


def test_it_can_be_switched_off(make_bench: Callable[..., Any]) -> None:
    table = make_bench(Table, separation={"monitored": False})
    table.lay()
    table.memory.update_node("arm", target_speed=1.0)
    show(table, NEAR)
    assert table.act("move", target_pose=GOAL)[0] == DONE
    assert max(speeds(table)) > Separation().reduced


def stop_for_a_hand(table: Table) -> str:
    """A move that has begun and stands still, because a hand is at the gripper."""
    name = table.request("move", target_pose=GOAL)
    table.run(0.5)
    assert len(speeds(table)) == 1
    x, y, z = table.memory.transform("world", "gripper").t
    show(table, (x, y, z - 0.1))
    table.run(0.5)
    assert table.said(name) == (RUNNING, "stands still: human_1 is near")
    return name


def test_what_came_in_the_way_while_the_arm_stood_still_is_gone_around(table: Table) -> None:
    name = stop_for_a_hand(table)
    table.believe("box", Pose((0.4, -0.1, 0.25)), (0.05, 0.02, 0.1))
    show(table, FAR)
    assert table.finish(name)[0] == DONE
    chain = JointChain(load_robot(GEN3).between("base_link", "tool_link"))
    way = np.array([told for told in table.arm.told if told[0] == "follow"][-1][2])
    tips = chain.frames(way)[:, -1, :3, 3]
    assert np.linalg.norm(tips - (0.4, -0.1, 0.25), axis=1).min() > 0.05


def test_a_goal_that_was_taken_while_the_arm_stood_still_is_not_gone_to(table: Table) -> None:
    name = stop_for_a_hand(table)
    told = len(speeds(table))
    table.believe("box", Pose((0.4, -0.2, 0.3)), (0.1, 0.1, 0.1))
    show(table, FAR)
    assert table.finish(name) == ("failed", "box is in the way")
    assert len(speeds(table)) == told


AWAY = (-0.6, *HOME[1:])
"""rad, joint positions with the tool to the left"""


def test_a_target_by_hand_is_gone_to_at_reduced_speed_near_a_hand(table: Table) -> None:
    show(table, NEAR)
    table.memory.update_node("arm", target_joints=AWAY)
    table.run(6.0)
    assert table.status == "reached"
    assert 0.0 < max(speeds(table)) <= Separation().reduced


def test_a_target_by_hand_waits_while_a_hand_is_too_near(table: Table) -> None:
    table.memory.update_node("arm", target_joints=AWAY)
    table.run(0.3)
    assert len(speeds(table)) == 1
    x, y, z = table.memory.transform("world", "gripper").t
    show(table, (x, y, z - 0.1))
    table.run(0.5)
    assert not table.arm.velocities.any()
    assert (table.status, table.memory.node("arm")["explanation"]) == ("moving", "stands still: human_1 is near")
    show(table, FAR)
    table.run(3.0)
    assert (table.status, table.memory.node("arm")["explanation"]) == ("reached", "")
    assert table.arm.positions == pytest.approx(AWAY, abs=3e-3)


def test_what_a_hand_held_up_is_refused_if_a_zone_has_come_in_between(table: Table) -> None:
    table.memory.update_node("arm", target_joints=AWAY)
    table.run(0.3)
    x, y, z = table.memory.transform("world", "gripper").t
    show(table, (x, y, z - 0.1))
    table.run(0.5)
    table.memory.add_node("shelf", "zone", size=(0.4, 0.1, 0.4))
    table.memory.add_edge("world", "shelf", "RT", pose=Pose((0.25, 0.25, 0.6)))
    show(table, FAR)
    table.run(0.5)
    assert (table.status, table.memory.node("arm")["explanation"]) == ("stopped", "shelf is in the way")
    assert len(speeds(table)) == 1
