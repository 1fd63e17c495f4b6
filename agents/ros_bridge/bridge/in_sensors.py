"""From images, clouds and joint states of ROS into the streams and nodes of the memory."""

from __future__ import annotations

import math
from typing import Any

from numpy.typing import NDArray

from agents.ros_bridge.bridge.camera_source import CameraSource
from agents.ros_bridge.bridge.config import RosBridgeConfig
from agents.ros_bridge.bridge.core import SENSOR, BridgeCore
from agents.ros_bridge.bridge.stamping import usable_stamp
from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.mapping.clouds import CLOUD, check_fields, read_cloud
from agents.ros_bridge.mapping.joints import JOINT_STATE, JointTable, read_joints
from agents.ros_bridge.mapping.stamps import to_seconds
from dsr.errors import DsrError
from dsr.images.blobs import Frame
from dsr.math3d.transforms import Pose

_MOST_WAITING = 200
"""JointStates that wait for a tick: of several publishers at 1000 Hz"""


class CamerasIn:
    """Forwards the frames of cameras, and keeps their nodes up to date."""

    def __init__(self, core: BridgeCore, config: RosBridgeConfig) -> None:
        self._core = core
        self._sources: dict[str, CameraSource] = {}
        self._described: dict[str, dict[str, object]] = {}
        for node, topics in config.receive.cameras.items():
            core.memory.add_node(node, "camera", stream=node)

            def stamps(stamp: float, at: float, node: str = node) -> float | None:
                return usable_stamp(core, stamp, at, restamp=config.restamp, subject=node)

            self._sources[node] = CameraSource(topics, core.inbox, core.types, stamps, core.tally)

    def update(self) -> None:
        """Forward each camera's newest frame."""
        for node, source in self._sources.items():
            frame = source.frame()
            if frame is not None:
                try:
                    self._describe(node, source)
                    self._core.memory.put_frame(node, frame)
                except (DsrError, ValueError) as error:
                    self._core.tally.tell("not written", node, f"a frame of {node!r} was not written: {error}")

    def _describe(self, node: str, source: CameraSource) -> None:
        """Write intrinsics and the frame from which the camera hangs, if they are new."""
        told: dict[str, object] = {"frame": source.frame_id}
        if source.intrinsics is not None:
            told |= source.intrinsics.attributes()
        if told == self._described.get(node) and node in self._core.memory:
            return
        memory = self._core.memory
        memory.add_node(node, "camera", stream=node, **{name: value for name, value in told.items() if name != "frame"})
        self._hang(node, self._core.names.node(source.frame_id) if source.frame_id else node)
        self._described[node] = told

    def _hang(self, node: str, frame: str) -> None:
        """Hang a camera from the frame that its images name, and from no other one that they named before."""
        memory = self._core.memory
        if frame == node or memory.get_edge(frame, node, "RT") is not None:
            return
        self._core.frames.ensure(frame)
        for edge in memory.edges("RT", dst=node):
            if self._core.came_from_ros(edge, "pose"):
                memory.remove_edge(edge.src, node, "RT")
        memory.add_edge(frame, node, "RT", pose=Pose.identity())


class CloudsIn:
    """Forwards point clouds to the streams of their nodes: arrays `points` (n, 3) m in the sensor's frame, `colors`."""

    def __init__(self, core: BridgeCore, config: RosBridgeConfig) -> None:
        self._core = core
        self._restamp = config.restamp
        self._inboxes = {node: core.inbox(topic, CLOUD, 1, SENSOR) for node, topic in config.receive.clouds.items()}

    def update(self) -> None:
        """Forward each sensor's newest cloud."""
        for node, inbox in self._inboxes.items():
            for message in inbox.take():
                try:
                    check_fields(message.cdr)
                    cloud = self._core.types.decode(CLOUD, message.cdr)
                    points, colors = read_cloud(cloud)
                    told = to_seconds(cloud.header.stamp)
                    stamp = usable_stamp(self._core, told, message.at, restamp=self._restamp, subject=node)
                    if stamp is None:
                        continue
                    self._ensure(node, cloud.header.frame_id)
                    arrays: dict[str, NDArray[Any]] = {"points": points}
                    if colors is not None:
                        arrays["colors"] = colors
                    self._core.memory.put_frame(node, Frame(stamp, arrays, {}))
                except RosMessageError as error:
                    name = inbox.topic.name
                    self._core.tally.tell("malformed", name, f"a message on {name} was dropped: {error}")
                except DsrError as error:
                    self._core.tally.tell("not written", node, f"a cloud of {node!r} was not written: {error}")

    def _ensure(self, node: str, frame_id: str) -> None:
        memory = self._core.memory
        if node in memory and "stream" in memory.node(node):
            return
        memory.add_node(node, "body", stream=node)
        frame = self._core.names.node(frame_id) if frame_id else node
        if frame != node:
            self._core.frames.ensure(frame)
            memory.add_edge(frame, node, "RT", pose=Pose.identity())


class JointsIn:
    """Writes the newest positions and velocities of a robot's joints to its node."""

    def __init__(self, core: BridgeCore, config: RosBridgeConfig) -> None:
        self._core = core
        self._types = config.types
        self._period = 1.0 / config.most_hz
        self._robots = {
            node: (core.inbox(topic, JOINT_STATE, _MOST_WAITING), JointTable())
            for topic, node in config.receive.joints.items()
        }
        self._written: dict[str, float] = {}
        self._names: dict[str, tuple[str, ...]] = {}
        self._waiting: set[str] = set()

    def update(self, now: float) -> None:
        """Write what came, at most as often as transforms."""
        for node, (inbox, table) in self._robots.items():
            for message in inbox.take():
                name = inbox.topic.name
                try:
                    sample = read_joints(self._core.types.decode(JOINT_STATE, message.cdr))
                    table.add(sample, message.at)
                    self._waiting.add(node)
                    if sample.unknown:
                        self._core.tally.count("positions of joints that are not known", len(sample.unknown))
                except RosMessageError as error:
                    self._core.tally.tell("malformed", name, f"a message on {name} was dropped: {error}")
            if node in self._waiting and now - self._written.get(node, -math.inf) >= 0.9 * self._period:
                self._waiting.discard(node)
                self._written[node] = now
                self._write(node, table)

    def _write(self, node: str, table: JointTable) -> None:
        memory = self._core.memory
        values = {"joint_positions": table.positions, "joint_velocities": table.velocities}
        try:
            if self._names.get(node) != table.names or node not in memory:
                type = self._types.get(node, "robot")
                found = memory.get_node(node)
                memory.add_node(
                    node, type if found is None else found.type, joint_names=",".join(table.names), **values
                )
                self._names[node] = table.names
            else:
                memory.update_node(node, **values)
        except DsrError as error:
            self._core.tally.tell("not written", node, f"the joints of {node!r} were not written: {error}")
