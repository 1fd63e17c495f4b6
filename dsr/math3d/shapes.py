"""Shapes of rigid bodies as unions of boxes, cylinders and spheres, and their form as an attribute of a node.

A body's frame is at the centre of its bounding box, whose edge lengths are the attribute `size`. A node without the
attribute `shape` is a solid box of that size; a container, a cup or a ball says here what it is made of.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple, cast, get_args

from dsr.errors import SchemaError
from dsr.math3d.quaternions import Quaternion, Vector3, conjugate, normalised, rotate, to_matrix

PartKind = Literal["box", "cylinder", "sphere"]
_KINDS: tuple[PartKind, ...] = get_args(PartKind)
_NUMBERS = 11  # of a part: kind, size, position, rotation
MOST_PARTS = 16
"""Parts that one shape may have: pybullet takes no more for one body, and leaves out the rest without a word."""
_UNIT = 1e-3  # by which the norm of a rotation may be off


class Part(NamedTuple):
    """One convex piece of a body."""

    kind: PartKind
    size: Vector3
    """Edge lengths (m) of its bounding box in its own frame. A cylinder stands along z and has a round section of
    diameter size[0]; a sphere has the diameter size[0]."""
    position: Vector3 = (0.0, 0.0, 0.0)
    """Position of the part's centre in the body's frame, m."""
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)
    """body_from_part"""
    corners: tuple[Vector3, ...] = ()
    """Corners (m, in the part's frame) of the convex body that this box stands for.

    The physics engine takes the corners, everything else the box. Empty for other parts.
    """

    def contains(self, point: Vector3) -> bool:
        """Whether a point (m, in the body's frame) is inside or on the surface."""
        return self.signed_distance(point)[0] <= 0.0

    def signed_distance(self, point: Vector3) -> tuple[float, Vector3]:
        """How far (m) a point in the body's frame is outside, negative within, and the unit vector out of it there."""
        x, y, z = local = rotate(conjugate(self.rotation), _minus(point, self.position))
        half = 0.5 * self.size[0]
        if self.kind == "sphere":
            length = math.hypot(x, y, z)
            distance, normal = length - half, (x / length, y / length, z / length) if length else (0.0, 0.0, 1.0)
        elif self.kind == "cylinder":
            length = math.hypot(x, y)
            radial = (x / length, y / length, 0.0) if length else (1.0, 0.0, 0.0)
            distance, normal = _from_faces([(length - half, radial), _from_face(local, self.size, 2)])
        else:
            distance, normal = _from_faces([_from_face(local, self.size, axis) for axis in range(3)])
        return distance, rotate(self.rotation, normal)


Shape = tuple[Part, ...]
"""The pieces of a body, in its frame; they may overlap."""


def box(size: Vector3) -> Shape:
    """A solid box of edge lengths `size` (m)."""
    return (Part("box", size),)


def bounds(shape: Shape) -> tuple[Vector3, Vector3]:
    """Least and greatest coordinates (m) of a shape in its frame. Raises `ValueError` for one without parts."""
    if not shape:
        raise ValueError("a shape without parts has no bounds")
    extents = [_extent(part) for part in shape]
    low = [min(part.position[k] - extent[k] for part, extent in zip(shape, extents, strict=True)) for k in range(3)]
    high = [max(part.position[k] + extent[k] for part, extent in zip(shape, extents, strict=True)) for k in range(3)]
    return (low[0], low[1], low[2]), (high[0], high[1], high[2])


def centred(shape: Shape) -> tuple[Shape, Vector3]:
    """A shape moved so that its frame is at the centre of its bounding box, and where (m) that was before."""
    low, high = bounds(shape)
    middle = (0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0.5 * (low[2] + high[2]))
    return tuple(part._replace(position=_minus(part.position, middle)) for part in shape), middle


def to_numbers(shape: Shape) -> tuple[float, ...]:
    """A shape as the attribute `shape` has it: 11 numbers for each part (kind, size, position, rotation)."""
    return tuple(
        float(number)
        for part in shape
        for number in (_KINDS.index(part.kind), *part.size, *part.position, *part.rotation)
    )


def from_numbers(numbers: Sequence[float]) -> Shape:
    """The shape of an attribute `shape`. Raises `SchemaError` for numbers that are none."""
    count, rest = divmod(len(numbers), _NUMBERS)
    if rest or not 1 <= count <= MOST_PARTS:
        raise SchemaError(f"shape of {len(numbers)} numbers; expected {_NUMBERS} for each of 1 to {MOST_PARTS} parts")
    return tuple(_part(numbers[k * _NUMBERS : (k + 1) * _NUMBERS]) for k in range(count))


def _part(numbers: Sequence[float]) -> Part:
    kind, *rest = numbers
    if kind not in range(len(_KINDS)) or not all(map(math.isfinite, rest)) or min(rest[:3]) <= 0.0:
        raise SchemaError(f"part of a shape {list(numbers)}; expected kind 0 to {len(_KINDS) - 1}, positive sizes")
    try:
        rotation = normalised(cast(Quaternion, tuple(rest[6:])), _UNIT)
    except (ValueError, ZeroDivisionError) as error:
        raise SchemaError(f"part of a shape {list(numbers)}: {error}") from error
    return Part(_KINDS[int(kind)], cast(Vector3, tuple(rest[:3])), cast(Vector3, tuple(rest[3:6])), rotation)


def _extent(part: Part) -> Vector3:
    """Half the edge lengths of the axis-parallel box around a part, m."""
    half = 0.5 * part.size[0]
    if part.kind == "sphere":
        return half, half, half
    rows = to_matrix(part.rotation)
    if part.kind == "cylinder":
        height = 0.5 * part.size[2]
        x, y, z = (abs(row[2]) * height + half * math.sqrt(max(0.0, 1.0 - row[2] ** 2)) for row in rows)
        return x, y, z
    x, y, z = (0.5 * sum(abs(a) * edge for a, edge in zip(row, part.size, strict=True)) for row in rows)
    return x, y, z


def _from_face(point: Vector3, size: Vector3, axis: int) -> tuple[float, Vector3]:
    """How far (m) a point is beyond the nearer one of the two faces of a box across an axis, and its normal."""
    sign = math.copysign(1.0, point[axis])
    normal = (sign * (axis == 0), sign * (axis == 1), sign * (axis == 2))
    return abs(point[axis]) - 0.5 * size[axis], normal


def _from_faces(faces: Sequence[tuple[float, Vector3]]) -> tuple[float, Vector3]:
    """Signed distance and normal at a point, from those of faces in orthogonal directions."""
    beyond = [(distance, normal) for distance, normal in faces if distance > 0.0]
    if not beyond:
        return max(faces)
    distance = math.hypot(*(distance for distance, _ in beyond))
    x, y, z = (sum(part * normal[k] for part, normal in beyond) / distance for k in range(3))
    return distance, (x, y, z)


def _minus(a: Vector3, b: Vector3) -> Vector3:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]
