"""Where fingertips meet objects: whether one touches, goes on touching, and whether two are opposed."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from itertools import combinations
from typing import NamedTuple

from dsr.quaternions import Vector3
from simulation_handler.geometry import Solid
from simulation_handler.relations import Relation
from simulation_handler.surfaces import outwards

TIP_RADIUS = 0.008
"""m, of a fingertip"""
NEAR = 0.010
"""m between surfaces up to which a touch begins: what hands and percepts are off"""
FAR = 0.018
"""m up to which it goes on, at most"""
WITHDRAWN = 0.008
"""m by which a fingertip that touches no more is further away than it was while it touched"""
APART = 0.020
"""m between surfaces of two fingertips on opposite sides, together, from which a hand is open and neither touches"""

_BLEND = 0.2  # weight of the newest gap
_DEEPEST = -0.020  # m, deeper than which no fingertip is in an object: it is in front of it or behind
_OPPOSED = -0.5  # cosine between the ways out of the object at two fingertips


class Met(NamedTuple):
    """A fingertip that touches an object."""

    gap: float
    """m between the surfaces"""
    way: Vector3
    """The way out of the object there."""


class Gaps:
    """How far from an object each fingertip was seen while it touched: what is seen of both may be off by as much."""

    def __init__(self) -> None:
        self._gaps: dict[Relation, float] = {}

    def most(self, relation: Relation) -> float:
        """M between surfaces up to which (fingertip, object), which touch, go on to do so."""
        return min(FAR, max(NEAR, self._gaps.get(relation, FAR) + WITHDRAWN))

    def update(self, gaps: Mapping[Relation, float], known: Collection[Relation]) -> None:
        """Take in the gaps (m) of those that touch and are seen; those that are neither here nor `known` are over."""
        before = {relation: gap for relation, gap in self._gaps.items() if relation in known}
        noted = {at: (old := before.get(at, gap)) + _BLEND * (gap - old) for at, gap in gaps.items()}
        self._gaps = before | noted


def meet(solid: Solid, points: Mapping[str, Vector3], most: Mapping[str, float]) -> dict[str, Met]:
    """Which fingertips touch an object, by name.

    Args:
        solid: the object.
        points: centres of the fingertips, m, by name.
        most: m between surfaces, up to which each of them touches.
    """
    near = {tip: met for tip, point in points.items() if (met := _near(solid, point, most[tip])) is not None}
    return {tip: met for tip, met in near.items() if not _is_open(met, near.values())}


def _near(solid: Solid, point: Vector3, most: float) -> Met | None:
    """A fingertip at an object; None if it is more than `most` m from it."""
    if math.dist(point, solid.position) > solid.radius + TIP_RADIUS + most:
        return None
    distance, way = outwards(solid, point)
    return Met(distance - TIP_RADIUS, way) if _DEEPEST <= distance - TIP_RADIUS <= most else None


def _is_open(met: Met, others: Iterable[Met]) -> bool:
    """Whether a fingertip has others on the opposite side, and is far apart from all of them."""
    opposite = [other.gap for other in others if _dot(met.way, other.way) < _OPPOSED]
    return bool(opposite) and met.gap + min(opposite) > APART


def is_opposed(fingertips: Mapping[str, Met | None]) -> bool:
    """Whether two fingertips, of those of which that is known, are on opposite sides."""
    known = [met.way for met in fingertips.values() if met is not None]
    return any(_dot(a, b) < _OPPOSED for a, b in combinations(known, 2))


def _dot(a: Vector3, b: Vector3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
