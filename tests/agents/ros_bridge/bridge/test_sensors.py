"""Cameras, clouds, joints and detections into the memory, and the memory's own out of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from agents.ros_bridge.link.link import Qos
from agents.ros_bridge.mapping.cameras import to_camera_info
from agents.ros_bridge.mapping.clouds import to_cloud
from agents.ros_bridge.mapping.detections import Believed, to_detections
from agents.ros_bridge.mapping.images import pixels, to_image
from agents.ros_bridge.mapping.joints import to_joint_state
from agents.ros_bridge.mapping.stamps import to_seconds
from dsr import Frame, Pose
from dsr.errors import ConfigError
from dsr.vocabulary.distortion import Distortion
from dsr.vocabulary.intrinsics import Intrinsics, read_intrinsics
from tests.agents.ros_bridge.robot import TYPES, Bridged, Robot, bridged

IMAGE, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
JOINTS, CLOUD = "sensor_msgs/msg/JointState", "sensor_msgs/msg/PointCloud2"
DETECTIONS = "vision_msgs/msg/Detection3DArray"
COLOR = np.random.default_rng(3).integers(0, 256, (4, 6, 3), dtype=np.uint8)
DEPTH = np.full((4, 6), 1.25, np.float32)
LENS = Distortion("plumb_bob", (0.1, 0.0, 0.0, 0.0, 0.0))
INTRINSICS = Intrinsics(500.0, 505.0, 2.5, 1.5, 6, 4, LENS)
CAMERA = {"receive": {"cameras": {"eye": {"color": "/cam/color/image_raw", "depth": "/cam/depth/image"}}}}


def publish(robot: Robot, name: str, type: str, message: Any) -> None:
    robot.publisher(name, type, Qos()).send(TYPES.encode(type, message))


def look(system: Bridged, *, depth: bool = True, stamp: float | None = None) -> None:
    """One exposure of the robot's camera."""
    stamp = system.now if stamp is None else stamp
    publish(system.robot, "/cam/color/image_raw", IMAGE, to_image(TYPES, stamp, "eye_optical", COLOR))
    if depth:
        publish(system.robot, "/cam/depth/image", IMAGE, to_image(TYPES, stamp + 0.004, "eye_optical", DEPTH))


def tell_intrinsics(system: Bridged, intrinsics: Intrinsics = INTRINSICS) -> None:
    message = to_camera_info(TYPES, system.now, "eye_optical", intrinsics)
    publish(system.robot, "/cam/color/camera_info", INFO, message)


def test_a_camera_of_ros_is_a_camera_of_the_memory() -> None:
    with bridged(CAMERA) as system:
        frames = system.memory.frames("eye")
        tell_intrinsics(system)
        began = system.now
        look(system)
        system.run()
        frame = frames.latest()
        assert frame is not None and frame.stamp == pytest.approx(began)
        np.testing.assert_array_equal(frame.arrays["color"], COLOR)
        np.testing.assert_array_equal(frame.arrays["depth"], DEPTH)
        assert Intrinsics.from_meta(frame.meta, COLOR.shape) == INTRINSICS
        node = system.memory.node("eye")
        assert node.type == "camera" and read_intrinsics(node) == INTRINSICS
        system.robot.tf(("world", "eye_optical", system.now, Pose((0.0, 0.0, 1.0))))
        system.run()
        assert system.memory.transform("world", "eye").t == (0.0, 0.0, 1.0)
        assert system.trouble == ""


def test_colour_waits_for_its_depth_and_goes_on_alone_if_there_is_none() -> None:
    with bridged(CAMERA) as system:
        frames = system.memory.frames("eye")
        tell_intrinsics(system)
        look(system, depth=False)
        system.run()
        assert frames.latest() is None
        for _ in range(15):
            look(system, depth=False)
            system.run(0.1)
        frame = frames.latest()
        assert frame is not None and frame.arrays.keys() == {"color"}
        look(system)
        system.run()
        frame = frames.latest()
        assert frame is not None and frame.arrays.keys() == {"color", "depth"}


def test_depth_of_other_moments_is_told_and_colour_goes_on_alone() -> None:
    """Two clocks, or a driver that does not synchronise: no frame at all came, and nobody was told."""
    with bridged(CAMERA) as system:
        frames = system.memory.frames("eye")
        tell_intrinsics(system)
        for _ in range(15):
            look(system, depth=False)
            late = to_image(TYPES, system.now + 0.05, "eye_optical", DEPTH)
            publish(system.robot, "/cam/depth/image", IMAGE, late)
            system.run(0.1)
        frame = frames.latest()
        assert frame is not None and frame.arrays.keys() == {"color"}
        assert "stamped 50 ms apart, more than 33: they are of different moments" in system.trouble
        assert system.counts["colour without depth on /cam/color/image_raw"] > 0


def test_depth_of_a_camera_beside_is_shown_in_the_image_of_colour() -> None:
    """The depth camera has half the focal length, and sees a wall that is 0.25 m nearer to it."""
    beside = Intrinsics(250.0, 250.0, 5.5, 4.5, 12, 10)
    topics = {
        "color": "/cam/color/image_raw", "depth": "/cam/depth/image", "depth_info": "/cam/depth/camera_info",
        "depth_pose": {"translation": [0.0, 0.0, 0.25]},
    }  # fmt: skip
    with bridged({"receive": {"cameras": {"eye": topics}}}) as system:
        frames = system.memory.frames("eye")

        def show(size: tuple[int, int]) -> Frame:
            wall = to_image(TYPES, system.now + 0.004, "eye_depth", np.full(size, 1.0, np.float32))
            look(system, depth=False)
            publish(system.robot, "/cam/depth/image", IMAGE, wall)
            system.run()
            frame = frames.latest()
            assert frame is not None
            return frame

        tell_intrinsics(system)
        assert show((10, 12)).arrays.keys() == {"color"}
        assert system.counts["depth before /cam/depth/camera_info"] == 1
        message = to_camera_info(TYPES, system.now, "eye_depth", beside)
        publish(system.robot, "/cam/depth/camera_info", INFO, message)
        np.testing.assert_array_equal(show((10, 12)).arrays["depth"], DEPTH)
        assert show((4, 6)).arrays.keys() == {"color"}
        assert "/cam/depth/camera_info is not about /cam/depth/image" in system.trouble


@pytest.mark.parametrize(
    "topics",
    [
        {"color": "/c", "depth": "/d", "depth_info": "/i"},
        {"color": "/c", "depth": "/d", "depth_pose": {}},
        {"depth": "/d", "depth_info": "/i", "depth_pose": {}},
    ],
)
def test_depth_that_is_not_aligned_needs_its_intrinsics_and_its_pose(topics: dict[str, Any]) -> None:
    with (
        pytest.raises(ConfigError, match="`depth_info` and `depth_pose` go together"),
        bridged({"receive": {"cameras": {"eye": topics}}}),
    ):
        pass


def test_images_without_intrinsics_or_with_those_of_another_size_have_none() -> None:
    with bridged(CAMERA) as system:
        frames = system.memory.frames("eye")
        look(system)
        system.run()
        assert frames.latest().meta == {}  # type: ignore[union-attr]
        assert system.counts["images before /cam/color/camera_info"] == 1
        tell_intrinsics(system, Intrinsics(500.0, 505.0, 2.5, 1.5, 640, 480))
        look(system)
        system.run()
        assert frames.latest().meta == {}  # type: ignore[union-attr]
        assert "is about images of 640 x 480 px, not 6 x 4" in system.trouble


def test_of_a_flood_of_images_the_newest_is_taken_and_a_malformed_one_told() -> None:
    with bridged(CAMERA) as system:
        frames = system.memory.frames("eye")
        for i in range(50):
            look(system, stamp=system.now + 0.001 * i)
        system.run()
        assert frames.latest().stamp == pytest.approx(system.now - 0.05 + 0.049)  # type: ignore[union-attr]
        assert system.counts["passed over on /cam/color/image_raw"] == 46
        broken = to_image(TYPES, system.now + 1e-3, "eye_optical", COLOR)
        broken.height = 4000
        publish(system.robot, "/cam/color/image_raw", IMAGE, broken)
        publish(system.robot, "/cam/depth/image", IMAGE, to_image(TYPES, system.now + 1e-3, "", DEPTH))
        system.robot.publisher("/cam/color/image_raw", IMAGE, Qos()).send(b"\0\x01\0\0\xff")
        system.run()
        assert system.counts["malformed"] == 2


def test_a_cloud_comes_into_the_stream_of_its_node() -> None:
    points = np.random.default_rng(1).normal(size=(10, 3)).astype(np.float32)
    with bridged({"receive": {"clouds": {"lidar": "/points"}}}) as system:
        frames = system.memory.frames("lidar")
        cloud = to_cloud(TYPES, system.now, "lidar_link", points, COLOR.reshape(-1, 3)[:10])
        publish(system.robot, "/points", CLOUD, cloud)
        system.run()
        frame = frames.latest()
        assert frame is not None
        np.testing.assert_array_equal(frame.arrays["points"], points)
        np.testing.assert_array_equal(frame.arrays["colors"], COLOR.reshape(-1, 3)[:10])
        assert system.memory.edge("lidar_link", "lidar", "RT")["pose"].stamp == 0.0


def test_joints_of_several_publishers_come_to_one_node() -> None:
    with bridged() as system:
        for i in range(3):
            for message in (
                to_joint_state(TYPES, system.now, ["a", "b"], [0.1 * i, 2.0]),
                to_joint_state(TYPES, system.now, ["grip"], [0.5], [0.25]),
            ):
                publish(system.robot, "/joint_states", JOINTS, message)
            system.run()
        node = system.memory.node("robot")
        assert node["joint_names"] == "a,b,grip"
        assert node["joint_positions"] == (0.2, 2.0, 0.5)
        assert node["joint_velocities"] == pytest.approx((2.0, 0.0, 0.25), rel=1e-4), "what is not told is measured"
        for wrong in (
            TYPES.new(JOINTS, name=["a"]),
            TYPES.new(JOINTS, name=["a", "a"], position=[1.0, 2.0]),
            TYPES.new(JOINTS, name=["a"], position=[float("inf")]),
            TYPES.new(JOINTS, name=[f"j{i}" for i in range(600)], position=[0.0] * 600),
        ):
            publish(system.robot, "/joint_states", JOINTS, wrong)
        system.run()
        assert system.counts["malformed"] == 4
        assert node["joint_names"] == "a,b,grip"


def test_joints_of_the_memory_go_out_and_those_of_ros_do_not_come_back() -> None:
    with bridged() as system:
        system.robot.listen("/dsr/joint_states", JOINTS)
        publish(system.robot, "/joint_states", JOINTS, to_joint_state(TYPES, system.now, ["a"], [0.1]))
        system.run()
        assert system.robot.heard["/dsr/joint_states"] == []
        system.memory.add_node(
            "arm", "arm", joint_names="j1,j2", joint_positions=(0.1, 0.2), joint_velocities=(0.0, 1.0)
        )
        system.run()
        (message,) = system.robot.heard["/dsr/joint_states"]
        assert message.name == ["j1", "j2"]
        assert (message.position.tolist(), message.velocity.tolist()) == ([0.1, 0.2], [0.0, 1.0])
        assert to_seconds(message.header.stamp) == pytest.approx(system.now, abs=0.1)


DETECTOR = {"receive": {"detections": {"/found": {"types": {"mug": "cup"}}}}}


def test_detections_are_percepts_with_covariance() -> None:
    pose = Pose((0.1, 0.2, 0.9), (0.0, 0.0, 0.6, 0.8), covariance=np.diag([1e-4, 2e-4, 3e-4, 1e-3, 2e-3, 3e-3]))
    with bridged(DETECTOR) as system:
        seen = [Believed("mug_1", "mug", pose, (0.08, 0.08, 0.1), 0.9), Believed("ghost", "mug", pose, None, 0.2)]
        publish(system.robot, "/found", DETECTIONS, to_detections(TYPES, system.now, "eye", seen))
        system.run()
        node = system.memory.node("mug_1")
        assert (node.type, node["perceived"], node["size"]) == ("cup", True, (0.08, 0.08, 0.1))
        found = system.memory.edge("eye", "mug_1", "RT")["pose"]
        assert found.distance(pose) == pytest.approx((0.0, 0.0), abs=1e-9)
        np.testing.assert_allclose(found.covariance, pose.covariance, atol=1e-12)
        assert "ghost" not in system.memory
        system.run(1.0)
        assert system.memory.node("mug_1")["perceived"] is False


def test_a_detection_of_a_node_that_is_no_thing_is_told() -> None:
    with bridged(DETECTOR) as system:
        system.memory.add_node("table", "table")
        seen = [Believed("table", "table", Pose(), None, 0.9)]
        publish(system.robot, "/found", DETECTIONS, to_detections(TYPES, system.now, "eye", seen))
        system.run()
        assert "'table' is a node of type 'table'" in system.trouble


def test_frames_of_the_memorys_cameras_go_out_while_somebody_listens() -> None:
    with bridged(CAMERA) as system:
        node = "camera.top"
        system.memory.add_node(node, "camera", stream=node, fx=500.0, fy=505.0, cx=2.5, cy=1.5, width=6, height=4)
        system.run()
        system.memory.put_frame(node, Frame(system.now, {"color": COLOR, "depth": DEPTH}, {}))
        system.run()
        assert "to /dsr/camera_top/image_raw" not in system.counts
        for topic, type in (("image_raw", IMAGE), ("depth", IMAGE), ("camera_info", INFO)):
            system.robot.listen(f"/dsr/camera_top/{topic}", type)
        system.run(0.6)
        system.memory.put_frame(node, Frame(system.now, {"color": COLOR, "depth": DEPTH}, {}))
        began = system.now
        system.run()
        heard = system.robot.heard
        (color,), (depth,), (info,) = (heard[f"/dsr/camera_top/{t}"] for t in ("image_raw", "depth", "camera_info"))
        np.testing.assert_array_equal(pixels(color), COLOR)
        np.testing.assert_array_equal(pixels(depth), DEPTH)
        assert to_seconds(color.header.stamp) == pytest.approx(began) and color.header.frame_id == "camera/top"
        assert info.k[0] == 500.0
        assert not any("/dsr/eye" in publisher.topic.name for publisher in system.ros.publishers)
        system.memory.remove_node(node)
        system.run()
        assert not any("/dsr/camera_top" in publisher.topic.name for publisher in system.ros.publishers)


def test_a_camera_sends_the_stream_that_it_names_and_else_that_of_its_own_name() -> None:
    with bridged() as system:
        system.memory.add_node("eye", "camera", stream="camera_eye")
        system.memory.add_node("other", "camera")
        for name in ("eye", "other"):
            system.robot.listen(f"/dsr/{name}/image_raw", IMAGE)
        system.run(1.0)

        def heard(*streams: str) -> list[int]:
            for stream in streams:
                system.memory.put_frame(stream, Frame(system.now, {"color": COLOR}, {}))
            system.run(0.2)
            return [len(system.robot.heard[f"/dsr/{name}/image_raw"]) for name in ("eye", "other")]

        assert heard("camera_eye", "other") == [1, 1]
        system.memory.update_node("eye", stream="other")
        system.run(0.2)
        assert heard("camera_eye", "other") == [2, 2]
