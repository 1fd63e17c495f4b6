"""The driver of an arm over rmw_zenoh, against action servers of an independent client in a process of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import pytest

from agents.ros_bridge import RosArm
from agents.ros_bridge.link.actions import ABORTED
from agents.ros_bridge.services.deadman import FOLLOW
from agents.ros_bridge.services.goals import GIVEN_UP
from agents.ros_bridge.services.gripper import GRIP, PARALLEL_GRIP
from dsr.clock import WALL_CLOCK, ManualClock
from dsr.network.keys import Keys
from dsr.network.local_transport import LocalNetwork
from tests.agents.ros_bridge.conftest import Router
from tests.agents.ros_bridge.sdk_types import advertise, serve_action
from tests.agents.ros_bridge.simulated import JOINTS, TYPE
from tests.agents.ros_bridge.told import Told, eventually

NAMES = ["joint_1", "joint_2"]
KNUCKLE = "robotiq_85_left_knuckle_joint"
TRAJECTORY, GRIPPER = "/joint_trajectory_controller/follow_joint_trajectory", "/robotiq_gripper_controller/gripper_cmd"
GOAL = ((0.5, 1.0), ((0.1, 0.2), (0.3, 0.4)))
Make = Callable[[], RosArm]


@pytest.fixture
def make(router: Router) -> Iterator[Make]:
    """Makes the driver; the servers may come before it or after."""
    made: list[RosArm] = []

    def arm() -> RosArm:
        bus = LocalNetwork(ManualClock()).connect("a")
        made.append(
            RosArm(
                bus, Keys("g"), joints=NAMES, trajectory=TRAJECTORY, gripper=GRIPPER, gripper_joint=KNUCKLE,
                gripper_closed=0.8, gripper_open=0.0, stroke=0.085, effort=40.0, link={"router": router.endpoint},
            )
        )  # fmt: skip
        return made[-1]

    yield arm
    for one in made:
        one.close()


def told(arm: RosArm, words: str, seconds: float = 20.0) -> None:
    """Wait until the driver tells this."""
    eventually(lambda: any(words in text for text in arm.tally.told), seconds)


def test_a_trajectory_is_carried_out_and_nothing_is_told(make: Make, sdk: Told) -> None:
    serve_action(sdk, TRAJECTORY, FOLLOW)
    sdk.plan(name=TRAJECTORY, goals=[{"seconds": 0.3}])
    arm = make()
    arm.follow(*GOAL)
    (goal,) = eventually(lambda: sdk.asked(name=TRAJECTORY)["goals"])
    assert goal["trajectory"]["joint_names"] == NAMES
    assert [point["positions"] for point in goal["trajectory"]["points"]] == [[0.1, 0.2], [0.3, 0.4]]
    assert goal["trajectory"]["points"][0]["time_from_start"] == {"sec": 0, "nanosec": 500_000_000}
    assert arm._arm_lane.wait_idle(20.0) and arm.tally.told == []


def test_rejected_aborted_and_cancelled_goals_are_told_and_the_next_one_goes(make: Make, sdk: Told) -> None:
    serve_action(sdk, TRAJECTORY, FOLLOW)
    sdk.plan(name=TRAJECTORY, goals=[
        {"accept": False},
        {"seconds": 0.1, "status": ABORTED, "result": {"error_code": -4, "error_string": "path tolerance violated"}},
        {"seconds": 0.1, "status": 5},
        {"seconds": 0.1, "status": ABORTED},
        {"seconds": 0.1},
    ])  # fmt: skip
    arm = make()
    for number, words in enumerate(
        ("rejected the goal", "path tolerance violated", "somebody cancelled it", "aborted, without a reason"), 1
    ):
        arm.follow(*GOAL)
        told(arm, words)
        assert arm.tally.counts[GIVEN_UP] == number
    arm.follow(*GOAL)
    eventually(lambda: len(sdk.asked(name=TRAJECTORY)["goals"]) == 5)
    assert arm._arm_lane.wait_idle(20.0) and arm.tally.counts[GIVEN_UP] == 4


def test_stop_cancels_all_goals_and_holds_where_the_arm_is(make: Make, sdk: Told) -> None:
    serve_action(sdk, TRAJECTORY, FOLLOW)
    advertise(sdk, JOINTS, TYPE[JOINTS])
    values = {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""},
        "name": NAMES, "position": [0.4, 0.5], "velocity": [], "effort": [],
    }  # fmt: skip
    sdk.repeat(messages={JOINTS: values}, hz=50.0)
    sdk.plan(name=TRAJECTORY, goals=[{"seconds": 30.0}, {"seconds": 0.1}])
    arm = make()
    eventually(arm.state)
    arm.follow((30.0,), ((1.0, 1.0),))
    eventually(lambda: sdk.asked(name=TRAJECTORY)["goals"])
    arm.stop()
    asked = eventually(lambda: found if len((found := sdk.asked(name=TRAJECTORY))["goals"]) == 2 else None)
    assert asked["cancelled"] == 1 and asked["goals"][1]["trajectory"]["points"][0]["positions"] == [0.4, 0.5]
    assert arm._arm_lane.wait_idle(20.0) and arm.tally.told == []


def test_a_server_that_goes_in_the_middle_of_a_motion_is_told(make: Make, sdk: Told) -> None:
    serve_action(sdk, TRAJECTORY, FOLLOW)
    sdk.plan(name=TRAJECTORY, goals=[{"seconds": 60.0}])
    arm = make()
    arm.follow((60.0,), ((1.0, 1.0),))
    eventually(lambda: any(thread.name == "ros-result" for thread in threading.enumerate()))  # it was accepted
    sdk.kill()
    told(arm, "nobody knows how a motion ended: its controller is gone")
    assert arm._arm_lane.wait_idle(20.0)
    arm.follow(*GOAL)
    told(arm, "a motion was not begun: nobody serves")


def test_a_result_that_comes_late_is_told_and_taken(make: Make, sdk: Told) -> None:
    serve_action(sdk, TRAJECTORY, FOLLOW)
    sdk.plan(name=TRAJECTORY, goals=[
        {"seconds": 0.1, "late": 7.0, "status": ABORTED, "result": {"error_code": -5, "error_string": "too late"}}
    ])  # fmt: skip
    arm = make()
    arm.follow((0.2,), ((0.1, 0.1),))
    told(arm, "has not said how a motion of 0.2 s ended")
    told(arm, "the controller gave a motion up: too late")


def test_a_newer_motion_does_not_wait_for_the_end_of_the_old_one(make: Make, sdk: Told) -> None:
    serve_action(sdk, TRAJECTORY, FOLLOW)
    sdk.plan(name=TRAJECTORY, goals=[{"seconds": 60.0}, {"seconds": 0.1}])
    arm = make()
    arm.follow((60.0,), ((1.0, 1.0),))
    eventually(lambda: sdk.asked(name=TRAJECTORY)["goals"])
    arm.follow(*GOAL)
    eventually(lambda: len(sdk.asked(name=TRAJECTORY)["goals"]) == 2, 5.0)


@pytest.mark.parametrize("type", [GRIP, PARALLEL_GRIP])
def test_the_gripper_speaks_the_action_that_its_controller_offers(make: Make, sdk: Told, type: str) -> None:
    """ros2_kortex for Humble has the one, for Jazzy the other, under one name."""
    serve_action(sdk, GRIPPER, type)
    sdk.plan(name=GRIPPER, goals=[
        {"seconds": 0.1, "status": ABORTED, "result": {"stalled": True}},
        {"seconds": 0.1, "result": {"reached_goal": True}},
        {"accept": False},
    ])  # fmt: skip
    arm = make()
    arm.move_gripper(0.0)
    eventually(lambda: arm._stalled)
    arm.move_gripper(0.085)
    goals = eventually(lambda: found if len(found := sdk.asked(name=GRIPPER)["goals"]) == 2 else None)
    assert arm._grip_lane.wait_idle(20.0) and not arm._stalled and arm.tally.told == []
    closing, opening = (goal["command"] for goal in goals)
    if type == GRIP:
        assert closing == {"position": pytest.approx(0.8), "max_effort": 40.0} and opening["position"] == 0.0
    else:
        assert (closing["name"], closing["position"], closing["effort"]) == ([KNUCKLE], [pytest.approx(0.8)], [40.0])
        assert opening["position"] == [0.0]
    arm.move_gripper(0.0)
    told(arm, "a motion of the gripper was not begun")


def test_a_driver_whose_servers_are_not_there_ends_at_once(make: Make) -> None:
    arm = make()
    arm.follow(*GOAL)
    began = WALL_CLOCK.monotonic()
    arm.close()
    assert WALL_CLOCK.monotonic() - began < 8.0


def test_motions_are_cancelled_by_a_process_of_its_own_when_no_sign_of_life_comes(make: Make, sdk: Told) -> None:
    serve_action(sdk, TRAJECTORY, FOLLOW)
    sdk.plan(name=TRAJECTORY, goals=[{"seconds": 60.0}])
    arm = make()
    arm.follow((60.0,), ((1.0, 1.0),))
    eventually(lambda: sdk.asked(name=TRAJECTORY)["goals"])
    arm.keep_alive()
    told(arm, "somebody cancelled it")
    assert sdk.asked(name=TRAJECTORY)["cancelled"] == 1


def test_the_process_that_cancels_when_the_driver_dies_is_started_again_if_it_ends(make: Make) -> None:
    arm = make()
    arm.keep_alive()
    first = arm._deadman
    assert first is not None
    first._process.kill()

    def is_new() -> bool:
        arm.keep_alive()
        return arm._deadman is not first

    eventually(is_new)
    told(arm, "the process that cancels motions when this driver dies has ended: it is started again")
    assert arm._deadman is not None and not arm._deadman.ended
