"""Nodes of ROS that are broken or mean harm: what they tell neither fills the memory, nor stops what others tell."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from agents.ros_bridge.bridge.frame_nodes import MOST_FRAMES
from agents.ros_bridge.mapping.cameras import to_camera_info
from agents.ros_bridge.mapping.detections import Believed, to_detections
from agents.ros_bridge.mapping.images import to_image
from agents.ros_bridge.messages.transforms import StampedTransform, encode_transforms
from dsr import Pose
from dsr.vocabulary.intrinsics import Intrinsics, read_intrinsics
from tests.agents.ros_bridge.bridge.test_sensors import (
    CAMERA,
    COLOR,
    DEPTH,
    DETECTIONS,
    DETECTOR,
    IMAGE,
    INFO,
    INTRINSICS,
    JOINTS,
    look,
    publish,
)
from tests.agents.ros_bridge.robot import TYPES, bridged

A = Pose((1.0, 2.0, 3.0))
COLOR_ONLY = {"receive": {"cameras": {"eye": {"color": "/eye/image"}}}}


def joints(names: list[str], positions: list[float], velocities: list[float] | None = None) -> Any:
    return TYPES.new(JOINTS, name=names, position=positions, velocity=velocities or [])


def test_a_frame_that_changes_its_parent_again_and_again_makes_few_nodes() -> None:
    with bridged() as system:
        for turn in range(12):
            system.robot.tf(*((f"parent_{turn}_{i}", f"child_{i}", system.now, A) for i in range(400)))
            system.run(0.1)
        assert len(system.memory.nodes("body")) == MOST_FRAMES
        assert "more than 4000 frames" in system.trouble


def test_detectors_that_make_up_frames_make_few_nodes() -> None:
    with bridged(DETECTOR) as system:
        seen = [Believed("mug_1", "mug", A, None, 0.9)]
        for turn in range(5):
            message = to_detections(TYPES, system.now, "eye", seen * 1000)
            for i, detection in enumerate(message.detections):
                detection.header = TYPES.new("std_msgs/msg/Header", frame_id=f"frame_{turn}_{i}")
            publish(system.robot, "/found", DETECTIONS, message)
            system.run()
        assert len(system.memory.nodes("body")) == MOST_FRAMES


def test_a_camera_whose_images_name_other_frames_hangs_from_the_newest_one() -> None:
    with bridged(COLOR_ONLY) as system:
        for number in range(5):
            publish(system.robot, "/eye/image", IMAGE, to_image(TYPES, system.now, f"frame_{number}", COLOR))
            system.run()
        assert [edge.src for edge in system.memory.edges("RT", dst="eye")] == ["frame_4"]


def test_what_is_nowhere_in_space_is_no_frame() -> None:
    with bridged() as system:
        for name, type in (("mind", "mind"), ("intention_1", "intention"), ("event_1", "event")):
            system.memory.add_node(name, type)
        system.run()
        system.robot.tf(
            ("world", "mind", system.now, A), ("event_1", "base", system.now, A), ("world", "good", system.now, A)
        )
        system.run()
        assert [(edge.src, edge.dst) for edge in system.memory.edges("RT")] == [("world", "good")]
        assert system.counts["not written"] == 2 and "nowhere in space" in system.trouble


@pytest.mark.parametrize("far", [1e10, 1e307])
def test_what_is_farther_than_anything_is_dropped(far: float) -> None:
    """Products of such numbers would be none, in each agent that asks where something is."""
    with bridged(DETECTOR) as system:
        pose = Pose((0.0, far, 0.0))
        system.robot.tf(("world", "near", system.now, A), ("world", "far", system.now, pose))
        turned = StampedTransform(1, 0, "world", "far_too", (0.0, 0.0, far, 0.0, 0.0, 0.0, 0.9999))
        system.robot.tf_cdr(encode_transforms([turned]))
        seen = [Believed("far_mug", "mug", pose, None, 0.9), Believed("mug", "mug", A, None, 0.9)]
        publish(system.robot, "/found", DETECTIONS, to_detections(TYPES, system.now, "near", seen))
        system.run()
        assert [node.name for node in system.memory.nodes() if "far" in node.name] == []
        assert "near" in system.memory and "mug" in system.memory
        assert system.counts["malformed"] == 3


def test_a_detection_that_is_none_costs_only_itself() -> None:
    with bridged(DETECTOR) as system:
        seen = [Believed(name, "mug", A, None, 0.9) for name in ("nan", "unsure", "good")]
        message = to_detections(TYPES, system.now, "eye", seen)
        message.detections[0].results[0].pose.pose.position.x = float("nan")
        message.detections[1].results[0].hypothesis.score = float("nan")
        publish(system.robot, "/found", DETECTIONS, message)
        system.run()
        assert "good" in system.memory and "nan" not in system.memory and "unsure" not in system.memory
        assert (system.counts["malformed"], system.counts["detections with a low score"]) == (1, 1)


def test_joints_without_a_position_cost_only_themselves() -> None:
    """ros2_control tells `nan` for the position of wheels that have none."""
    nan = float("nan")
    with bridged() as system:
        message = joints(["wheel", "elbow", "wrist"], [nan, 0.5, 0.6], [3.0, 0.1, nan])
        publish(system.robot, "/joint_states", JOINTS, message)
        system.run()
        node = system.memory.node("robot")
        assert (node["joint_names"], node["joint_positions"]) == ("elbow,wrist", (0.5, 0.6))
        assert node["joint_velocities"] == (0.1, 0.0)
        assert system.counts["positions of joints that are not known"] == 1 and system.trouble == ""


def test_a_name_that_no_joint_has_does_not_stop_the_others() -> None:
    with bridged() as system:
        publish(system.robot, "/joint_states", JOINTS, joints(["x" * 2_000_000], [1.0]))
        publish(system.robot, "/joint_states", JOINTS, joints(["elbow"], [0.5]))
        system.run()
        assert system.memory.node("robot")["joint_names"] == "elbow"
        assert system.counts["malformed"] == 1 and "not written" not in system.counts


def test_a_lens_that_is_none_costs_only_itself() -> None:
    with bridged(CAMERA) as system:
        message = to_camera_info(TYPES, system.now, "eye_optical", INTRINSICS)
        message.d = np.full(100, 0.5)
        publish(system.robot, "/cam/color/camera_info", INFO, message)
        look(system)
        system.run()
        node = system.memory.node("eye")
        assert read_intrinsics(node) == replace(INTRINSICS, distortion=None)
        assert "the distortion on /cam/color/camera_info was left out" in system.trouble


def test_long_names_are_told_in_few_words() -> None:
    with bridged(DETECTOR) as system:
        seen = [Believed("x" * 1_000_000, "mug", A, None, 0.9)]
        publish(system.robot, "/found", DETECTIONS, to_detections(TYPES, system.now, "eye", seen))
        system.run()
        assert system.trouble.startswith("detection 'xxx") and "xxx... (1000" in system.trouble
        assert len(system.trouble) < 600
        assert max(map(len, system.lockstep.runner("ros_bridge").agent.told)) < 600
        system.robot.tf(("world", "/" * 100_000 + "base", system.now, A), ("world", "//base", system.now, A))
        system.run()
        assert system.counts["malformed"] == 1 and "base" in system.memory


def test_a_name_with_half_a_character_stops_no_other_frame() -> None:
    """A node of the memory whose name stands for a character that no text in ROS can have."""
    with bridged() as system:
        found = system.robot.listen_tf()
        for name in ("world", "a-d800-b", "table"):
            system.memory.add_node(name, "world" if name == "world" else "body")
        for name in ("a-d800-b", "table"):
            system.memory.add_edge("world", name, "RT", pose=A)
        system.run()
        assert {one.child for one in found} == {"a-d800-b", "table"}


def test_intrinsics_that_would_fill_all_memory_cost_only_depth() -> None:
    """A few hundred bytes: the colour is said to be 10^10 pixels large, or a pixel of depth to cover most of it."""
    topics = {"color": "/c/image", "depth": "/d/image", "depth_info": "/d/camera_info", "depth_pose": {}}
    for seen, measured in (
        (Intrinsics(1e5, 1e5, 2.5, 1.5, 6, 4), Intrinsics(1.0, 1.0, 2.5, 1.5, 6, 4)),
        (Intrinsics(500.0, 500.0, 2.5, 1.5, 100_000, 100_000), INTRINSICS),
        (INTRINSICS, Intrinsics(500.0, 500.0, 2.5, 1.5, 100_000, 100_000)),
    ):
        with bridged({"receive": {"cameras": {"eye": topics}}}) as system:
            frames = system.memory.frames("eye")
            for name, intrinsics in (("/c/camera_info", seen), ("/d/camera_info", measured)):
                publish(system.robot, name, INFO, to_camera_info(TYPES, system.now, "eye_optical", intrinsics))
            publish(system.robot, "/c/image", IMAGE, to_image(TYPES, system.now, "eye_optical", COLOR))
            publish(system.robot, "/d/image", IMAGE, to_image(TYPES, system.now, "eye_optical", DEPTH))
            system.run(0.3)
            frame = frames.latest()
            assert frame is not None and frame.arrays.keys() == {"color"}
            told = system.lockstep.runner("ros_bridge").agent.told
            assert any("/d/camera_info is not about /d/image" in text for text in told)
