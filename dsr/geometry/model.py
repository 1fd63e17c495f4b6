"""Models: meshes in a hierarchy of frames, as files have them, in the terms of our graph: metres, rigid poses, z up."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr.errors import MeshError
from dsr.geometry.mesh import Bounds, Mesh, joined_bounds
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

Array = NDArray[np.float64]

MOST_NODES = 5_000
"""Nodes that one model may have."""
MOST_TRIANGLES = 1 << 24
"""Triangles that one model may have, those of a mesh counted again for each of its sizes: as many as fit into a file of
256 MiB.
"""
_DIGITS = 9  # of a factor of scale: instances that differ by rounding alone shall have one mesh
_FARTHEST = 1e5  # m, of a vertex from the frame of its node
_LEAST_SCALE = 1e-9
_MOST_LETTERS = 100


class Geometry(NamedTuple):
    """Triangles as a file has them."""

    vertices: Array
    """Vertices (n, 3) in the file's unit."""
    triangles: NDArray[Any]
    """(m, 3) indices"""


@dataclass
class RawNode:
    """A node as a file has it, in the file's unit, with any affine matrix."""

    name: str
    matrix: Array = field(default_factory=lambda: np.eye(4))
    """(4, 4) parent_from_node"""
    geometry: list[Geometry] = field(default_factory=list)
    children: list[RawNode] = field(default_factory=list)


class ModelNode(NamedTuple):
    """A frame with what is in it."""

    name: str
    """Unique in its model, and fit for a node of the graph."""
    parent: str | None
    """Name of the parent node; None for the root."""
    pose: Pose
    """parent_from_node; for the root, where it is in the frame of the file."""
    meshes: tuple[Mesh, ...]

    @property
    def bounds(self) -> Bounds | None:
        """The box around its own meshes, in its frame."""
        return joined_bounds(mesh.bounds for mesh in self.meshes)


@dataclass(frozen=True)
class Model:
    """The content of a model file: nodes with their hierarchy and meshes."""

    nodes: tuple[ModelNode, ...]
    """The root first, each parent before its children."""
    warnings: tuple[str, ...] = ()
    """Parts of the file that could not be used, in words."""

    @property
    def root(self) -> ModelNode:
        """Under which all others are."""
        return self.nodes[0]

    @property
    def meshes(self) -> tuple[Mesh, ...]:
        """All meshes of the model, each once."""
        return tuple({mesh.hash: mesh for node in self.nodes for mesh in node.meshes}.values())

    def merged(self, centre: Vector3 = (0.5, 0.5, 0.5)) -> Model:
        """All of it as one upright node, its frame at `centre` of the bounding box (0: least, 1: greatest x, y, z)."""
        file_from: dict[str, Pose] = {}
        placed: list[tuple[Array, Mesh]] = []
        for node in self.nodes:
            file_from[node.name] = node.pose if node.parent is None else file_from[node.parent] @ node.pose
            matrix = file_from[node.name].matrix
            for mesh in node.meshes:
                placed.append((mesh.vertices.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3], mesh))
        low = np.min([points.min(axis=0) for points, _ in placed], axis=0)
        high = np.max([points.max(axis=0) for points, _ in placed], axis=0)
        middle = low + np.array(centre) * (high - low)
        meshes = tuple(Mesh(points - middle, mesh.triangles) for points, mesh in placed)
        x, y, z = middle.tolist()
        return Model((self.root._replace(pose=Pose((x, y, z)), meshes=meshes),), self.warnings)


def to_model(tops: Sequence[RawNode], name: str, metres: Array, warnings: Iterable[str] = ()) -> Model:
    """The model of a file whose outermost nodes are `tops`; `name` is for the root if there are several.

    Args:
        tops: in the file's unit and orientation.
        name: of the file.
        metres: (4, 4) from there to metres with z up.
        warnings: to be passed on.

    Raises:
        MeshError: without any triangle, with too many nodes, or matrices that are singular or not finite.
    """
    root = tops[0] if len(tops) == 1 else RawNode(name, children=list(tops))
    found = list(itertools.islice(_walk(root), MOST_NODES + 1))
    if len(found) > MOST_NODES:
        raise MeshError(f"more than {MOST_NODES} nodes")
    names = _unique_names(raw.name or (name if parent is None else "") for raw, parent in found)
    meshes_of = _Meshes()
    file_from: list[Array] = []
    frames: list[Pose] = []
    nodes: list[ModelNode] = []
    for index, (raw, parent) in enumerate(found):
        file_from.append((metres if parent is None else file_from[parent]) @ raw.matrix)
        rigid, rest = _split(file_from[index], raw.name)
        frames.append(rigid)
        pose = rigid if parent is None else frames[parent].inverse() @ rigid
        meshes = tuple(mesh for piece in raw.geometry if (mesh := meshes_of(piece, rest)) is not None)
        nodes.append(ModelNode(names[index], None if parent is None else names[parent], pose, meshes))
    if not any(node.meshes for node in nodes):
        raise MeshError("no triangles")
    return Model(tuple(nodes), tuple(warnings))


def _walk(root: RawNode) -> Iterator[tuple[RawNode, int | None]]:
    """All nodes with the place of their parent in this order; what a file uses twice comes twice."""
    waiting: list[tuple[RawNode, int | None]] = [(root, None)]
    for index in itertools.count():
        if index == len(waiting):
            return
        raw, parent = waiting[index]
        yield raw, parent
        waiting += [(child, index) for child in raw.children]


def _split(matrix: Array, name: str) -> tuple[Pose, Array]:
    """A rigid frame at the place of an affine one, and what of that it leaves to the vertices (3, 3).

    By the polar decomposition, so that the frame is the closest rotation; a mirrored frame is not, its vertices are.
    """
    linear = matrix[:3, :3]
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise MeshError(f"node {name!r}: a matrix that is not finite")
    left, scales, right = np.linalg.svd(linear)
    if scales[2] < _LEAST_SCALE:
        raise MeshError(f"node {name!r}: a matrix that flattens what is below it")
    if np.linalg.det(left @ right) < 0.0:
        left[:, 2] *= -1.0
    rotation = left @ right
    rest = np.round(rotation.T @ linear, _DIGITS)
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = rotation, matrix[:3, 3]
    return Pose.from_matrix(frame), rest


class _Meshes:
    """Makes meshes of pieces, each once however often a file uses it. Raises `MeshError` for too many triangles."""

    def __init__(self) -> None:
        self._made: dict[tuple[int, int, bytes], Mesh | None] = {}
        self._pieces: list[Geometry] = []  # which live as long, so that their ids are theirs
        self._triangles = 0

    def __call__(self, piece: Geometry, rest: Array) -> Mesh | None:
        key = (id(piece.vertices), id(piece.triangles), rest.tobytes())
        if key not in self._made:
            self._triangles += len(piece.triangles)
            if self._triangles > MOST_TRIANGLES:
                raise MeshError(f"more than {MOST_TRIANGLES} triangles")
            self._pieces.append(piece)
            self._made[key] = _mesh(piece, rest)
        return self._made[key]


def _mesh(piece: Geometry, rest: Array) -> Mesh | None:
    """The mesh of a piece: vertices at one place are one, and triangles without area are left out."""
    vertices = np.asarray(piece.vertices, dtype=np.float64).reshape(-1, 3)
    triangles = np.asarray(piece.triangles, dtype=np.int64).reshape(-1, 3)
    if not len(triangles):
        return None
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise MeshError(f"a triangle of vertex {triangles.max()}; there are {len(vertices)}")
    if not np.isfinite(vertices).all():
        raise MeshError("a vertex that is not finite")
    if np.linalg.det(rest) < 0.0:
        triangles = triangles[:, ::-1]
    with np.errstate(over="ignore"):
        points = (vertices @ rest.T).astype(np.float32) + np.float32(0.0)
    farthest = float(np.abs(points).max())
    if _FARTHEST < farthest < np.inf:
        raise MeshError(f"a vertex {farthest:g} m from the middle; at most {_FARTHEST:g}: is the scale right?")
    used, corners = np.unique(points[triangles.ravel()], axis=0, return_inverse=True)
    corners = corners.reshape(-1, 3)
    a, b, c = corners.T
    corners = corners[(a != b) & (b != c) & (c != a)]
    return Mesh(used, corners) if len(corners) else None


def _unique_names(names: Iterable[str]) -> list[str]:
    """Names that nodes can have, each once."""
    taken: dict[str, None] = {}
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_.-]", "_", name)[:_MOST_LETTERS].lstrip(".") or "node"
        numbered = (plain if number == 1 else f"{plain}_{number}" for number in itertools.count(1))
        taken[next(candidate for candidate in numbered if candidate not in taken)] = None
    return list(taken)
