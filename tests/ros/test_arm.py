"""An arm whose controllers are real action servers of rclpy under Fast DDS, driven through its own ROS."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from agents.ros_bridge import RosArm
from agents.ros_bridge.errors import RosAbsentError, RosLinkError, RosSettingError
from agents.ros_bridge.link.actions import CANCELED, ActionClient
from agents.ros_bridge.link.dds.dds_link import DdsLink
from agents.ros_bridge.link.link import LinkConfig
from agents.ros_bridge.messages.types import types_of
from agents.ros_bridge.services.deadman import ALL_GOALS, FOLLOW
from agents.ros_bridge.services.goals import GIVEN_UP
from dsr.clock import ManualClock
from dsr.network.keys import Keys
from dsr.network.local_transport import LocalNetwork
from dsr.vocabulary.halting import HaltOrder, send_order
from tests.agents.ros_bridge.told import eventually
from tests.ros.real_node import PYTHON, RealNode

JOINTS = ["a", "b"]
CONTROLLER = "/joint_trajectory_controller/follow_joint_trajectory"
HELD = 0.4  # rad of the gripper's joint, at which it holds something
KEYS = Keys("arm")
TYPES = types_of("jazzy")
Start = Callable[[str], RealNode]


@pytest.fixture
def network() -> LocalNetwork:
    return LocalNetwork(ManualClock())


@pytest.fixture
def controllers(real_node: Start) -> RealNode:
    node = real_node("controllers")
    node.play_arm(joints=JOINTS, held=HELD)
    return node


def options(domain: int) -> dict[str, Any]:
    return {"transport": "dds", "domain": domain, "installed_ros": str(PYTHON)}


@pytest.fixture
def arm(controllers: RealNode, domain: int, network: LocalNetwork) -> Iterator[RosArm]:
    made = RosArm(
        network.connect("arm"), KEYS, joints=JOINTS, gripper="/gripper/gripper_cmd", gripper_joint="knuckle",
        gripper_closed=0.8, gripper_open=0.0, deadman=0.0, link=options(domain),
    )  # fmt: skip
    eventually(made.state)
    yield made
    made.close()


@pytest.fixture
def asking(domain: int) -> Iterator[DdsLink]:
    opened = DdsLink(LinkConfig(transport="dds", domain=domain, installed_ros=str(PYTHON)), "/dsr/asking")
    yield opened
    opened.close()


def near(places: tuple[float, ...] | list[float], wanted: list[float]) -> bool:
    return all(abs(a - b) < 1e-6 for a, b in zip(places, wanted, strict=True))


def begin(arm: RosArm, controllers: RealNode, times: tuple[float, ...], places: tuple[tuple[float, ...], ...]) -> None:
    """Command a path until the controller goes: at first, it may not be found yet."""

    def goes() -> bool:
        given_up = arm.tally.counts[GIVEN_UP]
        arm.follow(times, places)
        eventually(lambda: controllers.arm_now()["moves"] or arm.tally.counts[GIVEN_UP] > given_up)
        return bool(controllers.arm_now()["moves"])

    eventually(goes)


def test_a_path_is_followed_and_the_gripper_feels_what_it_holds(arm: RosArm, controllers: RealNode) -> None:
    begin(arm, controllers, (0.5, 1.0), ((0.1, 0.0), (0.3, -0.2)))
    eventually(lambda: controllers.arm_now()["ended"] == ["reached"])
    eventually(lambda: (state := arm.state()) is not None and near(state.positions, [0.3, -0.2]))
    arm.move_gripper(0.0)
    eventually(lambda: (state := arm.state()) is not None and state.gripper_contact)
    assert abs(controllers.arm_now()["knuckle"] - HELD) < 1e-6
    arm.move_gripper(0.085)

    def is_open() -> bool:
        state = arm.state()
        return state is not None and state.gripper_opening > 0.084 and not state.gripper_contact

    eventually(is_open)
    assert not [text for text in arm.tally.told if "gave" in text]


def test_a_halt_stops_it_in_the_middle(arm: RosArm, controllers: RealNode, network: LocalNetwork) -> None:
    begin(arm, controllers, (30.0,), ((3.0, 0.0),))
    eventually(lambda: controllers.arm_now()["at"][0] > 0.02)
    send_order(network.connect("person"), KEYS, HaltOrder("1", True, "person"))
    network.deliver()
    eventually(lambda: controllers.arm_now()["ended"][-2:] == ["canceled", "reached"])  # the second holds the place
    place = controllers.arm_now()["at"]
    assert place[0] < 1.0
    arm.follow((1.0,), ((3.0, 0.0),))
    assert arm.tally.counts["motions refused"] == 1 and near(controllers.arm_now()["at"], place)


def test_whoever_dies_leaves_no_motion(controllers: RealNode, domain: int, network: LocalNetwork) -> None:
    """The deadman's process cancels, in a ROS of its own, what the driver does not end."""
    arm = RosArm(network.connect("arm"), KEYS, joints=JOINTS, deadman=1.0, link=options(domain))
    try:
        eventually(arm.state)
        begin(arm, controllers, (60.0,), ((3.0, 0.0),))
        eventually(lambda: controllers.arm_now()["at"][0] > 0.02)
        arm.keep_alive()
        eventually(lambda: controllers.arm_now()["ended"] == ["canceled"])  # no sign of life follows the first one
    finally:
        arm.close()


def test_a_halt_stops_it_although_the_process_in_ros_hangs(
    controllers: RealNode, domain: int, network: LocalNetwork
) -> None:
    """The deadman's process has a ROS of its own, which is asked then. The driver's own one is started again."""
    arm = RosArm(network.connect("arm"), KEYS, joints=JOINTS, deadman=600.0, link=options(domain))
    process = None
    try:
        eventually(arm.state)
        arm.keep_alive()
        eventually(lambda: any(one.node == "/dsr_deadman_services" for one in arm.link.endpoints()))
        begin(arm, controllers, (600.0,), ((3.0, 0.0),))
        assert isinstance(arm.link, DdsLink) and arm.link._installed is not None
        process = arm.link._installed._process._process
        os.kill(process.pid, signal.SIGSTOP)
        send_order(network.connect("person"), KEYS, HaltOrder("1", True, "person"))
        network.deliver()
        eventually(lambda: not controllers.arm_now()["moves"])  # cancelled, or aborted by the goal to hold its place
        assert controllers.arm_now()["at"][0] < 1.0
        eventually(lambda: any("it did not react for 1 s, and was killed" in text for text in arm.tally.told))
    finally:
        arm.close()
    assert process is not None and process.poll() is not None


def test_joints_that_the_controller_has_not_are_rejected_and_told(
    controllers: RealNode, domain: int, network: LocalNetwork
) -> None:
    arm = RosArm(network.connect("arm"), KEYS, joints=["a", "other"], deadman=0.0, link=options(domain))
    try:

        def is_told() -> bool:
            arm.follow((1.0,), ((0.1, 0.1),))
            return any("rejected the goal" in text for text in arm.tally.told)

        eventually(is_told)
    finally:
        arm.close()


def test_a_goal_can_be_cancelled_by_its_id_and_by_that_of_all(asking: DdsLink, controllers: RealNode) -> None:
    client = ActionClient(asking, TYPES, CONTROLLER, FOLLOW)
    point = TYPES.new(
        "trajectory_msgs/msg/JointTrajectoryPoint", positions=(1.0, 1.0),
        time_from_start=TYPES.new("builtin_interfaces/msg/Duration", sec=60),
    )  # fmt: skip
    trajectory = TYPES.new("trajectory_msgs/msg/JointTrajectory", joint_names=JOINTS, points=[point])
    goal = TYPES.new(f"{FOLLOW}_Goal", trajectory=trajectory)
    first = client.send(goal, 30.0)
    assert first.cancel(30.0) and first.outcome(30.0).status == CANCELED
    second = client.send(goal, 30.0)
    assert client.cancel(ALL_GOALS, 30.0) and second.outcome(30.0).status == CANCELED
    client.close()


def test_a_service_without_a_server_and_one_that_this_ros_does_not_know_are_told(asking: DdsLink) -> None:
    request = TYPES.encode("std_srvs/srv/Trigger_Request", TYPES.new("std_srvs/srv/Trigger_Request"))
    with pytest.raises(RosAbsentError, match=r"nobody serves /nothing \(std_srvs/srv/Trigger\) within 0.5 s"):
        asking.call("/nothing", "std_srvs/srv/Trigger", request, 0.5)
    with pytest.raises(RosLinkError, match="the robot's ROS has no dsr_msgs/srv/Ask"):
        asking.call("/ask", "dsr_msgs/srv/Ask", request, 0.5)


def test_a_process_in_ros_that_was_killed_is_started_again(asking: DdsLink, controllers: RealNode) -> None:
    client = ActionClient(asking, TYPES, CONTROLLER, FOLLOW)
    assert client.cancel(ALL_GOALS, 30.0)
    installed = asking._installed
    assert installed is not None
    process = installed._process
    os.kill(process._process.pid, signal.SIGKILL)
    assert eventually(lambda: any("the process in the robot's ROS ended" in text for text in asking.problems()))
    assert client.cancel(ALL_GOALS, 30.0) and installed._process is not process
    assert not any("robot's ROS" in text for text in asking.problems())
    client.close()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("raise ImportError('No module named rclpy')", "No module named rclpy"),
        ("print('no JSON'); raise SystemExit('it is broken')", "it is broken"),
    ],
)
def test_a_ros_that_does_not_start_is_told(tmp_path: Path, domain: int, text: str, reason: str) -> None:
    broken = tmp_path / "python"
    broken.write_text(f'#!/bin/sh\nexec {PYTHON} -c "{text}"\n')
    broken.chmod(0o755)
    with pytest.raises(RosLinkError, match=reason):
        DdsLink(LinkConfig(transport="dds", domain=domain, installed_ros=str(broken)), "/dsr/asking")


def test_a_setup_file_is_sourced(tmp_path: Path, domain: int) -> None:
    setup = tmp_path / "setup.bash"
    setup.write_text(f'export PATH="{PYTHON.parent}:$PATH"\n')
    link = DdsLink(LinkConfig(transport="dds", domain=domain, installed_ros=str(setup)), "/dsr/asking")
    link.close()


def test_a_file_that_is_not_there_is_told(domain: int) -> None:
    with pytest.raises(RosSettingError, match=r"there is no such file; such as /opt/ros/jazzy/setup\.bash"):
        DdsLink(LinkConfig(transport="dds", domain=domain, installed_ros="/nowhere/setup.bash"), "/dsr/asking")


def check(domain: int, python: Path) -> tuple[int, str]:
    options = ["--transport", "dds", "--domain", str(domain), "--installed-ros", str(python), "--for", "0.1"]
    program = [sys.executable, "-m", "dsr.cli", "ros", "check", *options]
    process = subprocess.run(program, check=False, capture_output=True, text=True)
    return process.returncode, " ".join((process.stdout + process.stderr).split())


def test_check_names_the_nodes_and_tells_which_actions_this_ros_does_not_know(
    controllers: RealNode, domain: int, tmp_path: Path
) -> None:
    code, said = check(domain, PYTHON)
    assert code == 0 and "/controllers" in said and "nothing stands in the way" in said, said
    without = tmp_path / "python"
    without.write_text(f"#!/bin/sh\nPYTHONPATH={tmp_path} exec {PYTHON} \"$@\"\n")
    without.chmod(0o755)
    (tmp_path / "control_msgs").mkdir()
    (tmp_path / "control_msgs" / "__init__.py").touch()
    code, said = check(domain, without)
    assert code == 1 and "the robot's ROS has no control_msgs/action/FollowJointTrajectory_SendGoal" in said, said
