"""Bodies that can be seen in a world, or hide others: things, tables, parts of robots and persons, and meshes."""

from __future__ import annotations

import itertools
import math
import operator
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dsr.errors import DsrError, SchemaError
from dsr.frames.tree import BELIEVED, WORLD
from dsr.geometry import own_bounds
from dsr.graph.elements import Node
from dsr.graph.schema import RECORDS
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Part, Shape, box, from_numbers
from dsr.math3d.surfaces import Solids
from dsr.math3d.transforms import Array, Pose
from dsr.memory import Memory
from dsr.visibility.persons import HEAD, TRUNK, upright
from dsr.visibility.perspectives import PERSON
from dsr.visibility.picture import Body
from dsr.vocabulary.perceived import is_perceived
from dsr.vocabulary.relations import MODELLED, SURFACES, THINGS, is_present

_FARTHEST = 1e4  # m from the world's origin, or across: what is said to be beyond is nowhere
_FLAT = 2  # axes along which a mesh has an extent, at least
_HAND = Part("box", (0.19, 0.095, 0.04), (0.03, 0.0, 0.0))
"""What a hand hides, palm and fingers: x towards the fingers, z out of the back."""


class Posed(NamedTuple):
    """The form that a node tells, and its pose in the world."""

    name: str
    kind: str
    """Type of the node."""
    shape: Shape
    """Parts of the node's shape, in its frame."""
    meshes: str
    """Hashes, comma-separated; with any, the parts are only what stands for them."""
    matrix: Array
    """(4, 4) world_from_node"""

    @property
    def is_thing(self) -> bool:
        """Whether the node can be moved, and is looked for."""
        return self.kind in (*THINGS, *MODELLED)


def read_posed(memory: Memory) -> list[Posed]:
    """All that has a form and a place, by name; what is believed to have left the scene is nowhere.

    A person is two: the head, which turns with the eyes, and the trunk, which stands upright.
    """
    formed = []
    now = memory.clock.now()
    for node in memory.nodes():
        if node.type not in RECORDS and (shape := _shape_of(memory, node, now)) is not None:
            formed.append((node, shape))
    formed.sort(key=lambda pair: pair[0].name)
    if not formed:
        return []
    matrices = memory.transforms(WORLD, [node.name for node, _ in formed], types=BELIEVED)
    found = []
    for (node, shape), matrix in zip(formed, matrices, strict=True):
        if math.isfinite(float(matrix.sum())) and float(np.abs(matrix[:3, 3]).max()) < _FARTHEST:
            found.append(Posed(node.name, node.type, shape, node.get("mesh", ""), matrix))
            if shape is HEAD and "mesh" not in node:
                found.append(Posed(node.name, node.type, TRUNK, "", upright(matrix)))
    return found


def bodies_of(memory: Memory, posed: Sequence[Posed]) -> list[Body]:
    """These as bodies in the world; a mesh that is not here yet is the box around it, and is asked for."""
    groups = (list(group) for _, group in itertools.groupby(posed, key=lambda one: one.name))
    return [_joined([_body(memory, one) for one in group]) for group in groups]


def placed(name: str, shape: Shape, world_from_body: Pose) -> Body:
    """A body of a shape, somewhere in the world."""
    return Body(name, Solids.of(shape).moved(world_from_body.matrix))


def body_at(memory: Memory, node: Node, world_from_node: Pose) -> Body | None:
    """A thing of a memory, somewhere in the world; None while nothing tells its form."""
    shape = _form_of(memory, node)
    if shape is None:
        return None
    return _body(memory, Posed(node.name, node.type, shape, node.get("mesh", ""), world_from_node.matrix))


def shape_of_thing(node: Node) -> Shape | None:
    """The parts of a thing, in its frame; None if it does not tell."""
    if "shape" in node:
        try:
            return from_numbers(node["shape"])
        except SchemaError:
            return None
    size = node.get("size")
    return box(size) if _is_size(size) else None


def _joined(bodies: list[Body]) -> Body:
    """The parts of what has one name as one body."""
    if len(bodies) == 1:
        return bodies[0]
    columns = zip(*(body.solids for body in bodies), strict=True)
    return bodies[0]._replace(solids=Solids(*map(np.concatenate, columns)))


def _shape_of(memory: Memory, node: Node, now: float) -> Shape | None:
    if not is_present(node) or (node.type == PERSON and not is_perceived(node, now)):
        return None
    size = node.get("size")
    if node.type in SURFACES and _is_size(size):
        return (Part("box", size, (0.0, 0.0, -0.5 * size[2])),)
    if node.type == "hand" and node.get("perceived") is not False:
        return (_HAND,)
    return _form_of(memory, node) or (HEAD if node.type == PERSON else None)


def _form_of(memory: Memory, node: Node) -> Shape | None:
    """What a node says of its form, or a box in place of its meshes."""
    if node.type in THINGS:
        return shape_of_thing(node) or _around_mesh(memory, node)
    return _around_mesh(memory, node) if "mesh" in node else _within_bounds(node.get("bounds"))


def _within_bounds(bounds: object) -> Shape | None:
    if not isinstance(bounds, tuple) or len(bounds) != 6 or not all(map(operator.lt, bounds[:3], bounds[3:])):
        return None
    return _box(bounds[:3], bounds[3:])


def _around_mesh(memory: Memory, node: Node) -> Shape | None:
    """A box in place of the meshes of a node, which may be flat; None without any, or while nothing tells how large."""
    around = own_bounds(memory, node) if "mesh" in node else None
    if around is None or sum(map(operator.lt, around.low, around.high)) < _FLAT:
        return None
    return _box(around.low, around.high)


def _box(low: Vector3, high: Vector3) -> Shape:
    x, y, z = (b - a for a, b in zip(low, high, strict=True))
    u, v, w = (0.5 * (a + b) for a, b in zip(low, high, strict=True))
    return (Part("box", (x, y, z), (u, v, w)),)


def _is_size(size: object) -> bool:
    return isinstance(size, tuple) and len(size) == 3 and min(size) > 0.0 and max(size) < _FARTHEST


def _body(memory: Memory, posed: Posed) -> Body:
    triangles = _triangles(memory, posed) if posed.meshes else None
    if triangles is None:
        return Body(posed.name, Solids.of(posed.shape).moved(posed.matrix))
    return Body(posed.name, Solids.of(()), triangles)


def _triangles(memory: Memory, posed: Posed) -> Array | None:
    """(m, 3, 3) m in the world; None while one of its meshes is not here."""
    corners = []
    for digest in filter(None, posed.meshes.split(",")):
        try:
            mesh = memory.get_mesh(digest)
        except DsrError:
            return None
        if mesh is None:
            return None
        vertices = mesh.vertices.astype(np.float64) @ posed.matrix[:3, :3].T + posed.matrix[:3, 3]
        corners.append(vertices[mesh.triangles])
    return np.concatenate(corners) if corners else None
