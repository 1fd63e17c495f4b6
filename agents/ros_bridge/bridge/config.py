"""What is bridged, and how: the typed configuration of the bridge in a system file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import msgspec

from agents.ros_bridge.link.link import LinkConfig
from dsr.config.toml import convert
from dsr.frames.tree import WORLD
from dsr.math3d.transforms import Pose

Positive = Annotated[float, msgspec.Meta(gt=0)]


class Root(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The pose of a frame of ROS that hangs from nothing there, in the memory's world."""

    translation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """m"""
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    """Quaternion (x, y, z, w)"""

    def __post_init__(self) -> None:
        self.pose()

    def pose(self) -> Pose:
        """world_from_frame; it always holds."""
        return Pose(self.translation, self.rotation)


class RosCameraTopics(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The topics of one camera; those that it does not have stay empty."""

    color: str = ""
    """`sensor_msgs/Image`, or `CompressedImage` if the name ends with `compressed`"""
    depth: str = ""
    """Depth: `Image`, or `CompressedImage` if the name ends with `compressedDepth`; aligned with colour, or with
    `depth_info` and `depth_pose`"""
    info: str = ""
    """`sensor_msgs/CameraInfo`; if empty, `camera_info` beside the colour or depth topic"""
    depth_info: str = ""
    """`sensor_msgs/CameraInfo` of depth that is not aligned with colour"""
    depth_pose: Root | None = None
    """Pose of that depth's camera in the optical frame of colour"""

    def __post_init__(self) -> None:
        if not (self.color or self.depth):
            raise ValueError("a camera needs a topic `color` or `depth`")
        if bool(self.depth_info) != (self.depth_pose is not None) or (self.depth_info and not self.color):
            raise ValueError("`depth_info` and `depth_pose` go together, with topics `color` and `depth`")

    @property
    def info_topic(self) -> str:
        """The topic of CameraInfo."""
        base = (self.color or self.depth).removesuffix("/compressed").removesuffix("/compressedDepth")
        return self.info or f"{base.rpartition('/')[0]}/camera_info"

    @property
    def rectified(self) -> bool:
        """Whether image_proc has taken the distortion out, as the name of the topic tells."""
        return "rect" in (self.color or self.depth).removesuffix("/compressed").rpartition("/")[2]


def camera_topics(
    color: str, depth: str, info: str, depth_info: str, depth_pose: Mapping[str, Any] | None
) -> RosCameraTopics:
    """Topics that the options of a driver name. Raises `ConfigError`."""
    told = {"color": color, "depth": depth, "info": info, "depth_info": depth_info, "depth_pose": depth_pose}
    return convert(told, RosCameraTopics, "topics of the camera")


class DetectionTopic(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Objects that a detector in ROS sees, `vision_msgs/Detection3DArray`."""

    types: dict[str, str] = {}
    """Types of nodes by the class that the detector tells; others become a `box`."""
    least_score: float = 0.5
    """Score (0 to 1) of a detection from which it counts"""
    max_age: Positive = 0.7
    """s after which an object that was not seen again is not `perceived` any more, as of the scene estimator"""


class Receive(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What comes from ROS into the memory."""

    tf: bool = True
    """`/tf` and `/tf_static`, as edges RT"""
    joints: dict[str, str] = msgspec.field(default_factory=lambda: {"/joint_states": "robot"})
    """Nodes whose joints they are, by topic; none if an arm controller writes joints"""
    cameras: dict[str, RosCameraTopics] = {}
    """Topics by the node of the camera"""
    clouds: dict[str, str] = {}
    """Topics of point clouds by the node of the sensor, whose stream has them"""
    detections: dict[str, DetectionTopic] = {}
    """Detectors by topic"""


class Send(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What goes from the memory to ROS; an empty topic is not sent."""

    tf: bool = True
    """Edges RT that did not come from ROS, on `/tf` and `/tf_static`"""
    belief: bool = True
    """Edges Virtual_RT, on `/tf`, as frames `belief/NAME`"""
    tf_hz: Positive = 50.0
    """Messages a second on `/tf` and on `/tf_static`; the newest transform of each frame goes out. This and the other
    rates are the largest ones, each enough for people and for most controllers; infinite (`inf`) for all that there
    is"""
    markers: str = "/dsr/markers"
    """Topic of the believed objects as `visualization_msgs/MarkerArray`"""
    beliefs: str = "/dsr/beliefs"
    """Topic of the believed objects as `vision_msgs/Detection3DArray`"""
    beliefs_hz: Positive = 10.0
    """Messages a second on these two topics; and how often `/dsr/objects` looks, however often it is asked"""
    joints: str = "/dsr/joint_states"
    """Topic of joints that did not come from ROS, as `sensor_msgs/JointState`"""
    joints_hz: Positive = 50.0
    """Messages a second on this topic, of each arm; the newest joints go out"""
    images: bool = True
    """Frames of cameras that did not come from ROS, below `/dsr/CAMERA`, for those that somebody subscribes to"""
    images_hz: Positive = 30.0
    """Frames a second of each camera; the newest one goes out"""
    diagnostics: str = "/diagnostics"
    """Topic of the statuses of agents"""
    diagnostics_hz: Positive = 1.0
    """Messages a second on this topic; once a second is the custom in ROS"""
    events: str = "/dsr/events"
    """Topic of events and situations, as JSON"""
    events_hz: Positive = 50.0
    """Messages a second on this topic; further events wait, and go out as they are by then"""
    clock_hz: Positive = 50.0
    """Messages a second on `/clock`, while the bridge publishes that"""
    services: str = "/dsr"
    """Namespace of the services that answer questions; there are none over DDS"""
    keep_missions: Annotated[float, msgspec.Meta(ge=0)] = 600.0
    """s after which a mission that came through the service is removed once it has ended, as calibrators do"""


class RosBridgeConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How ROS is reached, what goes each way, and how frames and times are to be understood."""

    link: LinkConfig = LinkConfig()
    node: str = "/dsr_bridge"
    """Full name of the bridge's node in ROS"""
    receive: Receive = Receive()
    send: Send = Send()
    world_frame: str = WORLD
    """Frame of ROS that is the memory's `world`: often `map`, `odom` or `base_link`"""
    roots: dict[str, Root] = {}
    """Poses of frames in the world that hang from nothing in ROS"""
    types: dict[str, str] = {}
    """Types of the nodes of frames; those of other frames are of type `body`"""
    clock: Literal["auto", "wall", "follow", "publish"] = "auto"
    """What ROS takes the time from. `wall`: the clock of the machine, as the memory does.
    `follow`: `/clock`, as of a simulation in ROS (`use_sim_time`). `publish`: ours, which we publish on `/clock`.
    `auto` publishes it in lockstep and in replays, and is `wall` otherwise."""
    restamp: bool = False
    """Take the time of arrival for the stamps of ROS: for a robot whose clock is wrong"""
    most_hz: Positive = 50.0
    """Transforms a second and frame that are written; the newest wins"""

    @property
    def serves(self) -> bool:
        """Whether questions are answered: over DDS they are not, for its vendors do not understand each other."""
        return bool(self.send.services) and self.link.transport == "zenoh"

    def __post_init__(self) -> None:
        if not math.isfinite(self.most_hz):
            raise ValueError(f"most_hz {self.most_hz}: expected a finite number")
