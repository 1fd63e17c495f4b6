"""The topics of one camera as frames: colour with the depth and the intrinsics that belong to it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

from numpy.typing import NDArray

from agents.ros_bridge.bridge.config import RosCameraTopics
from agents.ros_bridge.bridge.inbox import Arrived, RosInbox
from agents.ros_bridge.bridge.tally import Tally
from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.link.link import Qos
from agents.ros_bridge.mapping.cameras import CAMERA_INFO, read_camera_info, read_lens
from agents.ros_bridge.mapping.images import (
    COMPRESSED,
    IMAGE,
    read_color,
    read_compressed_color,
    read_compressed_depth,
    read_depth,
)
from agents.ros_bridge.mapping.stamps import to_seconds
from agents.ros_bridge.messages.types import RosTypes
from dsr.images.blobs import Frame
from dsr.vocabulary.intrinsics import Distortion, Intrinsics

_APART = 0.02
"""s by which the stamps of colour and depth of one exposure may differ: less than a frame at 30 Hz"""
_PATIENCE = 1.0
"""s without depth of the same exposure after which colour goes on alone"""
_KEPT = 4
"""Images of each kind that wait for their partner: it comes within a frame or two, or never"""
_SENSOR = Qos(reliable=False, depth=5)

Inboxes = Callable[[str, str, int, Qos], RosInbox]
"""Makes an inbox: topic, type, how many messages wait, quality of service"""
Stamps = Callable[[float, float], float | None]
"""Stamp of the memory of one of ROS and the time of arrival, s; None if it cannot be used"""


class _Image(NamedTuple):
    message: Any
    stamp: float
    """s, by the clock of ROS"""
    at: float
    """s, time of arrival"""


class CameraSource:
    """Pairs what a camera publishes.

    Args:
        topics: of the camera.
        inboxes: makes an inbox.
        types: of the messages.
        stamps: converts stamps.
        tally: counts and tells what cannot be used.
    """

    def __init__(
        self, topics: RosCameraTopics, inboxes: Inboxes, types: RosTypes, stamps: Stamps, tally: Tally
    ) -> None:
        self._topics, self._types, self._stamps, self._tally = topics, types, stamps, tally
        self._color = self._listen(inboxes, topics.color, "compressed")
        self._depth = self._listen(inboxes, topics.depth, "compressedDepth")
        self._info = inboxes(topics.info_topic, CAMERA_INFO, 1, _SENSOR)
        self._colors: deque[_Image] = deque(maxlen=_KEPT)
        self._depths: deque[_Image] = deque(maxlen=_KEPT)
        self._alone_since: float | None = None
        """s, arrival of the first colour since the last pair"""
        self._camera_info: Any = None
        self.intrinsics: Intrinsics | None = None
        """Those of the newest CameraInfo; None before the first"""
        self.distortion: Distortion | None = None
        self.frame_id = ""
        """Frame of ROS in which the camera sees; empty before the first image"""

    def frame(self) -> Frame | None:
        """The newest frame that is complete and was not returned before, else None."""
        self._read_info()
        for inbox, images in ((self._color, self._colors), (self._depth, self._depths)):
            if inbox is not None:
                images.extend(image for message in inbox.take() if (image := self._decoded(inbox, message)) is not None)
        pair = self._newest_pair()
        if pair is None:
            return None
        try:
            return self._made(*pair)
        except RosMessageError as error:
            self._tally.tell("malformed", self._topics.color or self._topics.depth, f"an image was dropped: {error}")
            return None

    def close(self) -> None:
        """Listen no more."""
        for inbox in (self._color, self._depth, self._info):
            if inbox is not None:
                inbox.close()

    def _listen(self, inboxes: Inboxes, topic: str, compressed: str) -> RosInbox | None:
        type = COMPRESSED if topic.endswith(f"/{compressed}") else IMAGE
        return (
            inboxes(topic, type, _KEPT if self._topics.color and self._topics.depth else 1, _SENSOR) if topic else None
        )

    def _decoded(self, inbox: RosInbox, message: Arrived) -> _Image | None:
        try:
            decoded = self._types.decode(inbox.topic.type, message.cdr)
        except RosMessageError as error:
            self._tally.tell("malformed", inbox.topic.name, f"a message on {inbox.topic.name} was dropped: {error}")
            return None
        return _Image(decoded, to_seconds(decoded.header.stamp), message.at)

    def _read_info(self) -> None:
        for message in self._info.take():
            name = self._info.topic.name
            try:
                decoded = self._types.decode(CAMERA_INFO, message.cdr)
                self.intrinsics = read_camera_info(decoded, rectified=self._topics.rectified)
            except RosMessageError as error:
                self._tally.tell("malformed", name, f"a message on {name} was dropped: {error}")
                continue
            try:
                self.distortion = None if self._topics.rectified else read_lens(decoded)
            except RosMessageError as error:
                self.distortion = None
                self._tally.tell("malformed", f"{name} lens", f"the distortion on {name} was left out: {error}")

    def _newest_pair(self) -> tuple[_Image | None, _Image | None] | None:
        """Colour and depth of one exposure; the one alone if the camera has no other."""
        colors, depths = self._colors, self._depths
        if self._depth is None or self._color is None:
            images = depths if self._color is None else colors
            if not images:
                return None
            newest = images[-1]
            images.clear()
            return (None, newest) if self._color is None else (newest, None)
        if colors and self._alone_since is None:
            self._alone_since = colors[0].at
        for color in reversed(colors):
            depth = min(depths, key=lambda image: abs(image.stamp - color.stamp), default=None)
            if depth is not None and abs(depth.stamp - color.stamp) <= _APART:
                _forget(colors, color.stamp)
                _forget(depths, depth.stamp)
                self._alone_since = None
                return color, depth
        if colors and self._alone_since is not None and colors[-1].at - self._alone_since > _PATIENCE:
            newest = colors[-1]
            self._tell_alone(newest)
            colors.clear()
            return newest, None
        return None

    def _tell_alone(self, color: _Image) -> None:
        """Count colour that goes on alone; if there is depth, only of other moments, tell it."""
        what, topics = f"colour without depth on {self._topics.color}", self._topics
        if not self._depths:
            self._tally.count(what)
            return
        apart = min(abs(depth.stamp - color.stamp) for depth in self._depths)
        self._tally.tell(
            what, topics.color,
            f"{topics.color} and {topics.depth} are stamped {apart * 1e3:.0f} ms apart, more than {_APART * 1e3:.0f}: "
            "they are of different moments, and depth is left out",
        )  # fmt: skip

    def _made(self, color: _Image | None, depth: _Image | None) -> Frame | None:
        first = color or depth
        assert first is not None
        stamp = self._stamps(first.stamp, first.at)
        if stamp is None:
            return None
        self.frame_id = first.message.header.frame_id
        arrays: dict[str, NDArray[Any]] = {}
        if color is not None:
            compressed = self._topics.color.endswith("/compressed")
            arrays["color"] = read_compressed_color(color.message) if compressed else read_color(color.message)
        if depth is not None:
            compressed = self._topics.depth.endswith("/compressedDepth")
            metres = read_compressed_depth(depth.message) if compressed else read_depth(depth.message)
            if color is not None and metres.shape != arrays["color"].shape[:2]:
                shapes = f"depth {metres.shape}, colour {arrays['color'].shape[:2]}"
                self._tally.tell(
                    "depth not aligned", self._topics.depth, f"{self._topics.depth}: {shapes} px; left out"
                )
            else:
                arrays["depth"] = metres
        return Frame(stamp, arrays, self._meta(next(iter(arrays.values())).shape))

    def _meta(self, shape: tuple[int, ...]) -> dict[str, float | int | str]:
        intrinsics = self.intrinsics
        if intrinsics is None:
            self._tally.count(f"images before {self._info.topic.name}")
            return {}
        if (intrinsics.height, intrinsics.width) != shape[:2]:
            told = f"{intrinsics.width} x {intrinsics.height} px, not {shape[1]} x {shape[0]}"
            text = f"{self._info.topic.name} is about images of {told}"
            self._tally.tell("intrinsics of another size", self._info.topic.name, text)
            return {}
        return {"fx": intrinsics.fx, "fy": intrinsics.fy, "cx": intrinsics.cx, "cy": intrinsics.cy}


def _forget(images: deque[_Image], stamp: float) -> None:
    """Those up to a stamp (s): they were used, or passed over."""
    kept = [image for image in images if image.stamp > stamp]
    images.clear()
    images.extend(kept)
