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

APART = 0.020
"""m between surfaces of two fingertips on opposite sides, together, from which a hand is open and neither touches"""

_DEEPEST = -0.020  # m, deeper than which no fingertip is in an object: it is in front of it or behind
_OPPOSED = -0.5  # cosine between the ways out of the object at two fingertips


def ways_out(solid: Solid, points: Mapping[str, Vector3], most: Mapping[str, float]) -> dict[str, Vector3]:
    """The way out of an object at each fingertip that touches it.

    Args:
        solid: the object.
        points: centres of the fingertips, m, by name.
        most: m between surfaces, up to which each of them touches.
    """
    met = {tip: near for tip, point in points.items() if (near := _near(solid, point, most[tip])) is not None}
    return {tip: way for tip, (distance, way) in met.items() if not _is_open(distance, way, list(met.values()))}


def _near(solid: Solid, point: Vector3, most: float) -> tuple[float, Vector3] | None:
    """How far a fingertip is from an object, m, and the way out of that; None if it is more than `most` m."""
    if math.dist(point, solid.position) > solid.radius + TIP_RADIUS + most:
        return None
    distance, way = outwards(solid, point)
    return (distance - TIP_RADIUS, way) if _DEEPEST <= distance - TIP_RADIUS <= most else None


def _is_open(distance: float, way: Vector3, others: list[tuple[float, Vector3]]) -> bool:
    """Whether a fingertip has others on the opposite side, and is far apart from all of them."""
    opposite = [other for other, there in others if _dot(way, there) < _OPPOSED]
    return bool(opposite) and distance + min(opposite) > APART


def is_opposed(ways: Mapping[str, Vector3 | None]) -> bool:
    """Whether two ways out of an object, of those that are known, are opposite."""
    known = [way for way in ways.values() if way is not None]
    return any(_dot(a, b) < _OPPOSED for a, b in combinations(known, 2))


def _dot(a: Vector3, b: Vector3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
