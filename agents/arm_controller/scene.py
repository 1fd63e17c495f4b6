"""What is believed to be around the arm: objects with their boxes, tables, and where the arm stands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dsr import Memory
from dsr.errors import TransformError
from dsr.quaternions import Vector3
from dsr.transforms import Pose

Array = NDArray[np.float64]
WORLD = "world"


@dataclass(frozen=True)
class Thing:
    """A box that is believed to be somewhere: an object, or a table."""

    name: str
    pose: Pose
    """world_from_thing, at the centre of its box"""
    size: Vector3
    """m, along its own axes"""

    @property
    def reach(self) -> Array:
        """(3,) m, how far it extends from its centre along the world's axes."""
        extent: Array = np.abs(self.pose.rotation_matrix) @ np.array(self.size) / 2
        return extent

    @property
    def top(self) -> float:
        """m, the height of its highest point in the world."""
        return float(self.pose.t[2] + self.reach[2])


class Scene:
    """The belief as the arm needs it; read anew with each call."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory

    def object(self, name: str) -> Thing | None:
        """The object, or None if it is not believed to be anywhere."""
        edge = self._memory.get_edge(WORLD, name, "Virtual_RT")
        node = self._memory.get_node(name)
        if edge is None or node is None or node.get("present") is False:
            return None
        pose, size = edge.get("pose"), node.get("size")
        return None if pose is None or size is None else Thing(name, pose, size)

    def is_perceived(self, name: str) -> bool:
        """Whether the object is seen now."""
        node = self._memory.get_node(name)
        return node is not None and node.get("perceived") is True

    def objects(self) -> list[Thing]:
        """All objects that are believed to be somewhere."""
        names = [edge.dst for edge in self._memory.edges("Virtual_RT", src=WORLD)]
        return [thing for name in names if (thing := self.object(name)) is not None]

    def table(self, name: str) -> Thing | None:
        """The table, or None if it is unknown where it is."""
        node = self._memory.get_node(name)
        if node is None or node.type != "table":
            return None
        size = node.get("size")
        try:
            pose = self._memory.transform(WORLD, name)
        except TransformError:
            return None
        return None if size is None else Thing(name, pose @ Pose((0.0, 0.0, -size[2] / 2)), size)

    def tables(self) -> list[Thing]:
        """All tables."""
        return [thing for node in self._memory.nodes("table") if (thing := self.table(node.name)) is not None]

    def world_from(self, node: str) -> Pose:
        """Where a part of the robot is. Raises `TransformError` if it is unknown."""
        return self._memory.transform(WORLD, node)
