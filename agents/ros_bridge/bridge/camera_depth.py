"""Depth that a camera in ROS measures beside its colour, shown in the image of colour."""

from __future__ import annotations

from collections.abc import Callable

from agents.depth_alignment import DepthAlignment
from agents.frame_images import Depth
from agents.ros_bridge.bridge.config import RosCameraTopics
from agents.ros_bridge.bridge.inbox import RosInbox
from agents.ros_bridge.bridge.tally import Tally
from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.link.link import Qos
from agents.ros_bridge.mapping.cameras import CAMERA_INFO, read_camera_info
from agents.ros_bridge.messages.types import RosTypes
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics

_SENSOR = Qos(reliable=False, depth=5)

Inboxes = Callable[[str, str, int, Qos], RosInbox]
"""Makes an inbox: topic, type, how many messages wait, quality of service"""


class DepthInColor:
    """Listens to the CameraInfo of a depth image that is not aligned, and aligns it.

    Args:
        topics: of the camera, with `depth_info` and `depth_pose`.
        inboxes: makes an inbox.
        types: of the messages.
        tally: counts and tells what cannot be used.
    """

    def __init__(self, topics: RosCameraTopics, inboxes: Inboxes, types: RosTypes, tally: Tally) -> None:
        self._topics, self._types, self._tally = topics, types, tally
        self._info = inboxes(topics.depth_info, CAMERA_INFO, 1, _SENSOR)
        self._pose = Pose.identity() if topics.depth_pose is None else topics.depth_pose.pose()
        self._depth: Intrinsics | None = None
        self._made: tuple[Intrinsics, Intrinsics, DepthAlignment] | None = None

    def show(self, depth: Depth, color: Intrinsics | None) -> Depth | None:
        """Depth (m) in the image of a camera of these intrinsics; None, and counted, before all are known."""
        self._read_info()
        own = self._depth
        if own is None or color is None:
            self._tally.count(f"depth before {self._topics.depth_info}")
            return None
        try:
            if self._made is None or self._made[:2] != (own, color):
                self._made = own, color, DepthAlignment(own, color, self._pose)
            return self._made[2].align(depth)
        except ValueError as error:
            text = f"{self._topics.depth_info} is not about {self._topics.depth}: {error}"
            self._tally.tell("intrinsics of another size", self._topics.depth_info, text)
            return None

    def close(self) -> None:
        """Listen no more."""
        self._info.close()

    def _read_info(self) -> None:
        for message in self._info.take():
            name = self._info.topic.name
            try:
                self._depth = read_camera_info(self._types.decode(CAMERA_INFO, message.cdr))
            except RosMessageError as error:
                self._tally.tell("malformed", name, f"a message on {name} was dropped: {error}")
