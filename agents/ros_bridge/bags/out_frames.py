"""From recorded frames to images, camera infos and point clouds of a bag."""

from __future__ import annotations

from typing import Any

from agents.recorder.images import unpack
from agents.ros_bridge.bridge.core import BridgeCore, RosOutlet
from agents.ros_bridge.bridge.out_sensors import sensor_topic
from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.mapping.cameras import CAMERA_INFO, to_camera_info
from agents.ros_bridge.mapping.clouds import CLOUD, to_cloud
from agents.ros_bridge.mapping.images import COMPRESSED, IMAGE, to_compressed, to_image
from dsr.graph.elements import Node
from dsr.images.blobs import Frame, decode_frame
from dsr.vocabulary.intrinsics import read_intrinsics

BLOB = "blob/"
_PACKED = {"color.jpeg": "jpeg", "color.png": "png"}
"""Formats of colour images by the arrays that hold them in a recording"""


class FramesOut:
    """Publishes the frames of a recording. Colour stays compressed as it was recorded, unless `raw`.

    Args:
        core: of the export.
        raw: colour as plain images.
    """

    def __init__(self, core: BridgeCore, *, raw: bool) -> None:
        self._core, self._raw = core, raw
        self._outlets: dict[str, RosOutlet] = {}

    def send(self, topic: str, payload: bytes) -> None:
        """Publish what a message on `blob/...` holds. Raises `WireError` for one that is malformed."""
        node = self._node(topic.removeprefix(BLOB))
        sensor = topic.removeprefix(BLOB) if node is None else node.name
        if not self._core.wants((sensor,)):
            return
        packed = decode_frame(payload)
        kept = {} if self._raw else {name: packed.arrays[name] for name in _PACKED if name in packed.arrays}
        frame = unpack(Frame(packed.stamp, {n: a for n, a in packed.arrays.items() if n not in kept}, packed.meta))
        base, name = sensor_topic(sensor), self._core.names.frame(sensor)
        types, stamp = self._core.types, self._core.times.to_ros(frame.stamp)
        for array, data in kept.items():
            self._send(
                f"{base}/image_raw/compressed", COMPRESSED, to_compressed(types, stamp, name, data, _PACKED[array])
            )
        for array, topic_of in (("color", "image_raw"), ("depth", "depth")):
            if array in frame.arrays:
                self._send_image(f"{base}/{topic_of}", stamp, name, frame.arrays[array])
        if "points" in frame.arrays:
            cloud = to_cloud(types, stamp, name, frame.arrays["points"], frame.arrays.get("colors"))
            self._send(f"{base}/points", CLOUD, cloud)
        intrinsics = None if node is None else read_intrinsics(node)
        if node is not None and intrinsics is not None and (kept or frame.arrays.keys() & {"color", "depth"}):
            info = to_camera_info(types, stamp, name, intrinsics)
            self._send(f"{base}/camera_info", CAMERA_INFO, info)

    def _send_image(self, topic: str, stamp: float, name: str, array: Any) -> None:
        try:
            self._send(topic, IMAGE, to_image(self._core.types, stamp, name, array))
        except RosMessageError as error:
            self._core.tally.tell("not sent", topic, f"an image on {topic} was not exported: {error}")

    def _send(self, topic: str, type: str, message: Any) -> None:
        outlet = self._outlets.get(topic)
        if outlet is None:
            outlet = self._outlets[topic] = self._core.outlet(topic, type)
        if outlet.wanted:
            outlet.send(lambda: message)

    def _node(self, stream: str) -> Node | None:
        """The node whose stream it is."""
        memory = self._core.memory
        found = memory.get_node(stream)
        if found is not None and found.get("stream", stream) == stream:
            return found
        return next((node for node in memory.nodes() if node.get("stream") == stream), None)
