"""Arms, cameras and detectors of tags that speak ROS, as drivers of the agents."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any, cast

import cv2
import numpy as np
import pytest

from agents.drivers import SILENCE, Diagnosed, make_driver
from agents.ros_bridge import RosArm, RosCamera, RosTags
from agents.ros_bridge.errors import RosLinkError
from agents.ros_bridge.link.link import Qos
from agents.ros_bridge.link.local import LocalLink, LocalRos
from agents.ros_bridge.mapping.cameras import to_camera_info
from agents.ros_bridge.mapping.images import to_image
from agents.ros_bridge.mapping.joints import to_joint_state
from agents.ros_bridge.mapping.stamps import to_header, to_seconds
from agents.ros_bridge.services.deadman import FOLLOW
from agents.ros_bridge.services.gripper import GRIP
from agents.ros_bridge.services.lane import Lane
from agents.scene_estimator.pose import NoiseModel
from agents.scene_estimator.sighting import FrameSource
from dsr import Frame
from dsr.clock import ManualClock
from dsr.errors import ConfigError, WireError
from dsr.network.keys import Keys
from dsr.network.local_transport import LocalNetwork
from dsr.vocabulary.halting import HaltOrder, send_order
from dsr.vocabulary.intrinsics import Intrinsics
from tests.agents.ros_bridge.robot import TYPES, Robot

PATIENCE = 10.0
NAMES = ("j1", "j2")


@pytest.fixture
def ros(monkeypatch: pytest.MonkeyPatch) -> LocalRos:
    clock = ManualClock()
    ros = LocalRos(clock)
    for driver in (RosArm, RosCamera, RosTags):
        monkeypatch.setattr(driver, "connect", staticmethod(lambda link, node: LocalLink(ros, node)))
        monkeypatch.setattr(driver, "clock", clock)
    return ros


def made(kind: type, **options: Any) -> Any:
    bus = LocalNetwork(ManualClock()).connect("a")
    return make_driver(f"agents.ros_bridge:{kind.__name__}", bus, Keys("g"), **options)


class Controller:
    """A server of one action, as a ros2_control controller is; goals end when they are told to, or cancelled."""

    def __init__(self, ros: LocalRos, name: str, type: str) -> None:
        self.link = LocalLink(ros, f"/controller_{name.replace('/', '_')}")
        self.type = type
        self.goals: list[Any] = []
        self.cancelled: list[bytes] = []
        self.accepts = True
        self.before_accepting: Any = lambda: None
        self.changed = threading.Condition()
        self._ended: dict[bytes, tuple[int, Any]] = {}
        self.link.serve(f"{name}/_action/send_goal", f"{type}_SendGoal", self._send)
        self.link.serve(f"{name}/_action/get_result", f"{type}_GetResult", self._result)
        self.link.serve(f"{name}/_action/cancel_goal", "action_msgs/srv/CancelGoal", self._cancel)
        self._ids: list[bytes] = []

    def end(self, number: int, status: int, **result: Any) -> None:
        """Let a goal end."""
        with self.changed:
            self._ended[self._ids[number]] = status, TYPES.new(f"{self.type}_Result", **result)
            self.changed.notify_all()

    def wait(self, goals: int) -> None:
        """Wait until so many goals came."""
        with self.changed:
            assert self.changed.wait_for(lambda: len(self.goals) >= goals, PATIENCE)

    def _send(self, cdr: bytes) -> bytes:
        request = TYPES.decode(f"{self.type}_SendGoal_Request", cdr)
        self.before_accepting()
        with self.changed:
            if self.accepts:
                self._ids.append(bytes(request.goal_id.uuid))
                self.goals.append(request.goal)
            self.changed.notify_all()
        return self._encoded("SendGoal_Response", accepted=self.accepts)

    def _result(self, cdr: bytes) -> bytes:
        id = bytes(TYPES.decode(f"{self.type}_GetResult_Request", cdr).goal_id.uuid)
        with self.changed:
            self.changed.wait_for(lambda: id in self._ended or {id, bytes(16)} & set(self.cancelled), PATIENCE)
            status, result = self._ended.get(id, (5, TYPES.new(f"{self.type}_Result")))
        return self._encoded("GetResult_Response", status=status, result=result)

    def _cancel(self, cdr: bytes) -> bytes:
        request = TYPES.decode("action_msgs/srv/CancelGoal_Request", cdr)
        with self.changed:
            self.cancelled.append(bytes(request.goal_info.goal_id.uuid))
            self.changed.notify_all()
        return TYPES.encode("action_msgs/srv/CancelGoal_Response", TYPES.new("action_msgs/srv/CancelGoal_Response"))

    def _encoded(self, part: str, **fields: Any) -> bytes:
        return TYPES.encode(f"{self.type}_{part}", TYPES.new(f"{self.type}_{part}", **fields))


class Arm:
    """The driver with the controllers of its arm and its gripper."""

    def __init__(self, ros: LocalRos) -> None:
        self.ros = ros
        self.robot = Robot(ros)
        self.follow, self.grip = Controller(ros, "/arm/follow", FOLLOW), Controller(ros, "/hand/grip", GRIP)
        self.driver: RosArm = made(
            RosArm, joints=NAMES, trajectory="/arm/follow", gripper="/hand/grip", gripper_joint="finger",
            gripper_closed=0.8, gripper_open=0.0, stroke=0.085, effort=40.0,
        )  # fmt: skip

    def tell(self, names: tuple[str, ...], positions: tuple[float, ...], stamp: float | None = None) -> None:
        stamp = self.ros.clock.now() if stamp is None else stamp
        message = to_joint_state(TYPES, stamp, names, positions)
        type = "sensor_msgs/msg/JointState"
        self.robot.publisher("/joint_states", type, Qos()).send(TYPES.encode(type, message))


@pytest.fixture
def arm(ros: LocalRos) -> Iterator[Arm]:
    found = Arm(ros)
    yield found
    for controller in (found.follow, found.grip):
        with controller.changed:
            controller.cancelled.append(bytes(16))
            controller.changed.notify_all()
    found.driver.close()


def test_the_state_is_that_of_all_joints(arm: Arm) -> None:
    assert arm.driver.state() is None
    arm.tell(("j2", "other"), (0.2, 9.0))
    assert arm.driver.state() is None
    arm.tell(("j1",), (0.1,))
    arm.tell(("finger",), (0.4,))
    state = arm.driver.state()
    assert state is not None
    assert (state.names, state.positions) == (NAMES, (0.1, 0.2))
    assert state.gripper_opening == pytest.approx(0.0425) and state.stamp == pytest.approx(arm.ros.clock.now())
    arm.tell(("j1",), (0.5,), stamp=arm.ros.clock.now() + 10.0)
    assert arm.driver.state() is state and arm.driver.tally.counts["from the future"] == 1
    arm.tell(("j1",), (0.6,))
    state = arm.driver.state()
    assert state is not None and state.positions == (0.6, 0.2), "what came from the future holds nothing up"
    arm.tell(NAMES, (0.7, float("nan")))
    assert arm.driver.state() is state and arm.driver.tally.counts["malformed"] == 1


def test_a_joint_that_is_not_told_any_more_holds_the_stamp_up(arm: Arm) -> None:
    arm.tell(NAMES, (0.1, 0.2))
    state = arm.driver.state()
    assert state is not None
    for _ in range(3):
        arm.ros.clock.advance(0.02)
        arm.tell(("j1",), (0.3,))
        held = arm.driver.state()
        assert held is not None and held.stamp == state.stamp, "the controller counts that as silence"
    arm.tell(("j2",), (0.2,))
    held = arm.driver.state()
    assert held is not None and held.stamp == pytest.approx(arm.ros.clock.now())


def test_efforts_are_those_that_are_told_and_no_others(arm: Arm) -> None:
    arm.tell((*NAMES, "finger"), (0.1, 0.2, 0.4))
    state = arm.driver.state()
    assert state is not None and state.efforts == () and state.gripper_effort is None
    type = "sensor_msgs/msg/JointState"
    message = to_joint_state(TYPES, arm.ros.clock.now(), (*NAMES, "finger"), (0.1, 0.2, 0.4))
    message.effort = np.array([3.0, -4.0, -25.0])
    arm.robot.publisher("/joint_states", type, Qos()).send(TYPES.encode(type, message))
    state = arm.driver.state()
    assert state is not None and state.efforts == (3.0, -4.0) and state.gripper_effort == 25.0


def test_a_stamp_of_long_ago_is_told(arm: Arm) -> None:
    arm.tell(NAMES, (0.1, 0.2), stamp=arm.ros.clock.now() - 100.0)
    assert arm.driver.state() is not None
    assert arm.driver.tally.told == [
        "a sample is stamped 100.0 s behind our clock: set the clocks, or `restamp = true`"
    ]  # fmt: skip


def test_velocities_that_are_not_told_are_measured(arm: Arm) -> None:
    """An arm that seems to stand still would be stopped on its way."""
    began, clock = arm.ros.clock.now(), cast(ManualClock, arm.ros.clock)
    for step in range(41):  # at 100 Hz
        clock.advance_to(began + 0.01 * step)
        arm.tell(NAMES, (0.02 * step, 1.0))
    state = arm.driver.state()
    assert state is not None and state.velocities == pytest.approx((2.0, 0.0))
    for step in range(41, 71):
        clock.advance_to(began + 0.01 * step)
        arm.tell(NAMES, (0.8, 1.0))
    state = arm.driver.state()
    assert state is not None and state.velocities == (0.0, 0.0)
    clock.advance(5.0)
    arm.tell(NAMES, (0.0, 1.0))
    state = arm.driver.state()
    assert state is not None and state.velocities == (0.0, 0.0), "nobody knows how long it took"


def test_a_trajectory_goes_to_the_controller(arm: Arm) -> None:
    arm.driver.follow((0.0, 0.5, 1.25), ((0.0, 0.0), (0.1, 0.2), (0.3, 0.4)))
    arm.follow.wait(1)
    trajectory = arm.follow.goals[0].trajectory
    assert trajectory.joint_names == list(NAMES)
    assert [(to_seconds(p.time_from_start), p.positions.tolist()) for p in trajectory.points] == [
        (0.5, [0.1, 0.2]), (1.25, [0.3, 0.4])
    ]  # fmt: skip
    arm.follow.end(0, 4)


@pytest.mark.parametrize(
    ("way", "said"),
    [
        (((0.4, 0.2), (0.5, 0.5)), "the way begins 0.30 rad from where j2 is"),
        (((0.4, 0.5), (0.5, float("nan"))), "the way has numbers that are not finite"),
        (((0.4, 0.5), (0.5, float("inf"))), "the way has numbers that are not finite"),
    ],
)  # fmt: skip
def test_a_way_that_begins_elsewhere_or_is_none_is_refused_told_and_the_arm_stopped(
    arm: Arm, way: tuple[tuple[float, ...], ...], said: str
) -> None:
    arm.tell(NAMES, (0.4, 0.5))
    assert arm.driver.state() is not None
    arm.driver.follow((0.0, 1.0), way)
    arm.follow.wait(1)
    assert [list(point.positions) for point in arm.follow.goals[0].trajectory.points] == [[0.4, 0.5]], "it holds still"
    assert arm.driver.tally.counts["motions refused"] == 1 and f"a motion was refused: {said}" in arm.driver.tally.told
    arm.follow.end(0, 4)
    clock = cast(ManualClock, arm.ros.clock)
    for passed, fault in ((0.02, said), (1.0, "")):
        clock.advance(passed)
        arm.tell(NAMES, (0.4, 0.5))
        state = arm.driver.state()
        assert state is not None and state.fault == fault
    arm.driver.follow((0.0, 1.0), ((0.45, 0.45), (0.5, 0.5)))
    arm.follow.wait(2)
    assert arm.driver.tally.counts["motions refused"] == 1


def test_stop_cancels_everything_and_holds_where_the_arm_is(arm: Arm) -> None:
    arm.tell(NAMES, (0.4, 0.5))
    arm.driver.state()
    arm.driver.follow((5.0,), ((1.0, 1.0),))
    arm.follow.wait(1)
    arm.driver.stop()
    arm.follow.wait(2)
    assert arm.follow.cancelled[0] == bytes(16)
    (point,) = arm.follow.goals[1].trajectory.points
    assert point.positions.tolist() == [0.4, 0.5]


def test_stop_holds_the_arm_whatever_the_controller_answers(arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    arm.tell(NAMES, (0.3, -0.3))
    assert arm.driver.state() is not None
    served = next(one for one in arm.ros.services if one.topic.name == "/arm/follow/_action/cancel_goal")
    monkeypatch.setattr(served, "answer", lambda request: b"nonsense")
    arm.driver.stop()
    arm.follow.wait(1)
    assert arm.follow.goals[0].trajectory.points[-1].positions.tolist() == [0.3, -0.3]
    assert any("did not answer to a cancel" in text for text in arm.driver.tally.told)


def test_a_stop_that_fails_asks_the_deadman_to_cancel(arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = threading.Event()

    def refuse(id: bytes, timeout: float) -> bool:
        raise RosLinkError("the process in the robot's ROS ended")

    class Asked:
        ended = False

        def cancel(self) -> None:
            asked.set()

        def close(self) -> None:
            pass

    monkeypatch.setattr(arm.driver, "_deadman", Asked())
    monkeypatch.setattr(arm.driver._follow, "cancel", refuse)
    arm.driver.stop()
    assert asked.wait(PATIENCE)


def test_a_goal_that_is_accepted_after_a_stop_is_cancelled(arm: Arm) -> None:
    """The controller takes its time to accept; meanwhile the arm is stopped."""
    asked, go = threading.Event(), threading.Event()

    def hesitate() -> None:
        asked.set()
        go.wait(PATIENCE)

    arm.follow.before_accepting = hesitate
    arm.driver.follow((5.0,), ((1.0, 1.0),))
    assert asked.wait(PATIENCE)
    arm.driver.stop()
    with arm.follow.changed:
        assert arm.follow.changed.wait_for(lambda: bytes(16) in arm.follow.cancelled, PATIENCE)
    go.set()
    with arm.follow.changed:
        assert arm.follow.changed.wait_for(lambda: set(arm.follow._ids) & set(arm.follow.cancelled), PATIENCE)


def test_a_motion_that_the_controller_gives_up_is_told(arm: Arm) -> None:
    arm.driver.follow((1.0,), ((1.0, 1.0),))
    arm.follow.wait(1)
    arm.follow.end(0, 6, error_code=-4, error_string="path tolerance violated")
    assert arm.driver._arm_lane.wait_idle(PATIENCE)
    assert "path tolerance violated" in arm.driver.tally.trouble


def test_a_rejected_goal_and_a_controller_that_is_not_there_leave_the_driver_at_work(arm: Arm) -> None:
    arm.follow.accepts = False
    arm.driver.follow((1.0,), ((1.0, 1.0),))
    assert arm.driver._arm_lane.wait_idle(PATIENCE)
    arm.follow.accepts = True
    arm.driver.follow((1.0,), ((2.0, 2.0),))
    arm.follow.wait(1)
    assert arm.follow.goals[0].trajectory.points[0].positions.tolist() == [2.0, 2.0]


def test_the_gripper_closes_and_tells_whether_it_holds_something(arm: Arm) -> None:
    arm.tell((*NAMES, "finger"), (0.0, 0.0, 0.0))
    assert not arm.driver.state().gripper_contact  # type: ignore[union-attr]
    arm.driver.move_gripper(0.0)
    arm.grip.wait(1)
    assert (arm.grip.goals[0].command.position, arm.grip.goals[0].command.max_effort) == (pytest.approx(0.8), 40.0)
    arm.grip.end(0, 4, stalled=True, reached_goal=False)
    assert arm.driver._grip_lane.wait_idle(PATIENCE)
    arm.tell((*NAMES, "finger"), (0.0, 0.0, 0.5))
    assert arm.driver.state().gripper_contact  # type: ignore[union-attr]
    arm.driver.move_gripper(0.085)
    arm.grip.wait(2)
    assert arm.grip.goals[1].command.position == pytest.approx(0.0)
    arm.tell((*NAMES, "finger"), (0.0, 0.0, 0.0))
    assert not arm.driver.state().gripper_contact  # type: ignore[union-attr]


def test_options_that_fit_no_arm_are_refused(ros: LocalRos) -> None:
    with pytest.raises(ConfigError, match="joints"):
        made(RosArm, joints=())
    with pytest.raises(ConfigError, match="gripper_open"):
        made(RosArm, joints=NAMES, gripper_open=0.0, gripper_closed=0.0)
    with pytest.raises(ConfigError, match="installed_ros"):
        made(RosArm, joints=NAMES, link={"transport": "dds"})
    with pytest.raises(ConfigError, match="transport"):
        made(RosArm, joints=NAMES, link={"transport": "pigeon"})


def test_a_lane_does_the_newest_of_those_that_wait() -> None:
    lane, began, go, done = Lane("test"), threading.Event(), threading.Event(), []

    def first() -> None:
        began.set()
        go.wait(PATIENCE)

    lane.do(first)
    assert began.wait(PATIENCE)
    for i in range(5):
        lane.do(lambda i=i: done.append(i))  # type: ignore[misc]
    assert lane.superseded
    go.set()
    assert lane.wait_idle(PATIENCE) and done == [4]
    lane.close(PATIENCE)


INTRINSICS = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)


def tag_image() -> np.ndarray:
    """A tag of 200 px in the image, seen from straight above but turned by 30 degrees."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    image = np.full((480, 640), 255, np.uint8)
    image[140:340, 220:420] = cv2.aruco.generateImageMarker(dictionary, 7, 200)
    turn = cv2.getRotationMatrix2D((319.5, 239.5), 30.0, 1.0)
    return np.dstack([cv2.warpAffine(image, turn, (640, 480), borderValue=255)] * 3)


def test_tags_found_in_ros_are_where_the_scene_estimator_finds_them(ros: LocalRos) -> None:
    """The AprilTag library's corners begin at another one, and its pixels half a pixel further."""
    source = FrameSource(lambda _: (0.04, 0.04, 0.04), 0.8, NoiseModel())
    color, now = tag_image(), ros.clock.now()
    meta: dict[str, float | int | str] = {"fx": 600.0, "fy": 600.0, "cx": 319.5, "cy": 239.5}
    sightings, outlines = source.read(Frame(now, {"color": color}, meta))
    corners = outlines.corners[0].astype(float) + 0.5
    robot, driver = Robot(ros), made(RosTags, detections="/tags", info="/camera/camera_info")
    point = "apriltag_msgs/msg/Point"
    detection = TYPES.new(
        "apriltag_msgs/msg/AprilTagDetection", family="tag36h11", id=7,
        corners=[TYPES.new(point, x=x, y=y) for x, y in corners[[1, 0, 3, 2]].tolist()],
    )  # fmt: skip
    other = TYPES.new("apriltag_msgs/msg/AprilTagDetection", family="tag25h9", id=7, corners=detection.corners)
    far = TYPES.new("apriltag_msgs/msg/AprilTagDetection", family="tag36h11", id=8)
    far.corners = [TYPES.new(point, x=1e308, y=float(number)) for number in range(4)]
    message = {"header": to_header(TYPES, now, "camera"), "detections": [detection, other, far]}
    robot.send("/tags", "apriltag_msgs/msg/AprilTagDetectionArray", **message)
    assert driver.readings() is None and driver.tally.counts["tags before the first CameraInfo"] == 1
    info = to_camera_info(TYPES, now, "camera", INTRINSICS)
    robot.publisher("/camera/camera_info", info.__msgtype__, Qos()).send(TYPES.encode(info.__msgtype__, info))
    robot.send("/tags", "apriltag_msgs/msg/AprilTagDetectionArray", **message)
    readings = driver.readings()
    assert readings is not None and driver.readings() is None
    (found,) = source.read_corners(readings)
    assert found.marker_id == 7 and found.pose.stamp == pytest.approx(now)
    metres, radians = found.pose.distance(sightings[0].pose)
    assert metres < 1e-5 and radians < 1e-4, "but for the single precision of the outlines"
    robot.link.close()
    driver.close()
    with pytest.raises(WireError, match="without intrinsics"):
        source.read_corners(type(readings)(now, [], None, corners=readings.corners))


def test_a_camera_of_ros_is_a_camera_driver(ros: LocalRos) -> None:
    robot, driver = Robot(ros), made(RosCamera, name="wrist-2", color="/cam/image_rect", info="/cam/camera_info")
    assert driver.frame() is None
    color = np.zeros((480, 640, 3), np.uint8)
    info = to_camera_info(TYPES, ros.clock.now(), "camera", INTRINSICS)
    for name, message in (("/cam/camera_info", info), ("/cam/image_rect", to_image(TYPES, ros.clock.now(), "", color))):
        robot.publisher(name, message.__msgtype__, Qos()).send(TYPES.encode(message.__msgtype__, message))
    frame = driver.frame()
    assert frame is not None and frame.meta["fx"] == 600.0 and frame.arrays["color"].shape == (480, 640, 3)
    assert driver.frame() is None and driver.trouble == ""
    clock = RosCamera.clock
    assert isinstance(clock, ManualClock) and isinstance(driver, Diagnosed)
    clock.advance(SILENCE + 1.0)
    assert driver.frame() is None and "no picture on /cam/image_rect for 4 s" in driver.trouble
    driver.close()


def test_an_arm_in_ros_obeys_an_emergency_stop_although_its_agent_does_nothing(ros: LocalRos) -> None:
    network = LocalNetwork(ManualClock())
    controller = Controller(ros, "/arm", FOLLOW)
    arm = make_driver(
        "agents.ros_bridge:RosArm", network.connect("arm"), Keys("g"), joints=NAMES, trajectory="/arm", states="/js"
    )
    arm.follow((5.0,), ((1.0, 1.0),))
    controller.wait(1)
    somebody = network.connect("somebody")
    send_order(somebody, Keys("g"), HaltOrder("1", True, "anna", "a hand"))
    network.deliver()
    with controller.changed:
        assert controller.changed.wait_for(lambda: controller.cancelled, PATIENCE)
    arm.follow((1.0,), ((0.5, 0.5),))
    assert arm.tally.told[-1] == "a motion was refused: halted by anna: a hand"
    assert len(controller.goals) == 1
    send_order(somebody, Keys("g"), HaltOrder("2", False, "anna"))
    network.deliver()
    arm.follow((1.0,), ((0.5, 0.5),))
    controller.wait(2)
    arm.close()
