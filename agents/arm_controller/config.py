"""Configuration of an arm and its cameras."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from agents.arm_controller.model.arm_model import ArmModel, load_arm
from agents.arm_controller.safety.separation import Separation
from agents.arm_controller.safety.zones import Zone
from agents.xacro_file import Value
from dsr.errors import ConfigError
from dsr.math3d.transforms import Pose
from dsr.vocabulary.arms import gripper_of


class Mount(msgspec.Struct, frozen=True):
    """The pose of something that is fixed in its parent's frame."""

    translation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position of the mounted thing in its parent's frame, m."""
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    """Quaternion (x, y, z, w)"""

    def pose(self) -> Pose:
        """parent_from_child. Raises `ConfigError` for a rotation that is none."""
        try:
            return Pose(self.translation, self.rotation)
        except ValueError as error:
            raise ConfigError(f"mount: {error}") from error


class CameraConfig(msgspec.Struct, frozen=True):
    """A camera; its optical frame (z forward, x right, y down) is on a link of the arm or on another node."""

    driver: str = "agents.plant.driver:PlantCamera"
    name: str = ""
    """Name of the camera at the driver; the node's name if empty."""
    link: str = ""
    """URDF link of the optical frame, fixed to the end effector; if given, `parent` and `mount` are not used."""
    parent: str = "world"
    """Node that carries it."""
    mount: Mount = Mount()
    """parent_from_camera as it is believed to be; a calibration may change the edge later."""
    options: dict[str, Any] = {}
    """Passed on to the driver."""


class ArmControllerConfig(msgspec.Struct, frozen=True):
    """One arm with a gripper, and the cameras of the same robot."""

    driver: str = "agents.plant.driver:PlantArm"
    options: dict[str, Any] = {}
    """Passed on to the driver."""
    urdf: str = "etc/robots/gen3.urdf"
    """Robot description; relative to the folder that holds `etc`."""
    urdf_args: dict[str, Value] = {}
    """Arguments of its macros (xacro), by name; others keep their defaults."""
    base_link: str = ""
    """Link from which the arm hangs; the root if empty"""
    end_effector_link: str = ""
    """The flange, node `gripper`; found if empty: the link at which joints branch into fingers"""
    tool_link: str = ""
    """Name of the link whose frame goes to `target_pose`; found if empty: by usual names, such as `tool_link`"""
    tool_mount: Mount | None = None
    """Where the tool point is in the frame of `tool_link`: z out of the gripper, x from finger to finger"""
    finger_joints: tuple[str, ...] = ()
    """Names of the joints that drive the fingers; all that move below `end_effector_link` if empty"""
    robot: str = "robot"
    """Name of the robot's node."""
    arm: str = "arm"
    """Name of the arm's node, by which it is told apart from others of the same graph (`dsr.vocabulary.arms`). From it
    are made the names of its links' nodes, `arm_link_1`, `arm_link_2`, ..., and the keys of its device"""
    gripper: str = ""
    """Name of the gripper's node, whose frame is that of `end_effector_link`. If empty: `gripper`, and `left_gripper`
    for an arm `left`"""
    mount: Mount = Mount()
    """world_from_robot"""
    arm_mount: Mount = Mount()
    """Pose of the arm's base in the robot's frame, robot_from_arm"""
    cameras: dict[str, CameraConfig] = {}
    """Cameras by the name of their node."""
    default_speed: float = 0.5
    """0 to 1 of the joint limits, where no `target_speed` is given."""
    posture: tuple[float, ...] = ()
    """rad, preferred joint positions where a `target_pose` leaves a choice; the present ones if empty."""
    observe_joints: tuple[float, ...] = ()
    """rad, where `observe` goes: the arm hides nothing from the camera there; also what skills prefer to be near to. If
    empty: the state `home` of the SRDF file beside the URDF file"""
    acceleration: float = 5.0
    """rad/s^2, the most of a joint in skills: what data sheets of arms of this size name for the large joints"""
    jerk: float = 100.0
    """rad/s^3, the most of a joint in skills: the acceleration turns round within 0.1 s, and motions take 0.1 s more"""
    separation: Separation = Separation()
    """How fast the tool point may be in skills near hands and people."""
    workspace: Zone | None = None
    """World; the tool point stays within; None: everywhere"""
    forbidden: dict[str, Zone] = {}
    """World, by name: where no part of the arm goes, nor what it carries. Nodes of type `zone` are others."""
    approach: float = 0.08
    """m, of the straight ways down to an object and up again"""
    stale: float = 0.05
    """s without a new sample after which the arm is stopped: three ticks, so that it brakes within 0.1 s; longer for a
    device that tells samples more rarely than at 30 Hz"""
    effort_limits: dict[str, float] = {}
    """By joint, N m, N or A as the driver tells efforts: more, either way, stops the arm, because it presses against
    something. Joints that are not named are not watched."""
    grip_limit: float = 0.0
    """N, or A as the driver tells how hard the fingers press: they close until they press that hard, and no further. 0:
    as hard as the device does"""
    joint_tolerance: float = 0.003
    """rad, how close a reached target is"""
    still_speed: float = 0.01
    """rad/s below which a joint stands still"""
    opening_tolerance: float = 0.0015
    """m, how close a reached gripper opening is"""

    def __post_init__(self) -> None:
        if not self.gripper:
            msgspec.structs.force_setattr(self, "gripper", gripper_of(self.arm))

    def load_arm(self, folder: Path) -> ArmModel:
        """The arm in the file `urdf`, relative to `folder`, with what is named here. Raises `ConfigError`."""
        return load_arm(
            folder / self.urdf,
            args=self.urdf_args,
            base=self.base_link,
            palm=self.end_effector_link,
            tool=self.tool_link,
            tool_mount=None if self.tool_mount is None else self.tool_mount.pose(),
            fingers=self.finger_joints,
        )
