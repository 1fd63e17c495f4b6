"""The topics of one camera as frames: colour with the depth and the intrinsics that belong to it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from msgspec.structs import replace
from numpy.typing import NDArray

from agents.pairing import Pairing
from agents.ros_bridge.bridge.camera_depth import DepthInColor, Inboxes
from agents.ros_bridge.bridge.config import RosCameraTopics
from agents.ros_bridge.bridge.inbox import Arrived, RosInbox
from agents.ros_bridge.bridge.tally import Tally
from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.link.link import Qos
from agents.ros_bridge.mapping.cameras import CAMERA_INFO, read_lens, read_pinhole
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
from dsr.vocabulary.intrinsics import Intrinsics

_KEPT = 4
"""Images of each kind that wait for their partner: it comes within a frame or two, or never"""
_SENSOR = Qos(reliable=False, depth=5)

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
        self._pairing: Pairing[_Image] = Pairing()
        self._unpaired = 0
        """Images without a partner that were counted"""
        self._shown = DepthInColor(topics, inboxes, types, tally) if topics.depth_info else None
        self.intrinsics: Intrinsics | None = None
        """Those of the newest CameraInfo; None before the first"""
        self.frame_id = ""
        """Frame of ROS in which the camera sees; empty before the first image"""

    def frame(self) -> Frame | None:
        """The newest frame that is complete and was not returned before, else None."""
        self._read_info()
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
        for inbox in (self._color, self._depth, self._info, self._shown):
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
                pinhole = read_pinhole(decoded, rectified=self._topics.rectified)
            except RosMessageError as error:
                self._tally.tell("malformed", name, f"a message on {name} was dropped: {error}")
                continue
            try:
                lens = None if self._topics.rectified else read_lens(decoded)
                self.intrinsics = replace(pinhole, distortion=lens)
            except RosMessageError as error:
                self.intrinsics = pinhole
                self._tally.tell("malformed", f"{name} lens", f"the distortion on {name} was left out: {error}")

    def _images(self, inbox: RosInbox | None) -> list[_Image]:
        """What came since the last call and can be decoded."""
        messages = [] if inbox is None else inbox.take()
        return [image for message in messages if inbox and (image := self._decoded(inbox, message)) is not None]

    def _newest_pair(self) -> tuple[_Image | None, _Image | None] | None:
        """Colour and depth of one exposure; the one alone if the camera has no other."""
        colors, depths = self._images(self._color), self._images(self._depth)
        if self._depth is None:
            return (colors[-1], None) if colors else None
        if self._color is None:
            return (None, depths[-1]) if depths else None
        for color in colors:
            self._pairing.add_color(color, color.stamp, color.at)
        for depth in depths:
            self._pairing.add_depth(depth, depth.stamp, depth.at)
        if (unpaired := self._pairing.unpaired) > self._unpaired:
            self._tally.count(f"unpaired on {self._topics.color}", unpaired - self._unpaired)
            self._unpaired = unpaired
        pair = self._pairing.take()
        if pair is not None and pair[1] is None:
            self._tell_alone()
        return pair

    def _tell_alone(self) -> None:
        """Count colour that goes on alone; if there is depth, only of other moments, tell it."""
        what, topics, gap = f"colour without depth on {self._topics.color}", self._topics, self._pairing.gap
        if gap is None:
            self._tally.count(what)
            return
        self._tally.tell(
            what, topics.color,
            f"{topics.color} and {topics.depth} are stamped {gap * 1e3:.0f} ms apart, more than "
            f"{self._pairing.apart * 1e3:.0f}: they are of different moments, and depth is left out",
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
            shown = metres if self._shown is None else self._shown.show(metres, self.intrinsics)
            if color is not None and shown is not None and shown.shape != arrays["color"].shape[:2]:
                shapes = f"depth {shown.shape}, colour {arrays['color'].shape[:2]}"
                text = f"{self._topics.depth}: {shapes} px; left out"
                self._tally.tell("depth not aligned", self._topics.depth, text)
            elif shown is not None:
                arrays["depth"] = shown
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
        return intrinsics.meta()
