"""Where fingertips meet objects: whether one touches, and whether two are opposed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import combinations

from dsr.quaternions import Vector3
from simulation_handler.geometry import Solid
from simulation_handler.surfaces import outwards

TIP_RADIUS = 0.008
"""m, of a fingertip"""
NEAR = 0.010
"""m between surfaces up to which a touch begins: what hands and percepts are off"""
FAR = 0.018
"""m up to which it goes on"""

_DEEPEST = -0.020  # m, deeper than which no fingertip is in an object: it is in front of it or behind
_OPPOSED = -0.5  # cosine between the ways out of the object at two fingertips


def way_out(solid: Solid, point: Vector3, most: float) -> Vector3 | None:
    """Out of an object at a fingertip that is at most `most` m away; None if that does not touch it."""
    if math.dist(point, solid.position) > solid.radius + TIP_RADIUS + most:
        return None
    distance, way = outwards(solid, point)
    return way if _DEEPEST <= distance - TIP_RADIUS <= most else None


def is_opposed(ways: Mapping[str, Vector3 | None]) -> bool:
    """Whether two ways out of an object, of those that are known, are opposite."""
    known = [way for way in ways.values() if way is not None]
    return any(_dot(a, b) < _OPPOSED for a, b in combinations(known, 2))


def _dot(a: Vector3, b: Vector3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
