"""Boxes around things in any frame: all eight corners of each transformed, with all that is below them.

The box of a node itself is that of its meshes (attribute `bounds`, or the meshes if they are here), else of its `size`.
Around what stands askew the box in the world is the box of a box, and so larger than need be; `exact` asks for the
vertices themselves.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dsr.errors import SchemaError
from dsr.frames.tree import BELIEVED, Types
from dsr.geometry.mesh import Bounds, joined_bounds, mesh_hashes
from dsr.graph.elements import Node
from dsr.math3d.transforms import Pose

if TYPE_CHECKING:
    from dsr.memory import Memory

_ON_TOP = ("table",)
"""Node types whose frame is at the centre of the top, not of the middle."""

Points = NDArray[np.float64]


def bounding_box(
    memory: Memory,
    name: str,
    frame: str = "world",
    *,
    children: bool = True,
    types: Types = BELIEVED,
    exact: bool = False,
) -> Bounds | None:
    """The box around a node in a frame, parallel to the frame's axes.

    Args:
        memory: a world.
        name: of the node.
        frame: of the box.
        children: with all that is below the node along edges of `types`.
        types: geometric edges, the first that a node has counts.
        exact: by the vertices of meshes that are here; others are asked for, and count by their box until they are.

    Returns:
        None if nothing of it has an extent and a place.

    Raises:
        NodeNotFoundError: for an unknown name.
    """
    nodes = _below(memory, memory.node(name), types) if children else iter([memory.node(name)])
    return joined_bounds(box for node in nodes if (box := _placed(memory, node, frame, types, exact)) is not None)


def own_bounds(memory: Memory, node: Node) -> Bounds | None:
    """The box around a node without what is below it, in its own frame; None if nothing tells it."""
    bounds = node.get("bounds")
    if isinstance(bounds, tuple) and len(bounds) == 6:
        low, high = np.minimum(bounds[:3], bounds[3:]).tolist(), np.maximum(bounds[:3], bounds[3:]).tolist()
        return Bounds((low[0], low[1], low[2]), (high[0], high[1], high[2]))
    found = [mesh for hash in _hashes(node) if (mesh := memory.get_mesh(hash)) is not None]
    if found:
        return joined_bounds(mesh.bounds for mesh in found)
    size = node.get("size")
    if not isinstance(size, tuple) or len(size) != 3:
        return None
    x, y, z = (abs(edge) / 2 for edge in size)
    below, above = (2 * z, 0.0) if node.type in _ON_TOP else (z, z)
    return Bounds((-x, -y, -below), (x, y, above))


def volume(memory: Memory, node: Node) -> float | None:
    """Volume (m^3) of the box around a node without what is below it; None if it has no extent that is known."""
    bounds = own_bounds(memory, node)
    if bounds is None:
        return None
    return math.prod(high - low for low, high in zip(bounds.low, bounds.high, strict=True))


def corners(bounds: Bounds) -> Points:
    """The eight corners (8, 3) of the box with these bounds, m."""
    return np.array(list(itertools.product(*zip(bounds.low, bounds.high, strict=True))))


def transformed(bounds: Bounds, pose: Pose) -> Bounds:
    """The box around all eight corners in another frame; `pose` is destination_from_source."""
    return _around(corners(bounds), pose)


def _placed(memory: Memory, node: Node, frame: str, types: Types, exact: bool) -> Bounds | None:
    """The box of a node alone in `frame`; None without extent or place."""
    meshes = [memory.get_mesh(hash) for hash in _hashes(node)] if exact else []
    whole = [mesh for mesh in meshes if mesh is not None]
    bounds = None if whole and len(whole) == len(meshes) else own_bounds(memory, node)
    if bounds is None and not whole:
        return None
    pose = Pose() if node.name == frame else memory.get_transform(frame, node.name, types=types)
    if pose is None:
        return None
    if bounds is not None:
        return transformed(bounds, pose)
    return joined_bounds(_around(mesh.vertices.astype(np.float64), pose) for mesh in whole)


def _around(points: Points, pose: Pose) -> Bounds:
    matrix = pose.matrix
    placed = points @ matrix[:3, :3].T + matrix[:3, 3]
    low, high = placed.min(axis=0).tolist(), placed.max(axis=0).tolist()
    return Bounds((low[0], low[1], low[2]), (high[0], high[1], high[2]))


def _below(memory: Memory, top: Node, types: Types) -> Iterator[Node]:
    """A node and all whose chain of frames leads through it, each once."""
    seen = {top.name}
    waiting = [top]
    while waiting:
        node = waiting.pop()
        yield node
        for edge in memory.edges(src=node.name):
            child = memory.get_node(edge.dst)
            if (
                child is not None
                and child.name not in seen
                and _is_parent(memory, edge.src, edge.dst, edge.type, types)
            ):
                seen.add(child.name)
                waiting.append(child)


def _is_parent(memory: Memory, parent: str, child: str, type: str, types: Types) -> bool:
    """Whether the frame `child` is where an edge of this type from `parent` says, rather than another one."""
    if type not in types:
        return False
    stronger = types[: types.index(type)]
    return not any(edge.type in stronger for edge in memory.edges(dst=child))


def _hashes(node: Node) -> tuple[str, ...]:
    try:
        return mesh_hashes(node)
    except SchemaError:
        return ()
