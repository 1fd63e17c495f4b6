"""Where fingertips meet objects: whether one touches, goes on touching, and whether two are opposed, and stay so."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from itertools import combinations
from typing import NamedTuple

from dsr.math3d.quaternions import Vector3
from dsr.perception.scales import SAME_PLACE, SLOWLY
from simulation_handler.contact.relations import Relation
from simulation_handler.hands.anatomy import HAND
from simulation_handler.hands.state import UNSEEN
from simulation_handler.scales import PLACE_FLOOR
from simulation_handler.shapes.geometry import Solid

NEAR = SAME_PLACE
"""m between surfaces up to which a touch begins, and by which it may grow: the error of hands and percepts"""
FAR = NEAR + HAND.tip_radius
"""m between surfaces up to which a touch goes on, at most: the finger may touch with its side"""
DEEPEST = 2.0 * NEAR
"""m, deeper than which no fingertip is in an object: it is in front of it or behind"""

_OF_THE_NEWEST = 0.4  # weight of the newest gap in what it is now, if its percept is no noisier than usual
_USUAL_NOISE = 0.5 * NEAR  # m, of percepts for which `NEAR` is 95 % of a Gaussian
_LEAST_GAP = -PLACE_FLOOR  # m, as which less than that counts: fingertips are not in objects
_TIP_REACH = 2.0 * FAR  # m, further than which no fingertip is at an object
_OPPOSED = -0.5  # cosine between the ways out of the object at two fingertips


class Met(NamedTuple):
    """A fingertip at an object."""

    gap: float
    """m between the surfaces of fingertip and object"""
    normal: Vector3
    """Surface normal of the object at the fingertip, in the world."""
    point: Vector3
    """Position of the fingertip's centre, m."""


class Gaps:
    """The gaps between fingertips and objects, now and while they touched: both percepts share their error."""

    def __init__(self) -> None:
        self._gaps: dict[Relation, tuple[float, float, float]] = {}  # now and while it touched, m; when, s

    def touching(
        self, gaps: Mapping[Relation, float], known: Collection[Relation], noise: float, now: float
    ) -> set[Relation]:
        """Find the pairs (fingertip, object) that touch at time `now` (s).

        Pairs that were not near enough to have a gap for some time are forgotten: they come to touch anew.

        Args:
            gaps: m, of one object, that is seen.
            known: the pairs that touched before.
            noise: m, of its newest percept: of what is half covered a percept is off, and its gaps count less.
            now: s.
        """
        weight = _weight_of(noise)
        self._gaps = {relation: gap for relation, gap in self._gaps.items() if gap[2] >= now - 2.0 * UNSEEN}
        found = set()
        for relation, gap in gaps.items():
            here, touched, _ = self._gaps.get(relation, (gap, math.inf, now))
            here = gap if math.isinf(touched) else here + weight * (gap - here)
            most = min(FAR, touched + NEAR) if relation in known else min(NEAR, touched + 0.5 * NEAR)
            if here <= most:
                found.add(relation)
                if gap <= touched + 0.5 * NEAR:
                    touched = gap if math.isinf(touched) else touched + SLOWLY * (gap - touched)
            self._gaps[relation] = here, max(touched, _LEAST_GAP), now
        return found


def _weight_of(noise: float) -> float:
    """The gain of a steady Kalman filter whose percepts have that noise (m): `_OF_THE_NEWEST` for the usual one."""
    ratio = max(1.0, noise / _USUAL_NOISE)
    return 1.0 / (1.0 + (1.0 / _OF_THE_NEWEST - 1.0) * ratio**2)


def within(gaps: Mapping[Relation, float], known: Collection[Relation]) -> set[Relation]:
    """Find touches by present gaps alone, for unseen objects of which no earlier gaps are known."""
    return {relation for relation, gap in gaps.items() if gap <= (FAR if relation in known else NEAR)}


def meet(solid: Solid, points: Mapping[str, Vector3]) -> dict[str, Met]:
    """Fingertips around an object, by name.

    Args:
        solid: the object.
        points: centres of the fingertips, m, by name.
    """
    return {tip: near for tip, point in points.items() if (near := _near(solid, point)) is not None}


def _near(solid: Solid, point: Vector3) -> Met | None:
    """A fingertip at an object; None if it is far from it."""
    if math.dist(point, solid.position) > solid.radius + HAND.tip_radius + _TIP_REACH:
        return None
    distance, normal = solid.signed_distance(point)
    gap = distance - HAND.tip_radius
    return Met(gap, normal, point) if -DEEPEST <= gap <= _TIP_REACH else None


class Spans:
    """How far apart the fingertips are that pinch an object: as long as they stay so, it is between them.

    A hand that lets go moves them apart, and they come closer only if nothing is between them. The hand alone tells
    that. The percepts of an object that is half covered may go to and fro in it, but the middle of two fingertips stays
    in what they pinch: a hand that slides off has nothing there.
    """

    def __init__(self) -> None:
        self._spans: dict[Relation, dict[tuple[str, str], tuple[float, int]]] = {}  # m, count; of pairs of fingertips

    def note(self, relation: Relation, fingertips: Mapping[str, Met | None]) -> None:
        """Take in fingertips that pinch: (hand, object)."""
        before = self._spans.get(relation, {})
        spans = {(a, b): math.dist(one.point, two.point) for (a, one), (b, two) in _opposed(fingertips)}
        self._spans[relation] = before | {
            pair: _averaged(*before.get(pair, (0.0, 0)), span) for pair, span in spans.items()
        }

    def keep(self, relations: Collection[Relation]) -> None:
        """Forget all but these (hand, object), which are pinched."""
        self._spans = {relation: spans for relation, spans in self._spans.items() if relation in relations}

    def closed(self, relation: Relation, points: Mapping[str, Vector3], solid: Solid, noise: float) -> set[str]:
        """Fingertips of a hand that have pinched an object, are as far apart as they were then, and still about it.

        Args:
            relation: (hand, object).
            points: centres of its fingertips, m, by name.
            solid: the object, as it is seen.
            noise: m, root mean square error of that.
        """
        slack = FAR * max(1.0, noise / _USUAL_NOISE)  # as far as what touches may seem away
        return {
            tip
            for (a, b), (span, _) in self._spans.get(relation, {}).items()
            if a in points and b in points and abs(math.dist(points[a], points[b]) - span) <= NEAR
            if solid.signed_distance(_middle(points[a], points[b]))[0] <= slack
            for tip in (a, b)
        }


def _middle(a: Vector3, b: Vector3) -> Vector3:
    return 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])


def _averaged(mean: float, count: int, newest: float) -> tuple[float, int]:
    """The mean of the first values, or of about the last ones, and of how many, with one more."""
    return mean + max(SLOWLY, 1.0 / (count + 1)) * (newest - mean), count + 1


def is_opposed(fingertips: Mapping[str, Met | None]) -> bool:
    """Whether two fingertips, of those of which that is known, are on opposite sides with something between them.

    Two that are spread in a container press on its walls the opposite ways, too, but from within.
    """
    return any(True for _ in _opposed(fingertips))


def _opposed(fingertips: Mapping[str, Met | None]) -> Iterator[tuple[tuple[str, Met], tuple[str, Met]]]:
    known = [(tip, met) for tip, met in fingertips.items() if met is not None]
    for (tip, a), (other, b) in combinations(known, 2):
        if _dot(a.normal, b.normal) < _OPPOSED and _dot(a.normal, a.point) > _dot(a.normal, b.point):
            yield (tip, a), (other, b)


def _dot(a: Vector3, b: Vector3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
