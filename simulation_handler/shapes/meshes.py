"""Meshes in the simulation: convex hulls of few corners, of each connected piece or of its convex parts.

SciPy is imported where it is used: that takes 0.4 s, for which scenes without meshes need not wait.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr.errors import SchemaError
from dsr.geometry import Bounds, Mesh, mesh_hashes
from dsr.geometry.mesh import joined_bounds
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import MOST_PARTS, Part, Shape
from dsr.memory import Memory
from dsr.perception.scales import RESOLUTION
from simulation_handler.shapes.decomposing import decomposed

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

Points = NDArray[np.float64]

_MOST_CORNERS = 64  # of a hull
_HOLLOW = 0.15  # of the volume of its hull that may be empty in what counts as convex
_FILLED = 0.3  # of what is empty that parts may fill
_ON = 0.002  # of its diagonal that a surface may be inside of the hull that it is on


class Form(NamedTuple):
    """A body made of meshes."""

    bounds: Bounds
    """Bounds of the body in the frame of its node, m."""
    shape: Shape
    """Convex pieces, in the frame at the centre of the bounds."""
    is_true: bool
    """Whether the parts leave the hollows of the surface empty; else a hollow is filled."""

    @property
    def centre(self) -> Vector3:
        """Centre of the bounds, m, in the mesh's frame."""
        x, y, z = ((low + high) / 2 for low, high in zip(*self.bounds, strict=True))
        return x, y, z

    @property
    def size(self) -> Vector3:
        """Edge lengths of the bounding box, m; a flat one has the least thickness that can be simulated."""
        x, y, z = (max(high - low, RESOLUTION) for low, high in zip(*self.bounds, strict=True))
        return x, y, z


class _NotHereError(Exception):
    """A mesh that is not here yet."""


class Forms:
    """The forms of nodes with meshes; those that are not here yet are asked for.

    Working one out may take seconds, so that is done in a thread, if the memory has threads.
    """

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._worker = ThreadPoolExecutor(1, "dsr-forms") if memory.meshes.threaded else None
        self._form = lru_cache(maxsize=256)(self._work_out)

    def of(self, node: Mapping[str, Any]) -> Form | None:
        """The form of a node; None without meshes, or until they are here. Raises `SchemaError`."""
        hashes = mesh_hashes(node)
        if not hashes:
            return None
        try:
            known = self._form(hashes)
        except _NotHereError:
            return None
        return known.result() if known.done() else None

    def close(self) -> None:
        """Work out no more."""
        if self._worker is not None:
            self._worker.shutdown(wait=False, cancel_futures=True)

    def _work_out(self, hashes: tuple[str, ...]) -> Future[Form]:
        meshes = [mesh for hash in hashes if (mesh := self._memory.get_mesh(hash)) is not None]
        if len(meshes) < len(hashes):
            raise _NotHereError
        if self._worker is not None:
            return self._worker.submit(form_of, meshes)
        done: Future[Form] = Future()
        done.set_result(form_of(meshes))
        return done


class _Piece(NamedTuple):
    """Triangles that belong together."""

    points: Points
    """(n, 3) m"""
    triangles: NDArray[np.int64]
    """(m, 3) indices"""


def form_of(meshes: list[Mesh]) -> Form:
    """The form of a body made of these meshes, from the convex hulls of their connected pieces.

    A mesh of more than 16 pieces counts as one piece. If there still are more than 16 in all, each mesh is one piece;
    of more than 16 meshes, all are one piece together. Hollow pieces are divided, as finely as 16 parts allow.

    Raises:
        SchemaError: if there is no mesh.
    """
    bounds = joined_bounds(mesh.bounds for mesh in meshes)
    if bounds is None:
        raise SchemaError("a body without meshes has no form")
    wholes = [_whole(mesh) for mesh in meshes]
    pieces = [piece for whole in wholes for piece in _connected(whole)]
    if len(pieces) > MOST_PARTS:
        pieces = wholes
    if len(pieces) > MOST_PARTS:
        first = np.cumsum([0, *(len(whole.points) for whole in wholes)])
        triangles = [whole.triangles + start for whole, start in zip(wholes, first, strict=False)]
        pieces = [_Piece(np.concatenate([whole.points for whole in wholes]), np.concatenate(triangles))]
    hulls: list[Points] = []
    is_true = True
    for number, piece in enumerate(pieces, start=1):
        outermost = _outermost(piece.points)
        found = [_hull(outermost)]
        if _is_filled(piece, outermost, found):
            divided = decomposed(*piece, MOST_PARTS - len(hulls) - (len(pieces) - number)) or found
            found = [_hull(part) for part in divided]
            is_true = is_true and not _is_filled(piece, outermost, found)
        hulls += found
    centre = (np.array(bounds.low) + bounds.high) / 2.0
    return Form(bounds, tuple(_part(hull, centre) for hull in hulls), is_true)


def _whole(mesh: Mesh) -> _Piece:
    """All of a mesh; vertices at one place are one."""
    places, index = np.unique(mesh.vertices, axis=0, return_inverse=True)
    used, corners = np.unique(index.ravel()[mesh.triangles], return_inverse=True)
    return _Piece(places[used].astype(np.float64), corners.reshape(-1, 3).astype(np.int64))


def _connected(whole: _Piece) -> list[_Piece]:
    """Its connected pieces, or all as one if there are too many.

    Triangles are connected where just two of them share an edge: pieces that only touch have edges of four.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    points, triangles = whole
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    keys = edges @ (len(points), 1)
    order = np.argsort(keys, kind="stable")
    _, first, sharing = np.unique(keys[order], return_index=True, return_counts=True)
    pairs = first[sharing == 2]
    ends = order[pairs] // triangles.shape[1], order[pairs + 1] // triangles.shape[1]
    graph = coo_array((np.ones(len(pairs)), ends), shape=(len(triangles), len(triangles)))
    count, labels = connected_components(graph, directed=False)
    if count > MOST_PARTS:
        return [whole]
    pieces = []
    for label in range(count):
        used, corners = np.unique(triangles[labels == label], return_inverse=True)
        pieces.append(_Piece(points[used], corners.reshape(-1, 3)))
    return pieces


def _hull(points: Points) -> Points:
    """Corners of the convex hull, at most 64: the farthest in as many directions; a flat one is made a thin box."""
    from scipy.spatial import ConvexHull, QhullError

    low, high = points.min(axis=0), points.max(axis=0)
    try:
        corners = points[ConvexHull(points).vertices] if (high - low).min() >= RESOLUTION else None
    except QhullError:
        corners = None
    if corners is None:
        middle, half = (low + high) / 2.0, np.maximum((high - low) / 2.0, RESOLUTION / 2.0)
        signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        return np.asarray(middle + signs * half)
    if len(corners) <= _MOST_CORNERS:
        return np.asarray(corners)
    return _farthest(corners, _DIRECTIONS)


def _outermost(points: Points) -> Points:
    """Those of many points that are farthest in any of 500 directions: their hull is that of all, nearly."""
    return points if len(points) <= len(_MANY_DIRECTIONS) else _farthest(points, _MANY_DIRECTIONS)


def _farthest(points: Points, directions: Points) -> Points:
    """The points that are farthest in these directions (n, 3)."""
    return np.asarray(points[np.unique([int((points @ direction).argmax()) for direction in directions])])


def _is_filled(piece: _Piece, outermost: Points, hulls: list[Points]) -> bool:
    """Whether these hulls fill too much of what is empty in the convex hull of a piece."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(outermost)
    except QhullError:
        return False  # flat
    if _is_on(piece, hull):
        return False
    a, b, c = np.moveaxis(piece.points[piece.triangles] - piece.points.mean(axis=0), 1, 0)
    volume = abs(float(np.einsum("ni,ni->", a, np.cross(b, c)))) / math.factorial(len(a.T))
    empty = hull.volume - volume
    filled = sum(ConvexHull(part).volume for part in hulls) - volume
    return empty > _HOLLOW * hull.volume and filled > _FILLED * empty


def _is_on(piece: _Piece, hull: ConvexHull) -> bool:
    """Whether a piece is closed and all of its surface on its hull: then it is convex, however its triangles turn."""
    edges = np.sort(piece.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, sharing = np.unique(edges @ (len(piece.points), 1), return_counts=True)
    if (sharing != 2).any():
        return False
    surface = piece.points[piece.triangles].mean(axis=1)
    surface = surface[:: len(surface) // len(_MANY_DIRECTIONS) + 1]
    depth = -(surface @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
    return float(depth.max()) <= _ON * math.dist(piece.points.min(axis=0), piece.points.max(axis=0))


def _part(hull: Points, centre: Points) -> Part:
    """A hull as a part of a body: its box, and its corners in that."""
    low, high = hull.min(axis=0), hull.max(axis=0)
    middle = (low + high) / 2.0
    x, y, z = np.maximum(high - low, RESOLUTION).tolist()
    at_x, at_y, at_z = (middle - centre).tolist()
    return Part("box", (x, y, z), (at_x, at_y, at_z), corners=tuple(map(tuple, (hull - middle).tolist())))


def _spread(count: int) -> Points:
    """Directions that cover the sphere evenly: the six axes, and a golden spiral."""
    index = np.arange(count)
    height = 1.0 - (2.0 * index + 1.0) / count
    golden = (1.0 + math.sqrt(5.0)) / 2.0  # 1, the golden ratio
    angle = index * 2.0 * math.pi / golden**2
    across = np.sqrt(1.0 - height**2)
    spiral = np.column_stack([across * np.cos(angle), across * np.sin(angle), height])
    return np.concatenate([np.eye(3), -np.eye(3), spiral])


# count 500: directions, beside the six axes; of too many points, those that are farthest in one of them are kept
_DIRECTIONS, _MANY_DIRECTIONS = _spread(_MOST_CORNERS - 6), _spread(500)
