"""A detector of AprilTags in ROS, as a driver of the scene estimator."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from agents.drivers import TagReadings
from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.link.link import Qos
from agents.ros_bridge.mapping.apriltags import APRILTAGS, read_apriltags
from agents.ros_bridge.mapping.cameras import CAMERA_INFO, read_camera_info
from agents.ros_bridge.mapping.stamps import to_seconds
from agents.ros_bridge.services.device import RosDevice
from dsr.network.keys import Keys
from dsr.network.transport import Transport
from dsr.vocabulary.intrinsics import Intrinsics

_SENSOR = Qos(reliable=False, depth=5)


class RosTags(RosDevice):
    """A `TagDriver`: corners of tags and the intrinsics, from which the scene estimator works out poses.

    Args:
        bus: not used; drivers are made with it.
        keys: not used either.
        detections: topic of `apriltag_msgs/AprilTagDetectionArray`.
        info: topic of the camera's `sensor_msgs/CameraInfo`; apriltag_ros works on rectified images.
        rectified: whether the images are rectified.
        link: how ROS is reached, see `LinkConfig`.
        restamp: take the time of arrival for the stamps of ROS.
    """

    def __init__(
        self, bus: Transport, keys: Keys, *, detections: str = "/detections", info: str = "/camera/camera_info",
        rectified: bool = True, link: Mapping[str, Any] | None = None, restamp: bool = False,
    ) -> None:  # fmt: skip
        super().__init__("/dsr_tags", link or {}, restamp)
        self._rectified = rectified
        self._detections = self.inbox(detections, APRILTAGS, 1, _SENSOR)
        self._info = self.inbox(info, CAMERA_INFO, 1, _SENSOR)
        self._intrinsics: Intrinsics | None = None

    def readings(self) -> TagReadings | None:
        """The newest readings if they were not returned before, else None; none before the first CameraInfo."""
        try:
            for message in self._info.take():
                info = self.types.decode(CAMERA_INFO, message.cdr)
                self._intrinsics = read_camera_info(info, rectified=self._rectified)
            for message in self._detections.take():
                found = self.types.decode(APRILTAGS, message.cdr)
                stamp = self.stamp(to_seconds(found.header.stamp), message.at)
                if self._intrinsics is None:
                    self.tally.count("tags before the first CameraInfo")
                elif stamp is not None:
                    return TagReadings(stamp, [], self._intrinsics, corners=read_apriltags(found))
        except RosMessageError as error:
            self.tally.tell("malformed", self._detections.topic.name, f"a message was dropped: {error}")
        return None
