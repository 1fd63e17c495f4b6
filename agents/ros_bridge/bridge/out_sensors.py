"""Joints and camera frames of the memory that did not come from ROS, as topics."""

from __future__ import annotations

import math
import re
from collections.abc import Collection

from agents.ros_bridge.bridge.config import Send
from agents.ros_bridge.bridge.core import BridgeCore, RosOutlet
from agents.ros_bridge.bridge.stamping import Upcoming
from agents.ros_bridge.bridge.throttle import Throttle
from agents.ros_bridge.mapping.cameras import CAMERA_INFO, to_camera_info
from agents.ros_bridge.mapping.images import IMAGE, to_image
from agents.ros_bridge.mapping.joints import JOINT_STATE, to_joint_state
from dsr.graph.elements import Node
from dsr.graph.shares import makers, shared_out
from dsr.images.blobs import Frame
from dsr.images.frame_reader import FrameReader
from dsr.network.keys import is_key
from dsr.vocabulary.intrinsics import read_intrinsics
from dsr.vocabulary.perceived import MOST_CAMERAS
from dsr.vocabulary.relations import nodes_by_name

_LOOK = 0.5
"""s until it is looked again whether anybody wants the images of a camera"""
_JOINTED = ("robot", "arm", "gripper", "hand", "body")
"""Types of nodes that may have joints"""
_UNSAFE = re.compile(r"[^A-Za-z0-9_]")


def sensor_topic(node: str) -> str:
    """The topic below which those of a camera or another sensor are."""
    name = _UNSAFE.sub("_", node)
    return f"/dsr/camera_{name}" if name[0].isdigit() else f"/dsr/{name}"


class JointsOut:
    """Publishes the joints of each arm when they change, and not more often than wanted."""

    def __init__(self, core: BridgeCore, config: Send) -> None:
        self._core = core
        self._throttle = Throttle(core.clock, config.joints_hz)
        self._outlet = core.outlet(config.joints, JOINT_STATE) if config.joints else None
        if self._outlet is not None:
            self._watch = core.memory.watch(node_type=_JOINTED, attribute="joint_positions")
            core.on_close(self._watch.close)

    def update(self) -> None:
        """Send what changed, if it is time."""
        if self._outlet is None or not self._throttle.is_due:
            return
        changes = self._watch.poll()
        if changes:
            self._throttle.take()
        for change in changes:
            node = self._core.memory.get_node(change.name) if change.element == "node" else None
            positions = None if node is None else node.get("joint_positions")
            if node is None or positions is None or self._core.came_from_ros(node, "joint_positions"):
                continue
            if not self._core.wants((node.name,)):
                continue
            names = [name.strip() for name in node.get("joint_names", "").split(",")]
            if len(names) != len(positions):
                continue
            now = self._core.times.now()  # a stamp of a time to come is outdone by all later ones, and says nothing
            stamp = self._core.times.to_ros(min(node.written_at("joint_positions") or now, now))
            velocities = node.get("joint_velocities", ())
            known = velocities if len(velocities) == len(names) else ()
            self._send(self._outlet, stamp, names, positions, known)

    def _send(
        self, outlet: RosOutlet, stamp: float, names: list[str], positions: tuple[float, ...], known: tuple[float, ...]
    ) -> None:
        outlet.send(lambda: to_joint_state(self._core.types, stamp, names, positions, known))


class _Stream:
    """The topics of one camera; its frames are read while somebody wants them."""

    def __init__(self, core: BridgeCore, config: Send, node: str) -> None:
        self._core = core
        self._throttle = Throttle(core.clock, config.images_hz)
        self.node = node
        base = sensor_topic(node)
        self._color = core.outlet(f"{base}/image_raw", IMAGE)
        self._depth = core.outlet(f"{base}/depth", IMAGE)
        self._info = core.outlet(f"{base}/camera_info", CAMERA_INFO)
        self._stream = ""
        self._reader: FrameReader | None = None
        self._upcoming: Upcoming[str, Frame] = Upcoming(core)
        """A frame of a time to come, if there is one"""
        self._wanted: set[RosOutlet] = set()
        self._looked = -math.inf

    def follow(self, stream: str) -> None:
        """Send the frames of this stream from now on."""
        if stream != self._stream:
            self._stop_reading()
            self._stream = stream

    def update(self, now: float) -> None:
        """Send the newest frame."""
        if now - self._looked >= _LOOK:
            self._looked = now
            self._wanted = {outlet for outlet in (self._color, self._depth, self._info) if outlet.wanted}
        if not self._wanted:
            self._stop_reading()
            return
        if self._reader is None:
            self._reader = self._core.memory.frames(self._stream)
        frame = self._newest(self._reader) if self._throttle.is_due else None
        if frame is not None:
            self._throttle.take()
            self._send(frame)

    def _newest(self, reader: FrameReader) -> Frame | None:
        """A frame that was not sent before, and whose time has come."""
        frame = reader.latest()
        if frame is not None and not self._upcoming.waits(self._stream, frame.stamp, frame, self.node):
            return frame
        return next((waited for _, waited in self._upcoming.due()), None)

    def _stop_reading(self) -> None:
        self._upcoming.drop(self._stream)
        if self._reader is not None:
            self._reader.close()
            self._reader = None

    def _send(self, frame: Frame) -> None:
        core = self._core
        stamp, name = core.times.to_ros(frame.stamp), core.names.frame(self.node)
        for array, outlet in (("color", self._color), ("depth", self._depth)):
            if outlet in self._wanted and array in frame.arrays:
                pixels = frame.arrays[array]
                outlet.send(lambda pixels=pixels: to_image(core.types, stamp, name, pixels))  # type: ignore[misc]
        node = core.memory.get_node(self.node)
        intrinsics = None if node is None else read_intrinsics(node)
        if self._info in self._wanted and node is not None and intrinsics is not None:
            self._info.send(lambda: to_camera_info(core.types, stamp, name, intrinsics))

    def close(self) -> None:
        """Publish no more."""
        self._stop_reading()
        for outlet in (self._color, self._depth, self._info):
            outlet.close()


class ImagesOut:
    """Publishes the frames of the memory's cameras to those who subscribe.

    Args:
        core: of the bridge.
        config: what is sent.
        received: streams whose frames come from ROS.
    """

    def __init__(self, core: BridgeCore, config: Send, received: Collection[str] = ()) -> None:
        self._core = core
        self._received = frozenset(received)
        self._streams: dict[str, _Stream] = {}
        self._config = config
        self._wanted = config.images
        if self._wanted:
            self._watch = core.memory.watch(node_type="camera")
            core.on_close(self._watch.close)
            core.on_close(self._close)

    def update(self, now: float) -> None:
        """Take note of cameras that came or went, and send their newest frames at time `now` (s)."""
        if not self._wanted:
            return
        if self._watch.poll():
            present = {node.name: node for node in self._present()}
            for name in self._streams.keys() - present.keys():
                self._streams.pop(name).close()
            for name in sorted(present):
                if name not in self._streams:
                    self._streams[name] = _Stream(self._core, self._config, name)
                self._streams[name].follow(_stream_of(present[name]))
        for stream in self._streams.values():
            stream.update(now)

    def _present(self) -> list[Node]:
        """The cameras that have topics. Of too many these are as many of each agent.

        Of several with one topic, that which has it keeps it, but gives it to one of the same agent that it is named
        after. If none has it, that which it is named after gets it.
        """
        ours = [node for node in nodes_by_name(self._core.memory, "camera") if self._is_ours(node)]
        ours.sort(key=lambda node: (node.name not in self._streams, not _is_namesake(node)))
        owners: dict[str, Node] = {}
        for node in ours:
            topic = sensor_topic(node.name)
            owner = owners.setdefault(topic, node)
            if _is_namesake(node) and makers(node) == makers(owner):
                owners[topic] = node
            if owner is not node:
                self._tell_of_both(owners[topic], owner if owners[topic] is node else node)
        return shared_out(owners.values(), MOST_CAMERAS)

    def _tell_of_both(self, owner: Node, other: Node) -> None:
        """Tell that one camera has the topic that another one would have, too."""
        tally = self._core.tally
        text = f"camera {other.name!r} is not sent: its topic is that of {owner.name!r}"
        tally.tell("not sent", other.name, text)
        if makers(owner) != makers(other):
            text = f"camera {owner.name!r} keeps its topic, which {other.name!r} of another agent would have, too"
            tally.tell("topics that others would have", owner.name, text)

    def _close(self) -> None:
        """Publish nothing any more."""
        for stream in self._streams.values():
            stream.close()
        self._streams.clear()

    def _is_ours(self, node: Node) -> bool:
        stream = _stream_of(node)
        if not is_key(stream):
            text = f"camera {node.name!r} is not sent: its stream {stream!r} is no name such as 'camera_overhead'"
            self._core.tally.tell("not sent", node.name, text)
            return False
        if node.newest_write("stream") is None and self._core.is_made_by_bridge(node):
            return False
        return stream not in self._received and not self._core.came_from_ros(node, "stream")


def _stream_of(node: Node) -> str:
    return node.get("stream") or node.name


def _is_namesake(node: Node) -> bool:
    """Whether the topic of a camera has its very name."""
    return sensor_topic(node.name) == f"/dsr/{node.name}"
