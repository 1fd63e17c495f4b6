"""Targets through the graph: followed, reported, replaced, refused, and remembered."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from agents.arm_controller.agent import START_UP
from agents.arm_controller.model.arm_model import load_arm
from agents.arm_controller.model.kinematics import JointChain
from dsr import Pose

from .conftest import GEN3, HOME, PERIOD, Bench

AWAY = tuple(np.array(HOME) + 0.2)


def moves(bench: Bench) -> list[np.ndarray]:
    """The trajectories that the arm was told, each (m, 7) rad, a row each period."""
    return [np.array(command[2]) for command in bench.arm.told if command[0] == "follow"]


def fastest(rows: np.ndarray) -> float:
    """The greatest share of its velocity limit that a joint has."""
    limits = [joint.velocity for joint in load_arm(GEN3).chain.joints]
    return float((np.abs(np.diff(rows, axis=0)) / PERIOD / limits).max())


def test_without_a_target_nothing_moves(bench: Bench) -> None:
    bench.run(0.2)
    assert bench.status == "idle"
    assert bench.arm.told == []


def test_joint_target_is_reached(bench: Bench) -> None:
    bench.memory.update_node("arm", target_joints=AWAY, target_speed=0.8)
    bench.run(0.1)
    assert bench.status == "moving"
    bench.run(1.0)
    assert bench.status == "reached"
    (rows,) = moves(bench)
    assert rows[0] == pytest.approx(HOME) and rows[-1] == pytest.approx(AWAY)
    assert fastest(rows) <= 0.8
    accelerations = np.diff(rows, n=2, axis=0, prepend=rows[:1], append=rows[-1:]) / PERIOD**2
    assert np.abs(accelerations).max() <= 5.0 * (1 + 1e-9)
    assert np.abs(np.diff(accelerations, axis=0)).max() / PERIOD <= 100.0 * (1 + 1e-9)
    assert bench.arm.positions == pytest.approx(AWAY)


def test_tool_reaches_a_pose_in_the_world(make_bench: Callable[..., Bench], tool: JointChain) -> None:
    bench = make_bench(mount={"translation": [0.2, -0.1, 0.3], "rotation": [0.0, 0.0, 0.6, 0.8]})
    bench.run(0.04)
    world_from_arm = Pose((0.2, -0.1, 0.3), (0.0, 0.0, 0.6, 0.8))
    wanted = world_from_arm @ Pose((0.42, 0.08, 0.05), (1.0, 0.0, 0.0, 0.0))
    bench.memory.update_node("arm", target_pose=wanted)
    bench.run(8.0)
    assert bench.status == "reached"
    distance, angle = wanted.distance(world_from_arm @ tool.forward(bench.arm.positions))
    assert distance < 0.15e-3
    assert angle < 1e-3
    gripper_from_tool = Pose((0.0, 0.0, 0.12))
    assert (bench.memory.transform("world", "gripper") @ gripper_from_tool).distance(wanted)[0] < 0.15e-3


def test_configured_posture_is_preferred(make_bench: Callable[..., Bench], tool: JointChain) -> None:
    posture = np.array(HOME) + 0.4 * np.eye(7)[2]
    target = tool.forward(np.array(HOME) + 0.1)
    away = []
    for config in ({"posture": posture.tolist()}, {}):
        bench = make_bench(**config)
        bench.memory.update_node("arm", target_pose=target)
        bench.run(2.0)
        away.append(np.linalg.norm(tool.difference(bench.arm.positions, posture)))
    assert away[0] < 0.9 * away[1]


def test_passing_by_the_target_is_not_reaching_it(bench: Bench) -> None:
    bench.run(0.1)
    bench.arm.drift = 0.05
    bench.memory.update_node("arm", target_joints=HOME)
    bench.run(0.2)
    assert bench.status == "moving"
    bench.arm.drift = 0.0
    bench.run(0.2)
    assert bench.status == "reached"


def test_the_same_target_again_is_a_new_one(bench: Bench) -> None:
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(2.0)
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(0.2)
    assert len(moves(bench)) == 2
    assert bench.status == "reached"


def test_a_new_kind_of_target_takes_the_other_away(bench: Bench, tool: JointChain) -> None:
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(0.1)
    bench.memory.update_node("arm", target_pose=tool.forward(HOME))
    bench.run(2.0)
    assert "target_joints" not in bench.memory.node("arm")
    assert bench.arm.positions == pytest.approx(HOME, abs=2e-3)
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(2.0)
    assert "target_pose" not in bench.memory.node("arm")
    assert bench.arm.positions == pytest.approx(AWAY)


def test_removing_the_target_stops_the_arm(bench: Bench) -> None:
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(0.1)
    bench.memory.remove_attribute("arm", "target_joints")
    bench.run(0.1)
    assert bench.status == "stopped"
    assert bench.arm.told[-1] == ("stop",)


def test_speed_can_change_on_the_way_and_zero_stops(bench: Bench) -> None:
    bench.memory.update_node("arm", target_joints=AWAY, target_speed=0.1)
    bench.run(0.1)
    bench.memory.update_node("arm", target_speed=0.0)
    bench.run(0.1)
    assert (bench.status, bench.arm.told[-1]) == ("stopped", ("stop",))
    bench.memory.update_node("arm", target_speed=1.0)
    bench.run(1.0)
    assert bench.status == "reached"
    assert fastest(moves(bench)[0]) <= 0.1 < fastest(moves(bench)[-1]) <= 1.0


@pytest.mark.parametrize(
    ("target", "reason"),
    [
        ({"target_joints": (0.0, 1.0)}, "2 positions, expected 7"),
        ({"target_joints": (0.0, 2.5, 0.0, 0.0, 0.0, 0.0, 0.0)}, "2.5 rad for 'joint_2': expected -2.24 to 2.24"),
        ({"target_joints": AWAY, "target_speed": 1.5}, "target_speed 1.5: expected a number from 0 to 1"),
        ({"target_joints": AWAY, "target_speed": -0.1}, "target_speed -0.1"),
        ({"target_pose": Pose((1.6, 0.0, 0.2))}, "out of reach"),
    ],
)
def test_bad_target_is_refused_with_its_reason_and_the_next_one_works(
    bench: Bench, target: dict[str, object], reason: str, caplog: pytest.LogCaptureFixture
) -> None:
    bench.memory.update_node("arm", **target)
    bench.run(0.1)
    assert bench.status == "unreachable"
    assert reason in bench.memory.node("arm")["explanation"]
    assert reason in caplog.text
    assert moves(bench) == []
    bench.memory.update_node("arm", target_joints=AWAY, target_speed=1.0)
    bench.run(1.0)
    assert (bench.status, bench.memory.node("arm")["explanation"]) == ("reached", "")


def test_a_bad_target_stops_what_was_under_trajectory(bench: Bench) -> None:
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(0.1)
    bench.memory.update_node("arm", target_joints=(0.0,))
    bench.run(0.1)
    assert (bench.status, bench.arm.told[-1]) == ("unreachable", ("stop",))


def test_a_mount_that_was_removed_is_back_when_a_pose_needs_it(bench: Bench) -> None:
    bench.run(0.1)
    bench.memory.remove_edge("world", "robot", "RT")
    bench.memory.update_node("arm", target_pose=Pose((0.4, 0.0, 0.1), (1.0, 0.0, 0.0, 0.0)))
    bench.run(3.0)
    assert bench.status == "reached"


def test_a_target_a_little_beyond_a_limit_is_cut_to_it(bench: Bench) -> None:
    bench.memory.update_node("arm", target_joints=(*HOME[:5], -2.1, HOME[6]))
    bench.run(1.0)
    assert bench.status == "reached"
    assert bench.arm.positions[5] == pytest.approx(-2.09)


def test_an_arm_that_gets_stuck_is_stopped(bench: Bench) -> None:
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(0.1)
    bench.arm.stuck = True
    bench.run(0.2)
    assert bench.status == "moving"
    bench.run(0.2)
    assert bench.status == "stopped" and bench.arm.told[-1] == ("stop",)
    assert "rad short of its goal" in bench.memory.node("arm")["explanation"]


def test_silence_of_the_driver_is_reported_once_and_the_target_is_followed_afterwards(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.run(0.1)
    bench.run(0.04, silent=True)
    assert bench.status == "moving"
    bench.run(0.04, silent=True)
    assert bench.status == "no_driver" and bench.arm.told[-1] == ("stop",)
    bench.run(2.0, silent=True)
    assert bench.status == "no_driver"
    assert bench.agent.degraded
    assert len([record for record in caplog.records if "no_driver" in record.message]) == 1
    bench.run(2.0)
    assert bench.status == "reached"
    assert not bench.agent.degraded
    assert len(moves(bench)) == 2


def test_silence_from_the_start_is_reported_and_targets_wait(bench: Bench) -> None:
    bench.memory.update_node("arm", target_joints=AWAY)
    bench.memory.update_node("gripper", target_opening=0.03)
    bench.run(START_UP, silent=True)
    assert bench.status != "no_driver"
    bench.run(0.1, silent=True)
    assert bench.status == "no_driver"
    bench.run(2.0)
    assert bench.status == "reached"
    assert bench.memory.node("gripper")["opening"] == 0.03


def test_a_driver_that_forgot_the_gripper_is_told_again(bench: Bench) -> None:
    bench.memory.update_node("gripper", target_opening=0.03)
    bench.run(0.2)
    bench.run(1.0, silent=True)
    bench.arm.opening = 0.085
    bench.run(0.2)
    gripper = bench.memory.node("gripper")
    assert (gripper["opening"], gripper["status"]) == (0.03, "reached")


def test_idle_arm_is_idle_again_after_silence(bench: Bench) -> None:
    bench.run(0.1)
    bench.run(1.0, silent=True)
    bench.run(0.1)
    assert bench.status == "idle"
    assert bench.arm.told == [("stop",)]  # whatever it seemed to do


def test_a_restarted_controller_goes_on_with_the_target(bench: Bench) -> None:
    bench.memory.update_node("arm", target_joints=AWAY, target_speed=0.1)
    bench.run(0.5)
    bench.own.close()
    bench.start()
    bench.run(3.0)
    assert bench.status == "reached"
    assert bench.arm.positions == pytest.approx(AWAY)


def test_teardown_stops_a_moving_arm(bench: Bench) -> None:
    bench.memory.update_node("arm", target_joints=AWAY, target_speed=0.1)
    bench.run(0.1)
    bench.runner.teardown()
    assert bench.arm.told[-1] == ("stop",)


def test_gripper_opens_to_its_target(bench: Bench) -> None:
    bench.memory.update_node("gripper", target_opening=0.03)
    bench.run(0.1)
    gripper = bench.memory.node("gripper")
    assert (gripper["opening"], gripper["status"]) == (0.03, "reached")


def test_fingers_at_an_object_are_stopped_with_contact(bench: Bench) -> None:
    bench.arm.obstacle = 0.04
    bench.memory.update_node("gripper", target_opening=0.02)
    bench.run(1.5)
    gripper = bench.memory.node("gripper")
    assert (gripper["status"], gripper["contact"]) == ("stopped", True)


@pytest.mark.parametrize("opening", [-0.01, 0.2])
def test_impossible_opening_is_refused(bench: Bench, opening: float) -> None:
    bench.memory.update_node("gripper", target_opening=opening)
    bench.run(0.1)
    gripper = bench.memory.node("gripper")
    assert gripper["status"] == "unreachable"
    assert "expected 0 to 0.085 m" in gripper["explanation"]
    assert bench.arm.told == []
