"""A system whose arm and camera are nodes of ROS in another process, behind drivers: no bridge, no simulation."""

from __future__ import annotations

import math
import secrets
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from agents.ros_bridge.mapping.apriltags import APRILTAGS
from agents.ros_bridge.mapping.images import read_color
from agents.ros_bridge.mapping.stamps import to_header
from agents.ros_bridge.services.deadman import FOLLOW
from agents.scene_estimator.detection import TagDetector
from dsr import Pose, connect
from dsr.memory import Memory
from tests.agents.ros_bridge.conftest import Router
from tests.agents.ros_bridge.live import READY, Run
from tests.agents.ros_bridge.samples import TYPES
from tests.agents.ros_bridge.sdk_types import advertise, serve_action
from tests.agents.ros_bridge.simulated import COLOR, DEPTH, INFO, JOINTS, OPTICAL, Simulated, nested, play, simulate
from tests.agents.ros_bridge.told import Told, eventually

TRAJECTORY = "/joint_trajectory_controller/follow_joint_trajectory"
TAGS = "/detections"
NEAR, NEAR_BY_CORNERS = 0.01, 0.04
"""m between a cube and where it is seen, with depth and without: its tag is some 20 px wide"""
SYSTEM = """graph = "{graph}"
[[agent]]
name = "arm_controller"
class = "agents.arm_controller:ArmController"
[agent.config]
driver = "agents.ros_bridge:RosArm"
stale = 0.5
[agent.config.options]
deadman = 1.0
joints = {joints}
trajectory = "{trajectory}"
link = {{ router = "{router}" }}
[agent.config.cameras.camera]
driver = "agents.ros_bridge:RosCamera"
mount = {{ translation = {translation}, rotation = {rotation} }}
options = {{ color = "{color}", depth = "{depth}", link = {{ router = "{router}" }} }}

[[agent]]
name = "scene_estimator"
class = "agents.scene_estimator:SceneEstimator"
[agent.config]
cameras = ["camera"]
"""
DETECTOR = """graph = "{graph}"
[[agent]]
name = "scene_estimator"
class = "agents.scene_estimator:SceneEstimator"
[agent.config]
cameras = []
[agent.config.tag_sensors.camera]
driver = "agents.ros_bridge:RosTags"
options = {{ detections = "{tags}", info = "{info}", link = {{ router = "{router}" }} }}
"""
pytestmark = pytest.mark.timeout(400)  # a whole system on a busy machine


class Live:
    """The robot, the system and a replica of its graph."""

    def __init__(self, robot: Simulated, sdk: Told, run: Run, memory: Memory) -> None:
        self.robot, self.sdk, self.run, self.memory = robot, sdk, run, memory


def camera_pose(robot: Simulated) -> Pose:
    """world_from_camera, as the robot tells it on tf."""
    (found,) = (one for one in robot.messages["/tf"].transforms if one.child_frame_id == OPTICAL)
    t, q = found.transform.translation, found.transform.rotation
    return Pose((t.x, t.y, t.z), (q.x, q.y, q.z, q.w))


@contextmanager
def started(folder: Path, system: str) -> Iterator[Live]:
    """A robot, and a system beside it once it is ready; `system` is formatted with what belongs to the robot."""
    runtime = folder / "runtime"
    runtime.mkdir(mode=0o700)
    robot, router, graph = simulate(), Router(), f"ros_{secrets.token_hex(4)}"
    camera, file = camera_pose(robot), folder / "drivers.toml"
    text = system.format(
        graph=graph, router=router.endpoint, joints=list(robot.messages[JOINTS].name), trajectory=TRAJECTORY,
        color=COLOR, depth=DEPTH, info=INFO, tags=TAGS, translation=list(camera.t), rotation=list(camera.q),
    )  # fmt: skip
    file.write_text(text.replace("'", '"'))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(runtime))
        for name in ("DSR_SECURITY", "DSR_GRAPH", "ROS_DOMAIN_ID", "ROS_DISTRO"):
            patch.delenv(name, raising=False)
        sdk = Told([sys.executable, str(Path(__file__).with_name("sdk_node.py")), str(router.port)])
        run = Run(["run", str(file), "--folder", str(folder / "run")], folder)
        try:
            play(sdk, robot, folder)
            run.wait_for(READY)
            with connect(graph, agent="observer") as memory:
                yield Live(robot, sdk, run, memory)
            assert run.interrupt() == 0 and run.processes() == [], run.said
        finally:
            run.kill()
            sdk.close()
            router.stop()


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    with started(tmp_path_factory.mktemp("live_drivers"), SYSTEM) as found:
        serve_action(found.sdk, TRAJECTORY, FOLLOW)
        found.sdk.move(name=TRAJECTORY, joints=JOINTS)
        yield found


def test_the_arm_is_where_its_joints_in_ros_say(live: Live) -> None:
    expected = list(live.robot.messages[JOINTS].position)
    eventually(lambda: live.memory.get_node("arm") and "joint_positions" in live.memory.node("arm"))
    assert list(live.memory.node("arm")["joint_positions"]) == pytest.approx(expected, abs=1e-6)
    tool = live.memory.transform("world", "gripper")
    assert tool.distance(live.robot.links["end_effector_link"]) == pytest.approx((0.0, 0.0), abs=1e-6)


def test_what_the_camera_in_ros_sees_is_perceived(live: Live) -> None:
    for name, pose in live.robot.objects.items():

        def is_near(name: str = name, pose: Pose = pose) -> bool:
            found = live.memory.get_transform("world", name, types=("RT",))
            return found is not None and bool(found.distance(pose)[0] < NEAR)

        eventually(is_near, 60.0)
        assert live.memory.node(name)["perceived"] is True


def test_a_target_in_the_memory_moves_the_arm_in_ros(live: Live) -> None:
    eventually(lambda: live.memory.get_node("arm") and "joint_positions" in live.memory.node("arm"))
    target = list(live.memory.node("arm")["joint_positions"])
    target[6] = math.remainder(target[6] + 0.4, 2.0 * math.pi)
    live.memory.update_node("arm", target_joints=tuple(target))
    eventually(lambda: live.memory.node("arm").get("status") == "reached", 60.0)
    # the result and the joints are told on two topics of ROS, in no order
    eventually(lambda: list(live.memory.node("arm")["joint_positions"]) == pytest.approx(target, abs=0.003), 5.0)
    (goal,) = live.sdk.asked(name=TRAJECTORY)["goals"]
    assert goal["trajectory"]["joint_names"] == list(live.robot.messages[JOINTS].name)
    assert goal["trajectory"]["points"][-1]["positions"] == pytest.approx(target)


def test_tags_that_a_detector_in_ros_finds_are_percepts(tmp_path: Path) -> None:
    """It tells corners as the AprilTag library has them: others first, and half a pixel further."""
    with started(tmp_path, DETECTOR) as live:
        found = TagDetector().detect(read_color(live.robot.messages[COLOR]))
        point = "apriltag_msgs/msg/Point"
        detections = [
            TYPES.new(
                "apriltag_msgs/msg/AprilTagDetection", family="tag36h11", id=tag.marker_id,
                corners=[TYPES.new(point, x=x + 0.5, y=y + 0.5) for x, y in tag.corners[[1, 0, 3, 2]].tolist()],
            )
            for tag in found
        ]  # fmt: skip
        message = TYPES.new(APRILTAGS, header=to_header(TYPES, 0.0, OPTICAL), detections=detections)
        advertise(live.sdk, TAGS, APRILTAGS)
        live.sdk.repeat(messages={TAGS: nested(message, tmp_path)}, hz=10.0)
        live.memory.add_node("world", "world")
        live.memory.add_node("camera", "camera")
        live.memory.add_edge("world", "camera", "RT", pose=camera_pose(live.robot))
        for name, pose in live.robot.objects.items():

            def is_near(name: str = name, pose: Pose = pose) -> bool:
                seen = live.memory.get_transform("world", name, types=("RT",))
                return seen is not None and bool(seen.distance(pose)[0] < NEAR_BY_CORNERS)

            eventually(is_near, 60.0)
