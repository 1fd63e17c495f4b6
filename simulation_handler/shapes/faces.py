"""Flat sides on which bodies can lie: those of the convex hulls of their pieces."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Part, Shape
from dsr.perception.scales import RESOLUTION
from simulation_handler.scales import ANGLES, ROUNDING

_BEVEL = 0.3  # rad between two sides, of which only the larger one counts: the other is a bevel, or a gap
ROUND = tuple((math.cos(math.pi * k / ANGLES), math.sin(math.pi * k / ANGLES)) for k in range(2 * ANGLES))
"""Corners (x, y) of the regular polygon that stands for a circle of radius 1"""

Points = NDArray[np.float64]


@lru_cache(maxsize=256)  # count: far more shapes than a scene has
def faces(shape: Shape) -> tuple[Vector3, ...]:
    """Outward normals (unit, in the body's frame) of the flat sides of a body on which it does not tip over.

    The largest first; none where they are sides of its bounding box. A cylinder counts as a prism of 16 sides, a sphere
    as a box.
    """
    from scipy.spatial import ConvexHull, QhullError  # takes 0.4 s, for which scenes of boxes need not wait

    try:
        hull = ConvexHull(np.concatenate([_corners(part) for part in shape]))
    except QhullError:  # too thin
        return ()
    planes: Points = hull.equations
    areas: dict[Vector3, float] = {}
    for plane, triangle in zip(planes, hull.points[hull.simplices], strict=True):
        below_centre = -plane[3] * plane[:3]
        if (planes[:, :3] @ below_centre + planes[:, 3]).max() > RESOLUTION:
            continue
        edge, other = triangle[1:] - triangle[0]
        x, y, z = (value + 0.0 for value in plane[:3].round(3).tolist())
        areas[x, y, z] = areas.get((x, y, z), 0.0) + 0.5 * float(np.linalg.norm(np.cross(edge, other)))
    found: list[Vector3] = []
    for normal in sorted(areas, key=lambda normal: (-areas[normal], normal)):
        unit = _unit(normal)
        if all(dot(unit, other) < math.cos(_BEVEL) for other in found):
            found.append(unit)
    is_box = all(max(map(abs, normal)) > 1.0 - ROUNDING for normal in found)
    return () if is_box else tuple(found)


def depth(shape: Shape, down: Vector3) -> float:
    """Distance (m) by which a body reaches from its centre in the direction `down` (unit vector, in its frame)."""
    return max(dot(part.position, down) + _reach(part, down) for part in shape)


def dot(a: Vector3, b: Vector3) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _reach(part: Part, down: Vector3) -> float:
    """How far (m) a piece reaches from its own centre."""
    x, y, z = quaternions.rotate(quaternions.conjugate(part.rotation), down)
    a, b, c = (0.5 * edge for edge in part.size)
    if part.kind == "sphere":
        return a
    if part.kind == "cylinder":
        return a * math.hypot(x, y) + c * abs(z)
    return a * abs(x) + b * abs(y) + c * abs(z)


def _corners(part: Part) -> Points:
    """(n, 3) m in the body's frame."""
    outline = ROUND if part.kind == "cylinder" else ((-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0))
    own = 0.5 * np.array([(x, y, z) for x, y in outline for z in (-1.0, 1.0)]) * part.size
    return np.asarray(own @ np.array(quaternions.to_matrix(part.rotation)).T + part.position)


def _unit(vector: Vector3) -> Vector3:
    length = math.hypot(*vector)
    x, y, z = (value / length for value in vector)
    return x, y, z
