"""Bodies over and beside each other: footprints, overlaps and the turn that puts a face down.

Footprints are convex polygons in the horizontal plane, counter-clockwise, (x, y) in m of the world frame.
On a handful of points plain floats are several times faster than numpy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from dsr.math3d import quaternions
from dsr.math3d.polygons import Point, Polygon, hull
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.math3d.shapes import Part, PartKind, Shape, box
from dsr.math3d.transforms import Pose
from simulation_handler.scales import GAP, ROUNDING
from simulation_handler.shapes.faces import ROUND, depth, dot, faces

_CORNERS = tuple((x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5))


@dataclass(frozen=True)
class Solid:
    """A body somewhere in the world: a box, or the parts of its shape."""

    name: str
    size: Vector3
    """Edge lengths of its bounding box, m."""
    position: Vector3
    """Position of the bounding box's centre in the world, m."""
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)
    fixed: bool = False
    """Whether the solid never moves: a table or the floor."""
    shape: Shape = ()
    """Pieces of the shape; none for a solid box."""

    @property
    def pose(self) -> Pose:
        """world_from_solid."""
        return Pose.unchecked(self.position, self.rotation)

    @cached_property
    def kind(self) -> PartKind | None:
        """Kind of a solid of one piece; None for a body of several."""
        if not self.shape:
            return "box"
        return self.shape[0].kind if len(self.shape) == 1 else None

    @property
    def parts(self) -> tuple[Solid, ...]:
        """Convex pieces in the world, under the solid's name; the solid itself if it has one piece."""
        return (self,) if self.kind else self._pieces  # a solid that kept itself would be garbage in a cycle

    @cached_property
    def _pieces(self) -> tuple[Solid, ...]:
        return tuple(map(self._part, self.shape))

    def _part(self, part: Part) -> Solid:
        x, y, z = quaternions.rotate(self.rotation, part.position)
        position = (self.position[0] + x, self.position[1] + y, self.position[2] + z)
        shape = () if part.kind == "box" else (Part(part.kind, part.size),)
        rotation = quaternions.product(self.rotation, part.rotation)
        return Solid(self.name, part.size, position, rotation, self.fixed, shape)

    @cached_property
    def is_hollow(self) -> bool:
        """Whether there is room in its middle: in a cup, in a box without lid or bottom."""
        return self.kind is None and not any(part.contains((0.0, 0.0, 0.0)) for part in self.shape)

    def reaches_around(self, point: Vector3, margin: float = 0.0) -> bool:
        """Whether a point (m) is within its bounding box, or outside by at most `margin` m (inside, if negative)."""
        away = (point[0] - self.position[0], point[1] - self.position[1], point[2] - self.position[2])
        local = quaternions.rotate(quaternions.conjugate(self.rotation), away)
        return all(abs(a) <= 0.5 * edge + margin for a, edge in zip(local, self.size, strict=True))

    @cached_property
    def half_height(self) -> float:
        """Distance in height from the lowest point to the centre, m."""
        return self._reach(-1.0)

    def _reach(self, sign: float) -> float:
        """How far it reaches from its centre, m: up (sign 1), or down (-1)."""
        if self.kind == "sphere":
            return 0.5 * self.size[2]
        if not self.shape or self.kind == "box":
            return half_height(self.size, self.rotation)
        x, y, z = quaternions.to_matrix(self.rotation)[2]
        is_flat = sorted((abs(x), abs(y), abs(z)))[1] < ROUNDING  # sines: a cosine hardly tells small angles
        if is_flat or not faces(self.shape):
            return half_height(self.size, self.rotation)
        return depth(self.shape, (sign * x, sign * y, sign * z))

    @cached_property
    def bottom(self) -> float:
        """Height of the solid's lowest point in the world, m."""
        return self.position[2] - self.half_height

    @cached_property
    def top(self) -> float:
        """Height of its highest point, m."""
        return self.position[2] + self._reach(1.0)

    @cached_property
    def radius(self) -> float:
        """Distance from the centre within which all of it is, m."""
        return 0.5 * (self.size[0] if self.kind == "sphere" else math.hypot(*self.size))

    @cached_property
    def footprint(self) -> Polygon:
        """Outline seen from above, but for rounding errors; of several pieces, that of the bounding box."""
        x, y, _ = self.position
        if self.is_round:
            half = 0.5 * self.size[0]
            return [(x + half * dx, y + half * dy) for dx, dy in ROUND]
        rows = quaternions.to_matrix(self.rotation)
        if self.kind == "cylinder":
            return _rims((x, y), self.size, (rows[0][2], rows[1][2], rows[2][2]))
        edges = [(rows[0][k] * edge, rows[1][k] * edge) for k, edge in enumerate(self.size)]
        level = [edge for edge, slope in zip(edges, rows[2], strict=True) if abs(slope) < ROUNDING]
        if len(level) == 2:
            return _parallelogram((x, y), *level)
        (ax, ay), (bx, by), (cx, cy) = edges
        return hull([(x + (r * ax + s * bx + t * cx), y + (r * ay + s * by + t * cy)) for r, s, t in _CORNERS])

    @property
    def is_round(self) -> bool:
        """Whether the solid is round seen from above: a ball, or a cylinder that stands."""
        if self.kind == "cylinder":
            x, y, _ = quaternions.to_matrix(self.rotation)[2]
            return x * x + y * y < 2.0 * ROUNDING  # squared sine: a cosine hardly tells small angles
        return self.kind == "sphere"

    def signed_distance(self, point: Vector3) -> tuple[float, Vector3]:
        """Distance (m) of a point in the world from the surface, negative inside, and the unit normal (world) there."""
        away = (point[0] - self.position[0], point[1] - self.position[1], point[2] - self.position[2])
        local = quaternions.rotate(quaternions.conjugate(self.rotation), away)
        distance, normal = min(part.signed_distance(local) for part in self.shape or box(self.size))
        return distance, quaternions.rotate(self.rotation, normal)

    def is_at(self, other: Solid) -> bool:
        """Whether another one is the same body at the same place, but for less than counts: bodies at rest tremble."""
        if self is other:
            return True
        turn = math.dist(self.rotation, other.rotation)  # half an angle, rad
        is_near = math.dist(self.position, other.position) <= GAP and 2.0 * turn * self.radius <= GAP
        return is_near and (self.name, self.size, self.shape) == (other.name, other.size, other.shape)

    def moved(self, position: Vector3) -> Solid:
        """The same solid elsewhere."""
        return Solid(self.name, self.size, position, self.rotation, self.fixed, self.shape)

    def turned(self, rotation: Quaternion) -> Solid:
        """The same solid with another rotation."""
        return Solid(self.name, self.size, self.position, rotation, self.fixed, self.shape)

    def at(self, position: Vector3, rotation: Quaternion) -> Solid:
        """The same solid elsewhere, with another rotation."""
        return Solid(self.name, self.size, position, rotation, self.fixed, self.shape)

    def face_down(self) -> tuple[Solid, float]:
        """Turn the solid to the nearest rotation that puts a face down, and tell by how much (tilt, rad); a ball has no
        face.
        """
        return self._faced_down

    @cached_property
    def _faced_down(self) -> tuple[Solid, float]:
        if self.kind == "sphere":
            return self, 0.0
        rotation, tilt = face_down(self.rotation, self._sides())
        return self.turned(rotation), tilt

    def stances(self) -> list[Quaternion]:
        """The rotations that put one of its faces down, each the nearest to how it is turned; none for a ball."""
        return [face_down(self.rotation, (side,))[0] for side in self._faces()]

    def level_sides(self) -> list[Vector3]:
        """Unit vectors in the world of those sides of its bounding box that are about vertical."""
        axes = [(row[0], row[1], row[2]) for row in zip(*quaternions.to_matrix(self.rotation), strict=True)]
        upright = max(range(3), key=lambda k: abs(axes[k][2]))
        level = [axis for k, axis in enumerate(axes) if k != upright]
        return [(sign * x, sign * y, sign * z) for x, y, z in level for sign in (1.0, -1.0)]

    def _faces(self) -> Sequence[Vector3]:
        """Outward normals, in its frame, of the sides on which it can lie; of those that are alike, the lowest one."""
        x, y, z = quaternions.to_matrix(self.rotation)[2]
        if self.kind == "sphere":
            return ()
        if self.kind == "cylinder":
            radius = math.hypot(x, y)
            level = (1.0, 0.0, 0.0) if radius < ROUNDING else (-x / radius, -y / radius, 0.0)
            return ((0.0, 0.0, math.copysign(1.0, -z)), level)
        return (() if self.kind else faces(self.shape)) or (
            (math.copysign(1.0, -x), 0.0, 0.0), (0.0, math.copysign(1.0, -y), 0.0), (0.0, 0.0, math.copysign(1.0, -z))
        )  # fmt: skip

    def _sides(self) -> Sequence[Vector3]:
        """Outward normals, in its frame, of those of its sides that may be down; none if they are those of a box."""
        if self.kind == "cylinder":
            x, y, z = quaternions.to_matrix(self.rotation)[2]
            radius = math.hypot(x, y)
            return [(0.0, 0.0, math.copysign(1.0, -z))] if radius < abs(z) else [(-x / radius, -y / radius, 0.0)]
        return () if self.kind else faces(self.shape)


def _parallelogram(centre: Point, a: Point, b: Point) -> Polygon:
    """Outline with edges a and b, counter-clockwise."""
    if a[0] * b[1] < a[1] * b[0]:
        a, b = b, a
    around = ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))
    return [(centre[0] + s * a[0] + t * b[0], centre[1] + s * a[1] + t * b[1]) for s, t in around]


def _rims(centre: Point, size: Vector3, axis: Vector3) -> Polygon:
    """Outline of a cylinder that does not stand, around both of its rims.

    The corners of a rim are those of one that stands, turned along with the axis (unit vector) by the shortest way. So
    the least tilt changes them least. The two ends of its level diameter come beside these.
    """
    ax, ay, az = axis if axis[2] >= 0.0 else (-axis[0], -axis[1], -axis[2])
    radius, half, sine = 0.5 * size[0], 0.5 * size[2], math.hypot(ax, ay)
    across = (-ay / sine, ax / sine)
    rim = [across, (-across[0], -across[1])]
    for dx, dy in ROUND:
        off = (ax * dx + ay * dy) / (1.0 + az)
        rim.append((dx - ax * off, dy - ay * off))
    ends = ((centre[0] + end * half * ax, centre[1] + end * half * ay) for end in (-1.0, 1.0))
    return hull([(x + radius * dx, y + radius * dy) for x, y in ends for dx, dy in rim])


def half_height(size: Vector3, rotation: Quaternion) -> float:
    """Distance in height from the centre of a box to its highest corner, m."""
    x, y, z = quaternions.to_matrix(rotation)[2]
    return 0.5 * (abs(x) * size[0] + abs(y) * size[1] + abs(z) * size[2])


def face_down(rotation: Quaternion, sides: Sequence[Vector3] = ()) -> tuple[Quaternion, float]:
    """The nearest rotation that puts a face down, and how far it is (tilt, rad; of a box at most 0.96).

    Args:
        rotation: world_from_body.
        sides: outward normals of its faces (unit, in its frame); none for those of a box.
    """
    up = quaternions.to_matrix(rotation)[2]
    if sides:
        x, y, z = min(sides, key=lambda side: dot(side, up))
        normal = quaternions.rotate(rotation, (-x, -y, -z))
    else:
        axis = max(range(3), key=lambda k: abs(up[k]))
        sign = math.copysign(1.0, up[axis])
        normal = quaternions.rotate(rotation, (sign * (axis == 0), sign * (axis == 1), sign * (axis == 2)))
    sine = math.hypot(normal[0], normal[1])
    tilt = math.atan2(sine, normal[2])
    if tilt == 0.0:
        return rotation, 0.0
    scale = tilt / sine if sine else 0.0
    turn = quaternions.from_rotvec((normal[1] * scale, -normal[0] * scale, 0.0) if sine else (math.pi, 0.0, 0.0))
    return quaternions.normalised(quaternions.product(turn, rotation)), tilt
