"""A camera that speaks ROS, as a driver: colour, aligned depth and intrinsics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from agents.drivers import SILENCE
from agents.ros_bridge.bridge.camera_source import CameraSource
from agents.ros_bridge.bridge.config import camera_topics
from agents.ros_bridge.services.device import RosDevice
from dsr.images.blobs import Frame
from dsr.network.keys import Keys
from dsr.network.transport import Transport


class RosCamera(RosDevice):
    """A `CameraDriver`.

    Args:
        bus: not used; drivers are made with it.
        keys: not used either.
        name: of the camera, from which its node in ROS is named.
        color: topic of colour, see `RosCameraTopics`.
        depth: topic of depth.
        info: topic of CameraInfo.
        depth_info: topic of CameraInfo of depth that is not aligned with colour, see `RosCameraTopics`.
        depth_pose: `translation` and `rotation` of that depth's camera.
        link: how ROS is reached, see `LinkConfig`.
        restamp: take the time of arrival for the stamps of ROS.
    """

    def __init__(
        self, bus: Transport, keys: Keys, name: str = "camera", *, color: str = "", depth: str = "", info: str = "",
        depth_info: str = "", depth_pose: Mapping[str, Any] | None = None, link: Mapping[str, Any] | None = None,
        restamp: bool = False,
    ) -> None:  # fmt: skip
        topics = camera_topics(color, depth, info, depth_info, depth_pose)
        super().__init__(f"/dsr_camera_{''.join(c if c.isalnum() else '_' for c in name)}", link or {}, restamp)
        self._source = CameraSource(topics, self.inbox, self.types, self.stamp, self.tally)
        self._topic = topics.color or topics.depth
        self._heard = self.clock.monotonic()

    def frame(self) -> Frame | None:
        """The newest frame if it was not returned before, else None."""
        frame = self._source.frame()
        if frame is not None:
            self._heard = self.clock.monotonic()
        return frame

    @property
    def trouble(self) -> str:
        """What is wrong now or was lately, in words; empty if nothing is."""
        silent = self.clock.monotonic() - self._heard
        if silent > SILENCE:
            return f"no picture on {self._topic} for {silent:.0f} s: dsr ros check {self._topic}"
        return self.tally.trouble

    @property
    def counts(self) -> Mapping[str, int]:
        """What went wrong or was passed over since the start, by name."""
        return self.tally.counts
