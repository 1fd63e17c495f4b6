"""From detections of objects in ROS to percepts: RT edges from the sensor's frame, and which objects are seen now."""

from __future__ import annotations

import msgspec

from agents.ros_bridge.bridge.config import DetectionTopic, RosBridgeConfig
from agents.ros_bridge.bridge.core import BridgeCore
from agents.ros_bridge.bridge.stamping import usable_stamp
from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.mapping.detections import DETECTIONS, DetectedObject, read_detections
from agents.ros_bridge.mapping.names import node_of
from dsr.errors import DsrError
from dsr.vocabulary.relations import THINGS

_MOST_WAITING = 20
"""Messages that wait for a tick: detectors are slow"""
_MOST_OBJECTS = 500
"""Objects that one detector may make: one that numbers its false percepts does not fill the graph"""
_UNKNOWN = "box"


class _Detector(msgspec.Struct):
    """What one detector has told."""

    config: DetectionTopic
    seen: dict[str, float] = {}
    """Names of the objects, and the stamp (s) when they were seen last"""
    made: int = 0


class DetectionsIn:
    """Writes each detection as an edge RT from the frame of the message, with its covariance."""

    def __init__(self, core: BridgeCore, config: RosBridgeConfig) -> None:
        self._core = core
        self._restamp = config.restamp
        self._detectors = [
            (core.inbox(topic, DETECTIONS, _MOST_WAITING), _Detector(detector))
            for topic, detector in config.receive.detections.items()
        ]

    def update(self, now: float) -> None:
        """Write what came, and take back `perceived` of what was not seen for long."""
        for inbox, detector in self._detectors:
            name = inbox.topic.name
            for message in inbox.take():
                try:
                    found, errors = read_detections(self._core.types.decode(DETECTIONS, message.cdr))
                except RosMessageError as error:
                    self._core.tally.tell("malformed", name, f"a message on {name} was dropped: {error}")
                    continue
                for why in errors:
                    self._core.tally.tell("malformed", f"{name} one", f"a detection on {name} was dropped: {why}")
                with self._core.memory.batch():
                    for detected in found:
                        self._take(detected, detector, message.at, now)
            self._age(detector, now)

    def _take(self, detected: DetectedObject, detector: _Detector, arrival: float, now: float) -> None:
        if not detected.score >= detector.config.least_score:  # nor one that is not a number
            self._core.tally.count("detections with a low score")
            return
        try:
            name = node_of(detected.id or detected.kind)
            frame = self._core.names.node(detected.frame)
            told = detected.pose.stamp
            stamp = usable_stamp(self._core, told, arrival, restamp=self._restamp, subject=name)
            if stamp is not None:
                self._write(name, frame, detected, detector, stamp, now)
        except DsrError as error:
            self._core.tally.tell("not written", detected.id, f"detection {detected.id!r} was not written: {error}")

    def _write(
        self, name: str, frame: str, detected: DetectedObject, detector: _Detector, stamp: float, now: float
    ) -> None:
        memory = self._core.memory
        self._core.frames.ensure(frame)
        node = memory.get_node(name)
        if node is None:
            if detector.made >= _MOST_OBJECTS:
                self._core.tally.tell("too many objects", "", f"more than {_MOST_OBJECTS} objects from one detector")
                return
            detector.made += 1
            type = detector.config.types.get(detected.kind, _UNKNOWN)
            size = {} if detected.size is None else {"size": detected.size}
            memory.add_node(name, type, perceived=True, last_seen=min(stamp, now), **size)
        elif node.type not in THINGS:
            self._core.tally.tell("not written", name, f"detection {name!r} is a node of type {node.type!r}")
            return
        else:
            changed = {} if node.get("perceived") is True else {"perceived": True}
            memory.update_node(name, last_seen=min(stamp, now), **changed)
        memory.add_edge(frame, name, "RT", pose=detected.pose.with_stamp(stamp))
        detector.seen[name] = min(stamp, now)

    def _age(self, detector: _Detector, now: float) -> None:
        for name, stamp in list(detector.seen.items()):
            if now - stamp > detector.config.max_age:
                del detector.seen[name]
                node = self._core.memory.get_node(name)
                if node is not None and node.get("perceived"):
                    self._core.memory.update_node(name, perceived=False)
