"""The flesh of a human hand: one smooth surface about its bones, and how it bends with them.

A hand at rest, fingers straight, is the smooth union of tapered pieces about the bones (I. Quilez's polynomial minimum
of signed distances). Its surface is drawn once from a grid (S. Gibson, "Constrained elastic surface nets", 1998). In
another figure each of its points goes with the bones that it is near (linear blend skinning). So that joints keep their
thickness, points also go with the middle between the two bones of a joint. All is in the frame and the order of
hand_figure.py.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.plant.hand_figure import BONES, JOINTS, Side, joints, outstretched

Array = NDArray[np.float64]
Faces = NDArray[np.int32]

FOREARM = 0.035
"""m of forearm that the surface covers, under the sleeve"""
_CELL = 0.0035  # m, of the grid: a fingertip is four cells wide
_MARGIN = 0.03  # m, of the grid about the bones: the flesh is less thick
_BLOCK = 4  # cells along each side of a block in which distances are not asked for one by one if it is far away
_BLEND = 0.007  # m, within which two pieces of flesh grow together
_NEAR = 4  # power of the inverse distance by which a point goes with a bone: a neighbouring finger takes 3 % of it
_PALM = 0  # the bone that all that is rigid in the palm goes with
_WRIST_HALF = 0.012  # m, from the wrist's middle to that of each of the two pieces that make it broader than deep
_RADII = np.array([
    0.013,
    0.0140, 0.0105, 0.0088, 0.0078,
    0.0115, 0.0090, 0.0083, 0.0072,
    0.0118, 0.0092, 0.0085, 0.0073,
    0.0112, 0.0088, 0.0080, 0.0070,
    0.0105, 0.0078, 0.0071, 0.0064,
])  # fmt: skip
"""(21,) m, of the flesh around each joint of a common hand."""


class Flesh(NamedTuple):
    """The surface of a right or left hand."""

    vertices: Array
    """(n, 3) m, in the palm's frame"""
    normals: Array
    """(n, 3) unit vectors, outwards"""
    faces: Faces
    """(m, 3) corners, anticlockwise seen from outside"""


class _Pieces(NamedTuple):
    """Tapered pieces with round ends."""

    starts: Array
    ends: Array
    radii: Array
    """(p, 2) m, at both ends"""
    groups: NDArray[np.int64]
    """(p,) pieces of one group are joined without growing together: those of one finger"""


@lru_cache(maxsize=4)
def at_rest(side: Side) -> Flesh:
    """The surface of a hand with fingers straight and apart."""
    if side == "left":
        right = at_rest("right")
        mirror = np.array([1.0, -1.0, 1.0])
        return Flesh(right.vertices * mirror, right.normals * mirror, right.faces[:, ::-1].copy())
    pieces = _pieces(outstretched("right"))
    low = np.minimum(pieces.starts, pieces.ends).min(axis=0) - _MARGIN
    high = np.maximum(pieces.starts, pieces.ends).max(axis=0) + _MARGIN
    vertices, faces = surface_net(_on_grid(pieces, low, high))
    vertices = low + _CELL * vertices
    for _ in range(2):  # on to the surface itself
        vertices = vertices - _distance(pieces, vertices)[:, None] * _gradient(pieces, vertices)
    return Flesh(vertices, _gradient(pieces, vertices), faces)


def flesh(tips: Array, side: Side) -> Flesh:
    """The surface of a hand whose fingertips (5, 3) are there, in the palm's frame."""
    rest = at_rest(side)
    before, after = outstretched(side), joints(tips, side)
    turns, places = _moves(before, after)
    weights = _weights(side)
    linear = np.tensordot(weights, turns, axes=1)
    moved = np.einsum("nij,nj->ni", linear, rest.vertices) + weights @ places
    normals = np.einsum("nij,nj->ni", linear, rest.normals)
    return Flesh(moved, normals / np.linalg.norm(normals, axis=1, keepdims=True), rest.faces)


def _on_grid(pieces: _Pieces, low: Array, high: Array) -> Array:
    """(i, j, k) m, distances at a grid from a corner on; far from the surface, those of the middle of a block."""
    blocks = np.ceil((high - low) / (_BLOCK * _CELL)).astype(int)
    middles = low + _CELL * (_BLOCK * np.indices(tuple(blocks.tolist())).reshape(3, -1).T + (_BLOCK - 1) / 2)
    coarse = _distance(pieces, middles).reshape(blocks)
    found = coarse.repeat(_BLOCK, 0).repeat(_BLOCK, 1).repeat(_BLOCK, 2)
    near = np.argwhere(np.abs(found) < _BLOCK * _CELL)
    found[tuple(near.T)] = _distance(pieces, low + _CELL * near)
    return np.asarray(found)


def surface_net(distances: Array) -> tuple[Array, Faces]:
    """Vertices (n, 3), in cells, and triangles (m, 3) of the surface on which distances (i, j, k) at a grid are zero.

    A vertex lies in each cell that the surface crosses, in the middle of where it crosses the cell's edges.
    """
    inside = distances < 0.0
    shape = np.array(distances.shape) - 1
    total, count = np.zeros((*shape, 3)), np.zeros(shape)
    for axis in range(3):
        low, high = _halves(inside, axis)
        near, far = _halves(distances, axis)
        crosses = low != high
        share = np.where(crosses, near / np.where(crosses, near - far, 1.0), 0.0)
        for du in (0, 1):
            for dv in (0, 1):
                window, offset = _beside(shape, axis, du, dv)
                there = crosses[window]
                count += there
                total[..., axis] += np.where(there, share[window], 0.0)
                total += there[..., None] * offset
    index = np.full(shape, -1)
    crossed = count > 0
    index[crossed] = np.arange(crossed.sum())
    vertices = np.argwhere(crossed) + total[crossed] / count[crossed][:, None]
    return vertices, np.concatenate([_quads(inside, index, axis) for axis in range(3)]).astype(np.int32)


def _halves(values: NDArray[Any], axis: int) -> tuple[NDArray[Any], NDArray[Any]]:
    return np.take(values, range(values.shape[axis] - 1), axis), np.take(values, range(1, values.shape[axis]), axis)


def _beside(shape: Array, axis: int, du: int, dv: int) -> tuple[tuple[slice, ...], Array]:
    """Of the edges along an axis, those that bound each cell at one of its four places, and that place."""
    window, offset, steps = [], np.zeros(3), iter((du, dv))
    for other in range(3):
        step = 0 if other == axis else next(steps)
        window.append(slice(step, step + int(shape[other])))
        offset[other] = step
    return tuple(window), offset


def _quads(inside: NDArray[np.bool_], index: NDArray[np.int64], axis: int) -> NDArray[np.int64]:
    """Two triangles across each inner edge along an axis that leaves or enters the flesh."""
    low, high = _halves(inside, axis)
    u, v = (axis + 1) % 3, (axis + 2) % 3
    edges = np.argwhere(low != high)
    limits = np.array(index.shape)
    edges = edges[(edges[:, u] > 0) & (edges[:, v] > 0) & (edges[:, u] < limits[u]) & (edges[:, v] < limits[v])]
    corners = []
    for du, dv in ((1, 1), (0, 1), (0, 0), (1, 0)):
        cell = edges.copy()
        cell[:, u] -= du
        cell[:, v] -= dv
        corners.append(index[tuple(cell.T)])
    a, b, c, d = corners
    outwards = low[tuple(edges.T)][:, None]
    first = np.where(outwards, np.column_stack([a, b, c]), np.column_stack([a, c, b]))
    second = np.where(outwards, np.column_stack([a, c, d]), np.column_stack([a, d, c]))
    return np.concatenate([first, second])


def _pieces(points: Array) -> _Pieces:
    """Of a right hand with joints (21, 3)."""
    starts, ends, radii, groups = [], [], [], []

    def add(start: Array, end: Array, first: float, last: float, group: int) -> None:
        starts.append(start)
        ends.append(end)
        radii.append((first, last))
        groups.append(group)

    for a, b in BONES:
        if a == 0:
            add(points[a], points[b], _RADII[a], _RADII[b], len(groups))
        else:
            add(points[a], points[b], _RADII[a], _RADII[b], 100 + (a - 1) // 4)
    back = np.array([-1.0, 0.0, 0.0])
    for y in (-_WRIST_HALF, _WRIST_HALF):
        wrist = points[0] + (0.0, y, 0.0)
        add(wrist, wrist + FOREARM * back - (0.0, 0.5 * y, 0.0), 0.0165, 0.014, len(groups))
    below = np.array([0.0, 0.0, -0.006])
    # the ball of the thumb, that of the little finger, and the web between thumb and index finger
    add(points[1] + (0.004, 0.0, -0.004), 0.6 * points[2] + 0.4 * points[5], 0.0135, 0.0085, len(groups))
    add(points[0] + (0.012, -0.014, -0.006), points[17] + (-0.012, -0.002, -0.006), 0.0125, 0.0105, len(groups))
    add(0.3 * points[1] + 0.7 * points[2], 0.5 * points[5] + 0.5 * points[0], 0.0085, 0.0085, len(groups))
    for k in (5, 9, 13):
        add(points[k] + below, points[k + 4] + below, 0.0085, 0.0085, len(groups))
    return _Pieces(np.array(starts), np.array(ends), np.array(radii), np.array(groups))


def _distance(pieces: _Pieces, points: Array) -> Array:
    """(n,) m, signed, from the flesh: negative inside."""
    found: Array | None = None
    for group in np.unique(pieces.groups):
        own = np.full(len(points), np.inf)
        for k in np.flatnonzero(pieces.groups == group):
            along = pieces.ends[k] - pieces.starts[k]
            share = np.clip((points - pieces.starts[k]) @ along / (along @ along), 0.0, 1.0)
            gap = points - pieces.starts[k] - share[:, None] * along
            near, far = pieces.radii[k]
            own = np.minimum(own, np.sqrt(np.einsum("ij,ij->i", gap, gap)) - near - share * (far - near))
        found = own if found is None else _grown_together(found, own)
    assert found is not None
    return found


def _grown_together(a: Array, b: Array) -> Array:
    share = np.clip(0.5 + 0.5 * (b - a) / _BLEND, 0.0, 1.0)
    return np.asarray(b + (a - b) * share - _BLEND * share * (1.0 - share))


def _gradient(pieces: _Pieces, points: Array) -> Array:
    step = 2e-4  # m, a tenth of a cell
    slopes = [_distance(pieces, points + step * axis) - _distance(pieces, points - step * axis) for axis in np.eye(3)]
    gradient = np.column_stack(slopes)
    return np.asarray(gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-12))


_FINGER_BONES = tuple(bone for bone in BONES if bone[0] != 0)
_BENT_JOINTS = tuple(joint for joint in range(1, JOINTS) if joint % 4 != 0)
"""Joints that bend: all but wrist and fingertips."""


def _moves(before: Array, after: Array) -> tuple[Array, Array]:
    """Linear maps (m, 3, 3) and shifts (m, 3) of the palm, of the bones of fingers, and of the joints that bend."""
    turns, places = [np.eye(3)], [np.zeros(3)]
    halves: dict[int, Array] = {}
    turn = np.eye(3)
    for a, b in _FINGER_BONES:
        parent = np.eye(3) if (a - 1) % 4 == 0 else turn
        was, now = before[b] - before[a], after[b] - after[a]
        length = float(np.linalg.norm(was))
        bend = _turn_between(parent @ was, now)
        turn = bend @ parent
        halves[a] = _turn_between(parent @ was, _unit(parent @ was) + _unit(now)) @ parent
        longer = np.eye(3) + (float(np.linalg.norm(now)) / length - 1.0) * np.outer(was, was) / length**2
        turns.append(turn @ longer)
        places.append(after[a] - turns[-1] @ before[a])
    for joint in _BENT_JOINTS:
        turns.append(halves[joint])
        places.append(after[joint] - halves[joint] @ before[joint])
    return np.array(turns), np.array(places)


@lru_cache(maxsize=4)
def _weights(side: Side) -> Array:
    """(n, m) by which each vertex goes with each of the moves."""
    points, vertices = outstretched(side), at_rest(side).vertices
    palm = np.min([_to_segment(vertices, points[a], points[b]) for a, b in BONES if a == 0], axis=0)
    wrist = np.linalg.norm(vertices - points[0], axis=1)
    palm = np.where(vertices[:, 0] < points[0, 0], np.minimum(palm, np.minimum(wrist, 0.012)), palm)
    gaps = [palm]
    gaps += [_to_segment(vertices, points[a], points[b]) for a, b in _FINGER_BONES]
    gaps += [np.linalg.norm(vertices - points[joint], axis=1) for joint in _BENT_JOINTS]
    near = 1.0 / np.maximum(np.array(gaps).T, 1e-4) ** _NEAR
    return np.asarray(near / near.sum(axis=1, keepdims=True))


def _to_segment(points: Array, start: Array, end: Array) -> Array:
    along = end - start
    share = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - start - share[:, None] * along, axis=1))


def _turn_between(a: Array, b: Array) -> Array:
    """(3, 3) the least rotation of a direction to another one that is not opposite."""
    a, b = _unit(a), _unit(b)
    axis, cosine = np.cross(a, b), float(a @ b)
    x, y, z = axis
    skewed = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + skewed + skewed @ skewed / max(1.0 + cosine, 1e-9))


def _unit(vector: Array) -> Array:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-12))
