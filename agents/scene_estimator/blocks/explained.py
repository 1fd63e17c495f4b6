"""What in an image known things already explain: objects that are recognised otherwise, the robot, hands."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from agents.scene_estimator.blocks.clusters import Cluster, Support
from dsr.frames.tree import WORLD
from dsr.geometry import own_bounds
from dsr.graph.elements import Node
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Array, Pose
from dsr.memory import Memory
from dsr.vocabulary.perceived import BY_DEPTH, is_perceived
from dsr.vocabulary.relations import SURFACES, THINGS

_MARGIN = 0.015  # m around a known thing that it explains, too: poses and depths are wrong by that at most
_HAND = 0.15  # m around a palm, likewise: fingers reach so far
_SHARE = 0.3  # of a piece's points in known things, from which they explain it


class KnownVolume(NamedTuple):
    """A box that is full of something known."""

    frame_from_box: Pose
    """In the frame of the world, or of a camera"""
    low: Vector3
    """m, least coordinates in its frame"""
    high: Vector3
    """m, greatest coordinates in its frame"""

    @staticmethod
    def box(frame_from_box: Pose, size: Vector3) -> KnownVolume:
        """A box of `size` m around a pose."""
        x, y, z = (0.5 * edge for edge in size)
        return KnownVolume(frame_from_box, (-x, -y, -z), (x, y, z))

    def share(self, points: Array) -> float:
        """Of points (n, 3) of the same frame, how many are in it."""
        local = self.frame_from_box.inverse().apply(points)
        return float(
            ((local > np.array(self.low) - _MARGIN) & (local < np.array(self.high) + _MARGIN)).all(axis=1).mean()
        )


def supports(memory: Memory, at: float) -> list[Support]:
    """All tables whose pose is known at `at` (s)."""
    found = []
    for node in memory.nodes(SURFACES):
        size, pose = node.get("size"), memory.get_transform(WORLD, node.name, at=at)
        if size is not None and pose is not None:
            found.append(Support(node.name, pose.with_covariance(None), size[0], size[1]))
    return found


def known_volumes(memory: Memory, now: float, at: float) -> list[KnownVolume]:
    """Where robots, hands, and objects that are perceived at `now`, but not by depth alone, are at `at` (s)."""
    found = []
    for node in memory.nodes():
        extent = _extent(memory, node, now)
        pose = None if extent is None else memory.get_transform(WORLD, node.name, at=at)
        if extent is not None and pose is not None:
            found.append(KnownVolume(pose, *extent))
    return found


def unexplained(clusters: list[Cluster], known: list[KnownVolume]) -> list[Cluster]:
    """The pieces of which known things hold only a small share."""
    return [cluster for cluster in clusters if sum(volume.share(cluster.points) for volume in known) < _SHARE]


def _extent(memory: Memory, node: Node, now: float) -> tuple[Vector3, Vector3] | None:
    if node.type == "hand":
        return ((-_HAND,) * 3, (_HAND,) * 3) if is_perceived(node, now) else None
    is_known = node.type in THINGS and node.get("source") != BY_DEPTH and is_perceived(node, now)
    if is_known or (node.type not in (*THINGS, *SURFACES) and "bounds" in node):
        bounds = own_bounds(memory, node)
        return None if bounds is None else (bounds.low, bounds.high)
    return None
