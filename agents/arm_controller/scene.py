"""The believed surroundings of the arm: objects with their boxes, tables, and the place of the arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dsr import Memory, Node
from dsr.errors import SchemaError
from dsr.frames.tree import BELIEVED, WORLD
from dsr.geometry import own_bounds
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Shape, from_numbers
from dsr.math3d.transforms import Pose
from dsr.vocabulary.relations import MODELLED, is_present

Array = NDArray[np.float64]

_ROBOT = ("robot", "body", "arm", "gripper")


@dataclass(frozen=True)
class Obstacle:
    """A box that is believed to be somewhere: an object, or a table."""

    name: str
    pose: Pose
    """world_from_thing, at the centre of its box"""
    size: Vector3
    """m, along its own axes"""
    shape: Shape = ()
    """Its parts, in its own frame; none for a solid box"""

    @property
    def reach(self) -> Array:
        """(3,) m, how far it extends from its centre along the world's axes."""
        extent: Array = np.abs(self.pose.rotation_matrix) @ np.array(self.size) / 2
        return extent

    def contains(self, point: Vector3) -> bool:
        """Whether a point (m, world) is within its box."""
        away = np.abs(self.pose.inverse().apply(point))
        return bool((away < np.array(self.size) / 2).all())

    def is_around(self, other: Obstacle) -> bool:
        """Whether the middle of another thing is in a hollow of this one, which carries that along then."""
        if not self.shape or not self.contains(other.pose.t):
            return False
        x, y, z = self.pose.inverse().apply(other.pose.t).tolist()
        return not any(part.contains((x, y, z)) for part in self.shape)

    @property
    def top(self) -> float:
        """m, the height of its highest point in the world."""
        return float(self.pose.t[2] + self.reach[2])


class ArmScene:
    """The belief as the arm needs it; read anew with each call."""

    def __init__(self, memory: Memory) -> None:
        self.memory = self._memory = memory
        """The memory that it is read from."""

    def object(self, name: str) -> Obstacle | None:
        """The object, or None if it is not believed to be anywhere."""
        edge = self._memory.get_edge(WORLD, name, "Virtual_RT")
        node = self._memory.get_node(name)
        if edge is None or node is None or not is_present(node):
            return None
        pose, size = edge.get("pose"), node.get("size")
        return None if pose is None or size is None else Obstacle(name, pose, size, _shape(node))

    def is_perceived(self, name: str) -> bool:
        """Whether the object is seen now."""
        node = self._memory.get_node(name)
        return node is not None and node.get("perceived") is True

    def objects(self) -> list[Obstacle]:
        """List all objects that are believed to be somewhere."""
        names = [edge.dst for edge in self._memory.edges("Virtual_RT", src=WORLD)]
        return [thing for name in names if (thing := self.object(name)) is not None]

    def table(self, name: str) -> Obstacle | None:
        """The table, or None if it is unknown where it is."""
        node = self._memory.get_node(name)
        if node is None or node.type != "table":
            return None
        size = node.get("size")
        pose = self._memory.get_transform(WORLD, name)
        return None if size is None or pose is None else Obstacle(name, pose @ Pose((0.0, 0.0, -size[2] / 2)), size)

    def tables(self) -> list[Obstacle]:
        """List all tables."""
        return [thing for node in self._memory.nodes("table") if (thing := self.table(node.name)) is not None]

    def bodies(self, base: Vector3) -> list[Obstacle]:
        """List all objects, tables and models around an arm whose base is at `base` (m, world), each once.

        A node may be two of that, such as an object with a mesh that is believed to have moved. The mesh tells more
        than the size then.
        """
        return list({thing.name: thing for thing in (*self.objects(), *self.tables(), *self.models(base))}.values())

    def zones(self) -> list[Obstacle]:
        """List the boxes that no arm may enter: nodes of type `zone` with a size and a pose."""
        nodes = self._memory.nodes("zone")
        found = [(node, node.get("size"), self._memory.get_transform(WORLD, node.name)) for node in nodes]
        return [
            Obstacle(node.name, pose, (abs(size[0]), abs(size[1]), abs(size[2])))
            for node, size, pose in found
            if size is not None and pose is not None
        ]

    def models(self, base: Vector3) -> list[Obstacle]:
        """The boxes around objects with meshes that stand around an arm whose base is at `base` (m, world).

        Not what the robot carries as a part of it, nor what is around the arm's base, such as a room.
        """
        found = [thing for node in self._memory.nodes(MODELLED) if (thing := self._model(node))]
        return [thing for thing in found if not thing.contains(base)]

    def _model(self, node: Node) -> Obstacle | None:
        bounds = None if not is_present(node) else own_bounds(self._memory, node)
        if bounds is None or self._is_of_robot(node.name):
            return None
        pose = self._memory.get_transform(WORLD, node.name, types=BELIEVED)
        if pose is None:
            return None
        low, high = np.array(bounds.low), np.array(bounds.high)
        x, y, z = (high - low).tolist()
        u, v, w = ((low + high) / 2).tolist()
        return Obstacle(node.name, pose @ Pose((u, v, w)), (x, y, z))

    def _is_of_robot(self, name: str) -> bool:
        """Whether its frame hangs on one of the robot's."""
        seen: set[str] = set()
        while name not in seen:
            seen.add(name)
            node = self._memory.get_node(name)
            if node is None or node.type in _ROBOT:
                return node is not None
            name = next((edge.src for edge in self._memory.edges("RT", dst=name)), name)
        return False

    def mounted(self, parent: str, node: str) -> Pose | None:
        """parent_from_node of what is fixed to a part of the robot, such as a camera; None if it is not fixed there."""
        edge = self._memory.get_edge(parent, node, "RT")
        return None if edge is None else edge.get("pose")

    def world_from(self, node: str) -> Pose:
        """Pose of a part of the robot in the world. Raises `TransformError` if it is unknown."""
        return self._memory.transform(WORLD, node)


def _shape(node: Node) -> Shape:
    """The parts of a thing; none for a box, and for a shape that nobody can read."""
    try:
        return from_numbers(node["shape"]) if "shape" in node else ()
    except SchemaError:
        return ()
