"""The nodes and edges of hands in the working memory."""

from __future__ import annotations

import math
import re

import numpy as np

from agents.hand_tracker.config import HandTrackerConfig
from agents.hand_tracker.sighting import Side
from agents.hand_tracker.tracks import HANDS, HandTrack
from dsr.errors import TransformError
from dsr.graph.elements import Node
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.vocabulary.perceived import MOST_AHEAD, seconds_unseen

_NAME = re.compile(r"human_hand_(\d)")
_FINGER = re.compile(r"human_hand_\d_finger_(\d)")
_LEAST_SIGMA = 0.001  # m
_TURN_SIGMA = 0.1  # rad, of a palm, at least
_PALM_FACTOR = 2.0  # of a fingertip's standard deviation, that of a palm's centre


def hand_name(number: int) -> str:
    """The node of a hand."""
    return f"human_hand_{number}"


def finger_name(number: int, finger: int) -> str:
    """The node of a fingertip, 0 (thumb) to 4 (little finger)."""
    return f"human_hand_{number}_finger_{finger}"


class HandNodes:
    """Writes hands; nobody else does.

    Args:
        memory: where.
        config: of the tracker.
    """

    def __init__(self, memory: Memory, config: HandTrackerConfig) -> None:
        self._memory = memory
        self._config = config

    def known(self) -> list[HandTrack]:
        """The hands that an earlier run of the tracker left, as tracks without fingertips."""
        found = []
        for node in self._memory.nodes("hand"):
            match = _NAME.fullmatch(node.name)
            edge = self._memory.get_edge("world", node.name, "RT")
            pose = None if edge is None else edge.get("pose")
            if match is None or pose is None or int(match[1]) >= HANDS:
                continue
            side = node.get("side")
            stamp = float(node.get("last_seen", pose.stamp))
            if stamp > self._memory.clock.now() + MOST_AHEAD:  # by a clock that was wrong: any percept is newer
                stamp = 0.0
            palm = pose.with_stamp(stamp).with_covariance(None)
            known_side: Side = side if side in ("left", "right") else "unknown"
            found.append(HandTrack(int(match[1]), self._config, palm, known_side, str(node.get("source", ""))))
        return found

    def write(self, track: HandTrack, now: float) -> None:
        """Write a hand that was just seen. Raises `TransformError` without a world."""
        if "world" not in self._memory:
            raise TransformError("there is no world yet")
        name = hand_name(track.number)
        told = {"perceived": True, "side": track.side, "source": track.source}
        self._put(name, "hand", {**told, "last_seen": min(track.last_seen, now)})
        sigma, turn = max(track.sigma, _LEAST_SIGMA), max(track.turn_sigma, _TURN_SIGMA)
        palm_sigma = max(_PALM_FACTOR * sigma, track.palm_sigma)
        self._memory.add_edge("world", name, "RT", pose=_uncertain(track.palm, palm_sigma, turn))
        for finger, tip in track.tips.items():
            node = finger_name(track.number, finger)
            seen = tip.last_seen == track.last_seen
            size = (2 * self._config.fingertip_radius,) * 3
            perceived = seen or now - tip.last_seen <= self._config.max_age
            self._put(node, "finger", {"perceived": perceived, "last_seen": min(tip.last_seen, now), "size": size})
            if self._memory.get_edge(name, node, "has") is None:
                self._memory.add_edge(name, node, "has")
            pose = Pose(tip.filter.point, track.palm.q, tip.filter.stamp)
            self._memory.add_edge("world", node, "RT", pose=_uncertain(pose, sigma))
        for node, finger in self._fingers(track.number).items():
            if finger not in track.tips:
                self._memory.remove_node(node)

    def age(self, now: float) -> list[int]:
        """Say what is not perceived any more; returns the numbers of hands whose nodes were removed."""
        gone = []
        for node in [*self._memory.nodes("finger"), *self._memory.nodes("hand")]:
            unseen = seconds_unseen(node, now) if "last_seen" in node else math.inf
            if node.get("perceived") is not False and unseen > self._config.max_age:
                self._memory.update_node(node.name, perceived=False)
            match = _NAME.fullmatch(node.name)
            if match and unseen > self._config.retention and not self.grasps(node.name):
                self.remove(int(match[1]))
                gone.append(int(match[1]))
        return gone

    def grasps(self, name: str) -> bool:
        """Whether a hand is believed to hold something."""
        return bool(self._memory.edges("grasping", src=name))

    def remove(self, number: int) -> None:
        """Remove a hand with its fingertips; harmless if there is none."""
        for node in (*self._fingers(number), hand_name(number)):
            self._memory.remove_node(node)

    def _put(self, name: str, kind: str, attributes: dict[str, object]) -> None:
        node: Node | None = self._memory.get_node(name)
        if node is None:
            self._memory.add_node(name, kind, **attributes)
            return
        changed = {key: value for key, value in attributes.items() if node.get(key) != value}
        if changed:
            self._memory.update_node(name, **changed)

    def _fingers(self, number: int) -> dict[str, int]:
        """Finger by node of a hand."""
        edges = self._memory.edges("has", src=hand_name(number))
        return {edge.dst: int(match[1]) for edge in edges if (match := _FINGER.fullmatch(edge.dst))}


def _uncertain(pose: Pose, sigma: float, turn: float = _TURN_SIGMA) -> Pose:
    return pose.with_covariance(np.diag([sigma**2] * 3 + [turn**2] * 3))
