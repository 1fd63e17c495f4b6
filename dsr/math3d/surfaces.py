"""Surfaces of shapes, and rays that meet them: the part of a body that can be seen from a point.

Arrays are numpy; lengths in metres. Rays are given by where they start and how far they go, so that a parameter of 1 is
their end.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr.math3d import quaternions
from dsr.math3d.boxes import CORNERS
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Part, PartKind, Shape, box

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

GAP = 5e-4
"""m before its end at which a ray counts as having arrived"""
_KINDS: tuple[PartKind, ...] = ("box", "cylinder", "sphere")
_LEAST = 1e-12  # stands for the direction cosine of a ray that is parallel to a face
_POINTS = 160  # on a body, about
_FINER = 16  # 1, finer points for each: four along each edge of the area that it stands for
_RIM = 0.25  # of the spacing of points, from which on a face gets a second row of them
_MOST = 64  # points in a row
_CACHED = 256  # shapes
_THIN, _VAST = 1e-5, 1e3  # m
_FACING = -0.1
"""Upward part of an outward normal, below which a face looks down. Side walls slide past what they touch."""
_SPACING = 3e-3
"""m between points of an underside: the thinnest walls that scenes may have are not missed."""
_MOST_BELOW = 20_000
"""Points of an underside: more would take longer than a look may."""
_AROUND = np.linspace(0.0, 2 * math.pi, 48, endpoint=False)
"""rad, where points lie on a rim: the lowest one is 0.2 % of the radius too high at most."""
_DEEPEST = 10.0
"""m that something falls at most: no table or floor of a room is farther below."""


class Surface(NamedTuple):
    """Points on a body, in its frame."""

    points: Array
    """Points (n, 3) of the surface, m, in the body's frame."""
    normals: Array
    """(n, 3) unit vectors, outwards"""
    areas: Array
    """(n,) m^2, that each point stands for"""


@functools.lru_cache(maxsize=_CACHED)
def surface(shape: Shape, size: Vector3, count: int = _POINTS) -> Surface:
    """About `count` points spread over the outside of a shape; without parts, over the box of `size`.

    None for what is no thing: with edges of less than 10 um, or more than 1 km from end to end.
    """
    return _sampled(shape, size, count)


def _sampled(shape: Shape, size: Vector3, count: int) -> Surface:
    """As `surface`, and not kept: many points take much memory."""
    parts = shape or box(size)
    if not all(map(_is_thing, parts)):
        return Surface(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
    spacing = math.sqrt(sum(_area(part) for part in parts) / count)
    pieces = [_placed(part, piece) for part in parts for piece in _pieces(part, spacing)]
    points, normals, areas = (np.concatenate(arrays) for arrays in zip(*pieces, strict=True))
    outside = signed_distances(parts, size, points + GAP * normals) > 0.0
    return Surface(points[outside], normals[outside], areas[outside])


@functools.lru_cache(maxsize=_CACHED)
def _without_overlap(shape: Shape, size: Vector3, count: int) -> Surface:
    """As `surface`, but what faces of several parts have in common counts once.

    Walls that meet in corners overlap, and so do their upper faces. So finer points tell the areas: what each stands
    for is divided among the parts just beneath it, and belongs to the nearest point that looks the same way.
    """
    from scipy.spatial import cKDTree  # not every process that knows shapes has scipy

    whole, fine = surface(shape, size, count), _sampled(shape, size, _FINER * count)
    if not len(whole.points):
        return whole
    beneath = (Solids.of(shape).signed_distances(fine.points - GAP * fine.normals) < 0.0).sum(axis=0)
    _, nearest = cKDTree(np.hstack([whole.points, whole.normals])).query(np.hstack([fine.points, fine.normals]))
    areas = np.bincount(nearest, weights=fine.areas / np.maximum(beneath, 1), minlength=len(whole.points))
    return Surface(whole.points, whole.normals, np.asarray(areas, np.float64))


def seen_alone(shape: Shape, size: Vector3, eye: Array, count: int = _POINTS) -> tuple[Array, Array]:
    """Sample the surface of a body as it is seen from `eye` (3,), in the body's frame.

    Nothing else is there; `count` points are sampled all around it.

    Returns:
        The points of its surface that face the eye and that the body itself does not hide (n, 3), and the share of its
        image that each stands for (n,), 1 together.
    """
    points, normals, areas = (_without_overlap if len(shape) > 1 else surface)(shape, size, count)
    ray = eye - points
    distance = np.sqrt((ray * ray).sum(axis=1))
    weights = areas * (ray * normals).sum(axis=1) / np.maximum(distance, _LEAST) ** 3
    facing = weights > 0.0
    points, weights = points[facing], weights[facing]
    rays = Solids.of(shape or box(size))
    hidden = rays.cut_off(eye, points).any(axis=0)
    points, weights = points[~hidden], weights[~hidden]
    return points, weights / max(float(weights.sum()), _LEAST)


def distances(shape: Shape, size: Vector3, points: Array) -> Array:
    """How far points (n, 3), in the frame of a body, are from its surface (n,) m; exact outside it."""
    return np.abs(signed_distances(shape, size, points))


def signed_distances(shape: Shape, size: Vector3, points: Array) -> Array:
    """How far points (n, 3), in the frame of a body, are outside it (n,) m; negative within, where it is a bound."""
    return np.asarray(Solids.of(shape or box(size)).signed_distances(points).min(axis=0))


def underside(shape: Shape, size: Vector3, world_from_body: Array) -> Array:
    """Points (n, 3) m, in the world, where a body meets first what it falls on: faces that look down, corners, rims.

    Args:
        shape: the parts of the body; without any, it is the box of `size`.
        size: (3,) m.
        world_from_body: (4, 4).
    """
    parts = shape or box(size)
    area = float(surface(shape, size).areas.sum())
    whole = surface(shape, size, min(math.ceil(area / _SPACING**2), _MOST_BELOW) or 1)
    rotation = world_from_body[:3, :3]
    below = (whole.normals @ rotation.T)[:, 2] < _FACING
    edges = [_edges(part, rotation) for part in parts if _is_thing(part)]
    points = np.concatenate([whole.points[below], *edges])
    return np.asarray(points @ rotation.T + world_from_body[:3, 3])


def room_below(points: Array, solids: Solids) -> float:
    """How far (m) points (n, 3) can move straight down until one meets a solid that it is not in; infinite if none."""
    ray = np.array([0.0, 0.0, -_DEEPEST])
    start = solids.into(points)
    enters, leaves = crossings(solids.kinds, solids.half, start, (ray @ solids.rotation)[:, None])
    met = (enters < leaves) & (enters >= 0.0) & (enters < 1.0)
    return float(np.where(met, enters, math.inf).min(initial=math.inf)) * _DEEPEST


class Solids(NamedTuple):
    """n convex parts somewhere."""

    kinds: NDArray[np.int64]
    """(n,) 0 box, 1 cylinder, 2 sphere"""
    centre: Array
    """Centres (n, 3) of the solids, m."""
    rotation: Array
    """(n, 3, 3) frame_from_part"""
    half: Array
    """(n, 3) m, half the edge lengths of the box around each, in its own frame"""

    @staticmethod
    def of(parts: Sequence[Part]) -> Solids:
        """Make the solids of a shape's parts, in the frame of its body."""
        rotations = [quaternions.to_matrix(part.rotation) for part in parts]
        return Solids(
            np.array([_KINDS.index(part.kind) for part in parts], dtype=np.int64),
            np.array([part.position for part in parts], dtype=np.float64).reshape(-1, 3),
            np.array(rotations, dtype=np.float64).reshape(-1, 3, 3),
            0.5 * np.array([part.size for part in parts], dtype=np.float64).reshape(-1, 3),
        )

    def moved(self, matrix: Array) -> Solids:
        """These in another frame, by the transform (4, 4) from the present one into that."""
        rotation = matrix[:3, :3]
        return Solids(self.kinds, self.centre @ rotation.T + matrix[:3, 3], rotation @ self.rotation, self.half)

    def signed_distances(self, points: Array) -> Array:
        """(n, k) m, how far points (k, 3) are outside each; negative within."""
        local = np.abs(self.into(points))
        beyond = local - self.half[:, None]  # of each pair of faces
        radius = self.half[:, :1]
        around = np.hypot(local[..., 0], local[..., 1]) - radius
        is_cylinder = (self.kinds == 1)[:, None]
        beyond[..., 0] = np.where(is_cylinder, around, beyond[..., 0])
        beyond[..., 1] = np.where(is_cylinder, around, beyond[..., 1])
        within = beyond.max(axis=2)
        outside = np.maximum(beyond, 0.0)
        outside[..., 1] = np.where(is_cylinder, 0.0, outside[..., 1])
        signed = np.sqrt((outside * outside).sum(axis=2)) + np.minimum(within, 0.0)
        ball = np.sqrt((local * local).sum(axis=2)) - radius
        return np.asarray(np.where((self.kinds == 2)[:, None], ball, signed))

    def into(self, points: Array) -> Array:
        """(n, k, 3) points (k, 3) in the frame of each part."""
        return np.asarray(np.einsum("nkj,nji->nki", points[None] - self.centre[:, None], self.rotation))

    def first_met(self, eye: Array, rays: Array) -> Array:
        """(n,) parameters at which rays (n, 3) from `eye` (3,) meet the first of these; infinite if they meet none."""
        start = np.einsum("nj,nji->ni", eye - self.centre, self.rotation)
        enters, leaves = crossings(self.kinds, self.half, start[:, None], rays[None] @ self.rotation)
        met = (enters < leaves) & (enters > 0.0)
        return np.asarray(np.where(met, enters, math.inf).min(axis=0))

    def cut_off(self, eye: Array, targets: Array) -> Flags:
        """(n, rays) which rays from `eye` (3,) to `targets` (rays, 3) meet each part before their end."""
        ray = targets - eye
        start = np.einsum("nj,nji->ni", eye - self.centre, self.rotation)
        enters, leaves = crossings(self.kinds, self.half, start[:, None], ray[None] @ self.rotation)
        arrived = 1.0 - GAP / np.maximum(np.sqrt((ray * ray).sum(axis=1)), GAP)
        return meets(enters, leaves, arrived)


def meets(enters: Array, leaves: Array, arrived: Array) -> Flags:
    """Which rays are inside something before the parameter `arrived`, by where they enter and leave it."""
    met: Flags = (enters < leaves) & (leaves > 0.0) & (enters < arrived)
    return met


def crossings(kinds: NDArray[np.int64], half: Array, start: Array, ray: Array) -> tuple[Array, Array]:
    """Parameters (k, rays) at which rays enter and leave k parts; a ray that misses leaves before it enters.

    Args:
        kinds: (k,) as in `Solids`.
        half: (k, 3) m, likewise.
        start: (k, 1 or rays, 3) m, in the frame of each part.
        ray: (k, rays, 3) m, likewise.
    """
    safe = np.where(np.abs(ray) < _LEAST, _LEAST, ray)
    one, other = (-half[:, None] - start) / safe, (half[:, None] - start) / safe
    near, far = np.minimum(one, other), np.maximum(one, other)
    enters, leaves = near.max(axis=2), far.min(axis=2)
    for kind, axes in ((1, 2), (2, 3)):  # a round part is cut with a circle, or a ball, instead of some slabs
        of_kind = kinds == kind
        if of_kind.any():
            into, out = _through_round(start[of_kind, :, :axes], ray[of_kind, :, :axes], half[of_kind, :1])
            enters[of_kind] = np.maximum(into, near[of_kind, :, axes:].max(axis=2, initial=-np.inf))
            leaves[of_kind] = np.minimum(out, far[of_kind, :, axes:].min(axis=2, initial=np.inf))
    return enters, leaves


def _through_round(start: Array, ray: Array, radius: Array) -> tuple[Array, Array]:
    """Where rays enter and leave a circle or ball of `radius` (k, 1) around the origin."""
    a = np.maximum((ray * ray).sum(axis=2), _LEAST**2)
    b = (start * ray).sum(axis=2)
    c = (start * start).sum(axis=2) - radius * radius
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    missed = b * b < a * c
    return np.where(missed, np.inf, (-b - root) / a), np.where(missed, -np.inf, (-b + root) / a)


def _is_thing(part: Part) -> bool:
    return min(part.size) >= _THIN and max(*part.size, *map(abs, part.position)) <= _VAST


def _edges(part: Part, world_from_body: Array) -> Array:
    """Points (n, 3) of a part where faces that look down end, in the frame of its body.

    These are corners of a box, points on the rims of a cylinder, and the lowest point of a sphere.
    """
    rotation = np.array(quaternions.to_matrix(part.rotation))
    up = world_from_body[2] @ rotation  # in the frame of the part
    half = 0.5 * np.array(part.size)
    if part.kind == "sphere":
        edges = -half[:1] * up[None]
    elif part.kind == "cylinder":
        rims = [np.column_stack([np.cos(_AROUND), np.sin(_AROUND), np.full(len(_AROUND), side)]) for side in (-1, 1)]
        outwards = np.concatenate(rims)
        below = np.minimum(outwards[:, :2] @ up[:2], outwards[:, 2] * up[2]) < _FACING
        edges = outwards[below] * half
    else:
        edges = CORNERS[(CORNERS * up).min(axis=1) < _FACING] * half
    return np.asarray(edges @ rotation.T + part.position)


def _area(part: Part) -> float:
    x, y, z = part.size
    if part.kind == "sphere":
        return math.pi * x * x
    if part.kind == "cylinder":
        return math.pi * x * (z + 0.5 * x)
    return 2.0 * (x * y + y * z + z * x)


def _placed(part: Part, piece: Surface) -> Surface:
    rotation = np.array(quaternions.to_matrix(part.rotation))
    return Surface(piece.points @ rotation.T + part.position, piece.normals @ rotation.T, piece.areas)


def _pieces(part: Part, spacing: float) -> Iterator[Surface]:
    """Points on each face of a part, in its own frame."""
    if part.kind == "sphere":
        yield _sphere(part.size[0] / 2, spacing)
    elif part.kind == "cylinder":
        yield from _cylinder(part.size[0] / 2, part.size[2] / 2, spacing)
    else:
        for axis in range(3):
            yield from _faces(part.size, axis, spacing)


def _faces(size: Vector3, axis: int, spacing: float) -> Iterator[Surface]:
    """The two faces of a box across an axis."""
    others = [other for other in range(3) if other != axis]
    u, v = (_middles(size[other], spacing) for other in others)
    points = np.zeros((len(u) * len(v), 3))
    points[:, others] = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    areas = np.full(len(points), size[others[0]] * size[others[1]] / len(points))
    for side in (1.0, -1.0):
        normal = np.zeros(3)
        normal[axis] = side
        yield Surface(points + normal * size[axis] / 2, np.tile(normal, (len(points), 1)), areas)


def _middles(length: float, spacing: float) -> Array:
    """Where the middles of pieces of a length are, from its own middle."""
    count = min(max(1 if length < _RIM * spacing else 2, round(length / spacing)), _MOST)
    return np.asarray((np.arange(count) + 0.5) * (length / count) - length / 2)


def _sphere(radius: float, spacing: float) -> Surface:
    """Evenly by the golden spiral (R. Swinbank and R. J. Purser, "Fibonacci grids", 2006)."""
    count = max(24, round(4 * math.pi * radius**2 / spacing**2))
    index = np.arange(count)
    height = 1.0 - (2.0 * index + 1.0) / count
    angle = index * math.pi * (3.0 - math.sqrt(5.0))
    across = np.sqrt(1.0 - height**2)
    normals = np.column_stack([across * np.cos(angle), across * np.sin(angle), height])
    return Surface(radius * normals, normals, np.full(count, 4 * math.pi * radius**2 / count))


def _cylinder(radius: float, half: float, spacing: float) -> Iterator[Surface]:
    around = np.linspace(0.0, 2 * math.pi, max(12, round(2 * math.pi * radius / spacing)), endpoint=False)
    angle, height = (grid.ravel() for grid in np.meshgrid(around, _middles(2 * half, spacing)))
    normals = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))])
    points = radius * normals
    points[:, 2] = height
    yield Surface(points, normals, np.full(len(points), 4 * math.pi * radius * half / len(points)))
    steps = _middles(2 * radius, spacing)
    disc = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    disc = disc[np.hypot(disc[:, 0], disc[:, 1]) < radius]
    for side in (1.0, -1.0):
        points = np.column_stack([disc, np.full(len(disc), side * half)])
        areas = np.full(len(disc), math.pi * radius**2 / len(disc))
        yield Surface(points, np.tile((0.0, 0.0, side), (len(disc), 1)), areas)
