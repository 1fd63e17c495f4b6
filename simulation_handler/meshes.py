"""What meshes are in the simulation: the convex hull of each connected piece, thinned out to few corners."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from dsr.errors import SchemaError
from dsr.geometry import Bounds, Mesh, mesh_hashes
from dsr.geometry.mesh import joined_bounds
from dsr.memory import Memory
from dsr.quaternions import Vector3
from dsr.shapes import MOST_PARTS, Part, Shape

Points = NDArray[np.float64]

_MOST_CORNERS = 64  # of a hull
_THINNEST = 0.001  # m
_HOLLOW = 0.03  # of the diagonal that a surface may be inside of its hull
_MOST_KEPT = 256  # forms
_MOST_LOOKED_AT = 5000  # points of a surface


class Form(NamedTuple):
    """A body made of meshes."""

    bounds: Bounds
    """In the frame of its node."""
    shape: Shape
    """Its convex pieces, in the frame at the centre of the bounds."""
    is_convex: bool
    """Whether each piece is its own hull, or nearly; a hollow one is filled in the simulation."""

    @property
    def centre(self) -> Vector3:
        """Of the bounds, m."""
        x, y, z = ((low + high) / 2 for low, high in zip(*self.bounds, strict=True))
        return x, y, z

    @property
    def size(self) -> Vector3:
        """Edge lengths of the bounding box, m; a flat one has the least thickness that can be simulated."""
        x, y, z = (max(high - low, _THINNEST) for low, high in zip(*self.bounds, strict=True))
        return x, y, z


class Forms:
    """The forms of nodes with meshes; those that are not here yet are asked for."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._known: dict[tuple[str, ...], Form] = {}

    def of(self, node: Mapping[str, Any]) -> Form | None:
        """The form of a node; None without meshes, or until they are here. Raises `SchemaError`."""
        hashes = mesh_hashes(node)
        if not hashes:
            return None
        if hashes not in self._known:
            meshes = [mesh for hash in hashes if (mesh := self._memory.get_mesh(hash)) is not None]
            if len(meshes) < len(hashes):
                return None
            if len(self._known) >= _MOST_KEPT:
                self._known.clear()
            self._known[hashes] = form_of(meshes)
        return self._known[hashes]


def form_of(meshes: list[Mesh]) -> Form:
    """The form of a body made of these meshes.

    Of more than 16 pieces, each mesh is one; of more than 16 meshes, all are one.
    """
    bounds = joined_bounds(mesh.bounds for mesh in meshes)
    if bounds is None:
        raise SchemaError("a body without meshes has no form")
    pieces = [piece for mesh in meshes for piece in _connected(mesh)]
    if len(pieces) > MOST_PARTS:
        pieces = [mesh.vertices[mesh.triangles.ravel()].astype(np.float64) for mesh in meshes]
    if len(pieces) > MOST_PARTS:
        pieces = [np.concatenate(pieces)]
    centre = (np.array(bounds.low) + bounds.high) / 2.0
    hulls = [_hull(piece) for piece in pieces]
    surface = np.concatenate([mesh.vertices[mesh.triangles].mean(axis=1) for mesh in meshes]).astype(np.float64)
    deepest = _depth(surface[:: len(surface) // _MOST_LOOKED_AT + 1], hulls)
    return Form(bounds, tuple(_part(hull, centre) for hull in hulls), deepest <= _HOLLOW * math.dist(*bounds))


def _connected(mesh: Mesh) -> list[Points]:
    """The vertices of each connected piece, or all if there are too many.

    Triangles are connected where just two of them share an edge: pieces that only touch have edges of four. Vertices at
    one place are one.
    """
    places, index = np.unique(mesh.vertices[mesh.triangles.ravel()], axis=0, return_inverse=True)
    triangles = index.reshape(-1, 3)
    points = places.astype(np.float64)
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    _, first, sharing = np.unique(edges[order], axis=0, return_index=True, return_counts=True)
    pairs = first[sharing == 2]
    ends = order[pairs] // 3, order[pairs + 1] // 3
    graph = coo_array((np.ones(len(pairs)), ends), shape=(len(triangles), len(triangles)))
    count, labels = connected_components(graph, directed=False)
    if count > MOST_PARTS:
        return [points]
    return [points[np.unique(triangles[labels == label])] for label in range(count)]


def _hull(points: Points) -> Points:
    """Corners of the convex hull, at most 64: the farthest in as many directions; a flat one is made a thin box."""
    low, high = points.min(axis=0), points.max(axis=0)
    try:
        corners = points[ConvexHull(points).vertices] if (high - low).min() >= _THINNEST else None
    except QhullError:
        corners = None
    if corners is None:
        middle, half = (low + high) / 2.0, np.maximum((high - low) / 2.0, _THINNEST / 2.0)
        signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        return np.asarray(middle + signs * half)
    if len(corners) <= _MOST_CORNERS:
        return np.asarray(corners)
    farthest = np.unique((corners @ _DIRECTIONS.T).argmax(axis=0))
    return np.asarray(corners[farthest])


def _depth(surface: Points, hulls: list[Points]) -> float:
    """How far (m) the deepest of the points (n, 3) is inside of the hull next to it: 0 if all pieces are convex."""
    depths = np.full(len(surface), np.inf)
    for hull in hulls:
        planes = ConvexHull(hull).equations
        inside = -(surface @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        near = inside > -_THINNEST
        depths[near] = np.minimum(depths[near], np.maximum(inside[near], 0.0))
    found = depths[np.isfinite(depths)]
    return float(found.max(initial=0.0))


def _part(hull: Points, centre: Points) -> Part:
    """A hull as a part of a body: its box, and its corners in that."""
    low, high = hull.min(axis=0), hull.max(axis=0)
    middle = (low + high) / 2.0
    x, y, z = np.maximum(high - low, _THINNEST).tolist()
    at_x, at_y, at_z = (middle - centre).tolist()
    return Part("box", (x, y, z), (at_x, at_y, at_z), corners=tuple(map(tuple, (hull - middle).tolist())))


def _spread(count: int) -> Points:
    """Directions that cover the sphere evenly: the six axes, and a golden spiral."""
    index = np.arange(count)
    height = 1.0 - (2.0 * index + 1.0) / count
    angle = index * math.pi * (3.0 - math.sqrt(5.0))
    across = np.sqrt(1.0 - height**2)
    spiral = np.column_stack([across * np.cos(angle), across * np.sin(angle), height])
    return np.concatenate([np.eye(3), -np.eye(3), spiral])


_DIRECTIONS = _spread(_MOST_CORNERS - 6)
