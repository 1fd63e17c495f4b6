"""How far a point is from the surface of a body, and which way is out."""

from __future__ import annotations

import math

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Part, box
from simulation_handler.shapes.geometry import Solid

_UP: Vector3 = (0.0, 0.0, 1.0)


def signed_distance(solid: Solid, point: Vector3) -> tuple[float, Vector3]:
    """Distance (m) of a point in the world from a body, negative inside, and the unit vector out of it there."""
    away = (point[0] - solid.position[0], point[1] - solid.position[1], point[2] - solid.position[2])
    local = quaternions.rotate(quaternions.conjugate(solid.rotation), away)
    distance, normal = min(_of_part(part, local) for part in solid.shape or box(solid.size))
    return distance, quaternions.rotate(solid.rotation, normal)


def _of_part(part: Part, point: Vector3) -> tuple[float, Vector3]:
    """Likewise in the body's frame, of one piece."""
    px, py, pz = part.position
    local = quaternions.rotate(quaternions.conjugate(part.rotation), (point[0] - px, point[1] - py, point[2] - pz))
    half = (0.5 * part.size[0], 0.5 * part.size[1], 0.5 * part.size[2])
    distance, normal = _of_kind(part, local, half)
    return distance, quaternions.rotate(part.rotation, normal)


def _of_kind(part: Part, point: Vector3, half: Vector3) -> tuple[float, Vector3]:
    x, y, z = point
    if part.kind == "sphere":
        length = math.hypot(x, y, z)
        return length - half[0], (x / length, y / length, z / length) if length else _UP
    if part.kind == "box":
        return _of_extents(((abs(x) - half[0], (_sign(x), 0.0, 0.0)), (abs(y) - half[1], (0.0, _sign(y), 0.0)),
                            (abs(z) - half[2], (0.0, 0.0, _sign(z)))))  # fmt: skip
    length = math.hypot(x, y)
    radial = (x / length, y / length, 0.0) if length else (1.0, 0.0, 0.0)
    return _of_extents(((length - half[0], radial), (abs(z) - half[2], (0.0, 0.0, _sign(z)))))


def _of_extents(extents: tuple[tuple[float, Vector3], ...]) -> tuple[float, Vector3]:
    """From how far a point is beyond the faces in orthogonal directions."""
    beyond = [(d, n) for d, n in extents if d > 0.0]
    if not beyond:
        return max(extents)
    distance = math.hypot(*(d for d, _ in beyond))
    x, y, z = (sum(d * n[k] for d, n in beyond) / distance for k in range(3))
    return distance, (x, y, z)


def _sign(value: float) -> float:
    return math.copysign(1.0, value)
