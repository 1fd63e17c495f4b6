"""A robot that is simulated once and then played by a node of ROS: frames, joints and a camera, stamped with now."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from agents.arm_controller.model.urdf import load_robot
from agents.plant.arm import SimulatedArm
from agents.plant.config import PlantConfig
from agents.plant.reality import Reality
from agents.ros_bridge.mapping.cameras import CAMERA_INFO, to_camera_info
from agents.ros_bridge.mapping.images import IMAGE, to_image
from agents.ros_bridge.mapping.joints import JOINT_STATE, to_joint_state
from agents.ros_bridge.mapping.transforms import to_stamped
from agents.ros_bridge.messages.transforms import TF_MESSAGE, encode_transforms
from agents.scenario.format.model import SensorSpec
from agents.scenario.format.scenario import load_scenario
from dsr import Pose
from dsr.files.built_in import ETC
from dsr.vocabulary.intrinsics import Intrinsics
from tests.agents.ros_bridge.samples import TYPES
from tests.agents.ros_bridge.sdk_types import advertise
from tests.agents.ros_bridge.told import Told

COLOR, DEPTH = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw"
INFO, JOINTS = "/camera/color/camera_info", "/joint_states"
OPTICAL = "camera_color_optical_frame"
TYPE = {"/tf": TF_MESSAGE, COLOR: IMAGE, DEPTH: IMAGE, INFO: CAMERA_INFO, JOINTS: JOINT_STATE}
TOGETHER: dict[tuple[str, ...], float] = {("/tf",): 20.0, (JOINTS,): 20.0, (INFO, COLOR, DEPTH): 5.0}
"""How often (Hz) what has one stamp is said"""
WORLD = "map"


class Simulated(msgspec.Struct, frozen=True):
    """What the robot says, and what is true."""

    messages: dict[str, Any]
    """One message by topic"""
    objects: dict[str, Pose]
    """world_from_object"""
    links: dict[str, Pose]
    """world_from_link"""


def simulate(scenario: str = "hovering", seed: int = 0) -> Simulated:
    """A Gen3 at a table with tagged cubes, below a camera without errors: how they are at first."""
    config = PlantConfig(scenario=scenario, renderer="tiny")
    exact = msgspec.structs.replace(load_scenario(scenario), sensor=SensorSpec())
    reality = Reality(exact, config, seed)
    try:
        frame, arm, camera = reality.frame(0.0), reality.arm, reality.camera
        assert isinstance(arm, SimulatedArm)
        robot = load_robot(ETC / "robots" / "gen3.urdf")
        links = {joint.child: arm.link_pose(joint.child) for joint in robot.between("base_link", "tool_link")}
        moving = [joint.name for joint in robot.between("base_link", "tool_link") if joint.moves]
        frames = [to_stamped(WORLD, "base_link", 0.0, Pose.identity())]
        parent, before = "base_link", Pose.identity()
        for name, pose in links.items():
            frames.append(to_stamped(parent, name, 0.0, before.inverse() @ pose))
            parent, before = name, pose
        frames.append(to_stamped(WORLD, OPTICAL, 0.0, camera.pose))
        intrinsics = Intrinsics.from_fov(config.width, config.height, config.fov)
        depth = (np.nan_to_num(frame.arrays["depth"]) * 1000.0).astype(np.uint16)
        messages = {
            "/tf": TYPES.decode(TF_MESSAGE, encode_transforms(frames)),
            COLOR: to_image(TYPES, 0.0, OPTICAL, frame.arrays["color"]),
            DEPTH: to_image(TYPES, 0.0, OPTICAL, depth),
            INFO: to_camera_info(TYPES, 0.0, OPTICAL, intrinsics),
            JOINTS: to_joint_state(TYPES, 0.0, moving, arm.positions),
        }
        return Simulated(messages, reality.world.poses(), links)
    finally:
        reality.close()


def nested(message: Any, folder: Path, name: str = "message") -> Any:
    """A message as JSON holds it; large arrays become files of their bytes in `folder`."""
    if isinstance(message, np.ndarray):
        if message.size < 1000:
            return message.tolist()
        message.tofile(file := folder / f"{name}.bytes")
        return {"file": str(file)}
    if isinstance(message, list):
        return [nested(item, folder, name) for item in message]
    if not hasattr(message, "__msgtype__"):
        return message
    fields = [field for field, _ in TYPES.fields(message.__msgtype__)]
    return {field: nested(getattr(message, field), folder, f"{name}.{field}") for field in fields}


def play(sdk: Told, robot: Simulated, folder: Path) -> None:
    """Let a node of the SDK say it again and again; `folder` is for large messages on their way to it."""
    for topic in robot.messages:
        advertise(sdk, topic, TYPE[topic])
    for topics, hz in TOGETHER.items():
        messages = {topic: nested(robot.messages[topic], folder, topic.replace("/", "_")) for topic in topics}
        sdk.repeat(messages=messages, hz=hz)
