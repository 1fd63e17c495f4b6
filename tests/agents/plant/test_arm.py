"""The simulated arm: it goes where it is told at the speed it is told, and grips by contact."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from agents.joint_ramp import ACCELERATION, CATCH_UP, JERK
from agents.plant.arm import SimulatedArm
from agents.plant.messages import Follow, KeepAlive
from agents.plant.reality import Reality
from agents.plant.world import World
from agents.scenario.format.scenario import ObjectSpec, RobotSpec
from dsr.errors import ConfigError
from dsr.files.built_in import ETC
from dsr.math3d.transforms import Pose

MakeReality = Callable[..., Reality]
MakeCube = Callable[..., ObjectSpec]
Play = Callable[..., None]
Send = Callable[..., None]

ABOVE = (-0.4483, 0.2902, 3.3772, -2.2089, -0.1101, -0.653, -0.1347)
AT = (-0.3031, 0.6584, 3.2044, -2.3157, -0.2255, -0.1727, -0.0312)
"""Joint positions, rad, with the tool point 150 and 20 mm above the table at (0.30, 0.08), pointing down."""


def test_stands_still_at_its_start(make_reality: MakeReality, play: Play) -> None:
    start = RobotSpec().start
    reality = make_reality()
    play(reality, 0.5)
    assert reality.arm.positions == pytest.approx([*start[:5], max(start[5], -2.09), start[6]], abs=1e-3)
    assert reality.arm.opening == pytest.approx(0.085, abs=1e-3)
    assert not reality.arm.contact


def test_reaches_its_target_within_the_velocity_limits(make_reality: MakeReality, send: Send) -> None:
    reality = make_reality()
    send(reality.arm, ABOVE)
    fastest = np.zeros(7)
    for _ in range(600):
        reality.step(None)
        fastest = np.maximum(fastest, np.abs(reality.arm.velocities))
    assert reality.arm.positions == pytest.approx(ABOVE, abs=1e-3)
    assert (fastest < np.array([1.3963] * 4 + [1.2218] * 3) * 1.02).all()
    assert fastest.max() > 1.0


def test_speed_scales_the_motion(make_reality: MakeReality, play: Play, send: Send) -> None:
    reality = make_reality()
    start = np.array(reality.arm.positions)
    send(reality.arm, start + 0.5, speed=0.1)
    play(reality, 1.0)
    assert 0.05 < np.abs(reality.arm.positions - start).max() < 0.15


def test_stop_brakes_within_the_limits_and_holds_the_position(
    make_reality: MakeReality, play: Play, send: Send
) -> None:
    reality = make_reality()
    send(reality.arm, ABOVE)
    play(reality, 0.5)
    before, fastest = np.array(reality.arm.positions), max(map(abs, reality.arm.velocities))
    reality.arm.stop()
    braking = fastest / ACCELERATION + ACCELERATION / JERK
    play(reality, braking + 0.1)
    here = reality.arm.positions
    assert np.abs(here - before).max() == pytest.approx(0.5 * fastest * braking, rel=0.2)
    play(reality, 0.5)
    assert reality.arm.positions == pytest.approx(here, abs=1e-3)


def test_passes_through_a_trajectory_in_time(make_reality: MakeReality, play: Play) -> None:
    reality = make_reality()
    start = np.array(reality.arm.positions)
    rows = [start + offset for offset in (0.0, 0.1, 0.3)]
    reality.arm.follow((0.0, 0.3, 0.8), rows)
    play(reality, 0.55)
    assert reality.arm.positions == pytest.approx(start + 0.2, abs=0.01)
    assert reality.arm.velocities == pytest.approx(np.full(7, 0.4), abs=0.02)
    play(reality, 0.5)
    assert reality.arm.positions == pytest.approx(rows[-1], abs=1e-3)


def test_a_new_way_ends_a_trajectory(make_reality: MakeReality, play: Play, send: Send) -> None:
    reality = make_reality()
    here = np.array(reality.arm.positions)
    reality.arm.follow((0.0, 5.0), [here, here + 1.0])
    play(reality, 0.5)
    send(reality.arm, here)
    play(reality, 1.5)
    assert reality.arm.positions == pytest.approx(here, abs=1e-3)


def test_targets_are_cut_to_the_limits(make_reality: MakeReality, play: Play, send: Send) -> None:
    reality = make_reality()
    positions = list(RobotSpec().start)
    positions[5] = -3.0
    send(reality.arm, positions)
    play(reality, 1.5)
    assert reality.arm.positions[5] == pytest.approx(-2.09, abs=1e-3)


def test_grasps_carries_and_lets_go(make_reality: MakeReality, cube: MakeCube, play: Play, send: Send) -> None:
    reality = make_reality(cube(4, 0.30, 0.08), robot=RobotSpec(start=AT))
    arm, world = reality.arm, reality.world
    arm.move_gripper(0.0)
    play(reality, 1.0)
    assert arm.held == "cube_4" and arm.contact
    assert arm.opening == pytest.approx(0.04, abs=1e-3)
    send(arm, ABOVE)
    play(reality, 1.5)
    assert world.pose("cube_4").t == pytest.approx((0.30, 0.08, 0.15), abs=0.004)
    arm.move_gripper(0.085)
    play(reality, 1.5)
    assert arm.held is None and not arm.contact
    assert world.pose("cube_4").t[2] == pytest.approx(0.02, abs=1e-3)


def test_a_stopped_arm_keeps_what_it_holds(make_reality: MakeReality, cube: MakeCube, play: Play, send: Send) -> None:
    reality = make_reality(cube(4, 0.30, 0.08), robot=RobotSpec(start=AT))
    arm = reality.arm
    arm.move_gripper(0.0)
    play(reality, 1.0)
    send(arm, ABOVE)
    play(reality, 0.4)
    arm.stop()
    play(reality, 0.5)
    here = reality.world.pose("cube_4")
    play(reality, 2.0)
    assert arm.held == "cube_4" and arm.contact
    assert reality.world.pose("cube_4").distance(here)[0] < 2e-3


def test_what_is_taken_out_of_the_gripper_is_not_grasped_again(
    make_reality: MakeReality, cube: MakeCube, play: Play
) -> None:
    reality = make_reality(cube(4, 0.30, 0.08), robot=RobotSpec(start=AT))
    arm = reality.arm
    arm.move_gripper(0.0)
    play(reality, 1.0)
    arm.let_go()
    play(reality, 0.5)
    assert arm.held is None
    reality.world.put("cube_4", Pose((0.5, 0.3, 0.02)))
    play(reality, 0.5)
    assert not arm.contact


def test_closing_on_nothing_holds_nothing(make_reality: MakeReality, play: Play) -> None:
    reality = make_reality()
    reality.arm.move_gripper(0.0)
    play(reality, 1.5)
    assert reality.arm.held is None
    assert reality.arm.opening == pytest.approx(0.0, abs=1e-3)


def test_unknown_model_and_wrong_start_are_refused(make_reality: MakeReality, make_world: Callable[..., World]) -> None:
    with pytest.raises(ConfigError, match=r"unknown robot model 'gen4'; valid: gen3, .*, or the path of"):
        make_reality(robot=RobotSpec(model="gen4"))
    with pytest.raises(ConfigError, match="has 7 joints and fingers on 2 sides; expected 6 joints"):
        SimulatedArm(make_world(), ETC / "robots" / "gen3.urdf", ABOVE[:6])


def test_wrist_camera_moves_with_the_arm(make_reality: MakeReality, play: Play, send: Send) -> None:
    reality = make_reality(robot=RobotSpec(start=AT), camera="wrist")
    tool_from_camera = reality.arm.link_pose("tool_link").inverse() @ reality.camera.pose
    assert reality.camera.pose.rotation_matrix[:, 2] == pytest.approx((0.0, 0.0, -1.0), abs=0.01)
    send(reality.arm, ABOVE)
    play(reality, 1.5)
    metres, radians = (reality.arm.link_pose("tool_link").inverse() @ reality.camera.pose).distance(tool_from_camera)
    assert metres < 1e-5 and radians < 1e-5
    with pytest.raises(ConfigError, match=r"no link 'tool_lnk'; did you mean 'tool_link'"):
        reality.arm.link_pose("tool_lnk")


def test_a_way_that_begins_where_the_arm_is_not_is_refused_and_told(make_reality: MakeReality, play: Play) -> None:
    reality = make_reality(config={"deadman": 0.0})
    start = reality.arm.positions
    far = (start[0] + 0.4, *start[1:])
    reality.obey(Follow((0.0, 1.0), (far, far)))
    play(reality, 0.3)
    state = reality.arm_state(0.3)
    assert state is not None and state.fault == "the way begins 0.40 rad from where joint_1 is"
    assert reality.arm.positions == pytest.approx(start, abs=1e-3)
    reality.obey(KeepAlive())
    reality.obey(Follow((0.0, 1.0), (start, far)))
    play(reality, 1.5, start=0.3)
    state = reality.arm_state(1.8)
    assert state is not None and state.fault == "" and state.positions == pytest.approx(far, abs=1e-3)


@pytest.mark.parametrize("beside", [(0.06, -0.06, 0.08), (-0.09, 0.09, 0.0)])
def test_a_way_that_begins_beside_the_arm_is_joined_smoothly(
    make_reality: MakeReality, play: Play, beside: tuple[float, ...]
) -> None:
    """As of a controller whose samples are false: the arm does not jump there, and a stop soon after it is short."""
    reality = make_reality(config={"deadman": 0.0})
    start = np.array(reality.arm.positions)
    first = start + np.array((*beside, 0.0, 0.0, 0.0, 0.0))
    reality.obey(Follow((0.0, 1.0), (tuple(first), tuple(first))))
    play(reality, 0.1)
    assert np.abs(reality.arm.velocities).max() < 2 * (CATCH_UP - 1.0) * 1.3963  # rad/s; the motors overshoot
    reality.arm.stop()
    play(reality, 0.5, start=0.1)
    assert np.abs(reality.arm.positions - start).max() < 0.03


def test_an_arm_that_meets_something_while_it_brakes_rests_there(
    make_reality: MakeReality, play: Play, send: Send
) -> None:
    """It presses no further, and a way from where it is begins where it is."""
    reality = make_reality(config={"deadman": 0.0})
    send(reality.arm, ABOVE)
    play(reality, 3.0)
    low = np.array(AT) + 0.5 * (np.array(AT) - np.array(ABOVE))  # below the table
    send(reality.arm, low)
    while reality.arm.link_pose(reality.arm.model.tool).t[2] > 0.03:
        reality.step(None)
    reality.arm.stop()
    play(reality, 1.0)
    here = reality.arm.positions
    assert not reality.arm.is_driven
    reality.obey(Follow((0.0, 1.0), (here, ABOVE)))
    state = reality.arm_state(0.0)
    assert state is not None and state.fault == ""
    assert np.abs(np.array(reality.arm._ramp.positions) - here).max() < 0.01
