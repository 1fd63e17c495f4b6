"""From a noisy estimate to a pose that physics allows: face down, on its support, beside its neighbours.

A percept that hovers or intersects by no more than its noise is put onto the support under it before it
enters the simulation: interpenetrating bodies would be thrown apart, hovering ones would fall.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dsr.math3d.polygons import Point, are_apart, area, contains, hull, intersection, overlap
from dsr.math3d.quaternions import Vector3
from simulation_handler.config import BeliefConfig
from simulation_handler.perception.percepts import Array
from simulation_handler.scales import GAP, PLACE_FLOOR
from simulation_handler.shapes.geometry import Solid

_SIDE_BY_SIDE = 0.25  # share of the lower one's height above which two bodies are neighbours, not a stack
_SLIVER = 0.1  # share of the smaller footprint below which an overlap does not carry
_ASKEW = 0.003  # rad, from which something leans; the floor of a container seems to be beside what lies on it then
_SWEEPS = 25  # count of passes over all pairs: piles of ten have come apart by then

_Parts = list[tuple[int, int]]  # which parts of two solids are side by side
_Pair = tuple[str, str, _Parts]  # two names, and which parts of the two are side by side


class Placement(NamedTuple):
    """The believed pose of an object, given its percept."""

    solid: Solid
    supports: tuple[str, ...]
    """Names of the bodies it rests on; empty if nothing within reach carries it."""
    covariance: Array
    """(3, 3) m^2 of the position, given its support"""
    is_held: bool = False
    """Whether something unknown keeps it there, beside its supports: physics alone would not"""

    @property
    def rests(self) -> bool:
        """Whether something carries it."""
        return bool(self.supports)


def place(
    percept: Solid, covariance: Array, others: Sequence[Solid], config: BeliefConfig, reach: float | None = None
) -> Placement:
    """The physically plausible pose nearest to an estimate.

    Args:
        percept: the object as it is perceived.
        covariance: (3, 3) m^2 of its position, longest along the viewing ray.
        others: all other solids at their believed poses.
        config: tolerances.
        reach: m above a support within which it rests on that; None for all that may be noise.

    Tilt within the tolerance is removed and yaw kept. The height is that of the highest support within reach;
    the rest of the position follows by conditioning the Gaussian estimate on this height,
    x' = x + S_xz / S_zz (z' - z), so that the depth error is undone along the viewing ray.
    An object that nothing can carry stays as it is perceived, only not inside what is below it.
    """
    flat, tilt = percept.face_down()
    upright, reach = tilt <= config.tilt_tolerance, config.hover_tolerance if reach is None else reach
    solid = posed = flat if upright else percept
    for _ in range(2):  # the support is looked for where the object is once its height is right
        supports, level = find_support(solid, posed.bottom, others, reach)
        if level is not None:
            solid = posed.moved(given_height(posed.position, covariance, level + posed.half_height))
    if level is None:
        return Placement(_above(percept, covariance, others), (), covariance)
    return Placement(solid, supports if upright else (), covariance_given_height(covariance))


def placed_again(percept: Solid, covariance: Array, before: Placement, config: BeliefConfig) -> Placement | None:
    """As `place`, of what rested as it did `before`, if that carries it still; None if something else may."""
    flat, tilt = percept.face_down()
    level = before.solid.bottom
    if not before.rests or tilt > config.tilt_tolerance or abs(flat.bottom - level) > config.hover_tolerance:
        return None
    solid = flat.moved(given_height(flat.position, covariance, level + flat.half_height))
    return Placement(solid, before.supports, covariance_given_height(covariance))


def find_support(
    solid: Solid, bottom: float, others: Iterable[Solid], reach: float
) -> tuple[tuple[str, ...], float | None]:
    """Find the objects that carry `solid` if its lowest point is perceived at height `bottom` (m), and their height.

    Of all tops within `reach` of its bottom (or, of fixed solids, inside which it cannot be), the highest
    level that is under its centre of mass: within the hull of the areas in which it touches that level.
    Slivers do not carry: they come from sideways noise.
    """
    touching = [
        (lower.top - above, lower.name, shared)
        for other in near(solid, others)
        for part, lower in itertools.product(solid.parts, other.parts)
        if lower.position[2] <= part.position[2] or not _is_content(other, solid)
        for above in [part.bottom - solid.bottom]
        if (shared := _common(part, bottom + above, lower, reach))
    ]
    touching.sort(reverse=True)
    while touching:
        level = touching[0][0]
        carrying = [entry for entry in touching if level - entry[0] <= PLACE_FLOOR]
        carried = hull([point for entry in carrying for point in entry[2]]) if len(carrying) > 1 else touching[0][2]
        if contains(carried, solid.position[:2]):
            return tuple(sorted({entry[1] for entry in carrying})), level
        touching = touching[len(carrying) :]
    return (), None


def _common(solid: Solid, bottom: float, other: Solid, reach: float) -> Sequence[Point]:
    """The area in which `solid` would touch the top of `other`; empty if that is out of reach."""
    gap = bottom - other.top
    inside_fixed = other.fixed and gap < 0.0 and bottom + solid.half_height > other.bottom
    if not (abs(gap) <= reach or inside_fixed) or not near(solid, (other,)):
        return ()
    common = intersection(solid.footprint, other.footprint)
    return common if area(common) >= _SLIVER * min(area(solid.footprint), area(other.footprint)) else ()


def _is_content(other: Solid, solid: Solid) -> bool:
    return solid.is_hollow and solid.reaches_around(other.position)


def _above(solid: Solid, covariance: Array, others: Iterable[Solid]) -> Solid:
    """An unsupported solid, moved along the viewing ray until it does not reach into what it partly is above."""
    levels = [
        lower.top - (part.bottom - solid.bottom)
        for other in near(solid, others)
        for part, lower in itertools.product(solid.parts, other.parts)
        if _reaches_into(part, lower)
    ]
    level = max(levels, default=solid.bottom)
    if level <= solid.bottom:
        return solid
    return solid.moved(given_height(solid.position, covariance, level + solid.half_height))


def _reaches_into(solid: Solid, lower: Solid) -> bool:
    """Whether the bottom of `solid` is inside the upper part of `lower`."""
    is_lower = lower.top > solid.bottom and lower.position[2] < solid.position[2]
    if not is_lower or not near(solid, (lower,)) or are_side_by_side(solid, lower):
        return False
    return area(intersection(solid.footprint, lower.footprint)) > 0.0


def near(solid: Solid, others: Iterable[Solid]) -> list[Solid]:
    """The other solids whose footprints can overlap with that of `solid` at all."""
    (x, y, _), radius = solid.position, solid.radius
    return [
        other
        for other in others
        if abs(other.position[0] - x) <= radius + other.radius and abs(other.position[1] - y) <= radius + other.radius
    ]


def given_height(position: Vector3, covariance: Array, height: float) -> Vector3:
    """Mean of a Gaussian position (3,) m, once its height is known to be `height` m."""
    (x, y, z), (sideways, ahead, upwards) = position, covariance[:, 2].tolist()
    off = height - z
    return x + sideways / upwards * off, y + ahead / upwards * off, z + upwards / upwards * off


def _by_height(covariance: Array) -> Array:
    """(3,) 1, by how much a Gaussian position moves for each metre that its height turns out to be off."""
    return np.asarray(covariance[:, 2] / covariance[2, 2])


def covariance_given_height(covariance: Array, error: float = GAP) -> Array:
    """(3, 3) m^2 of a Gaussian position, once its height is known up to `error` (m, standard deviation)."""
    column, along = covariance[:, 2], _by_height(covariance)
    rest: Array = covariance - column[:, None] * column / column[2] + error**2 * along[:, None] * along
    return rest


class Pairs:
    """What was worked out of pairs of solids, for as long as the same solids are asked about again and again."""

    def __init__(self) -> None:
        self._parts: dict[tuple[int, int], tuple[Solid, Solid, _Parts]] = {}
        self._overlaps: dict[tuple[int, int], tuple[Solid, Solid, tuple[float, Point]]] = {}

    def side_by_side(self, a: Solid, b: Solid) -> _Parts:
        """Which parts of two solids share a height, so that they are or could be in each other's way."""
        known = self._parts.get((id(a), id(b)))
        if known is None:
            parts = _side_by_side_parts(a, b)
            is_upright = not parts or max(a.face_down()[1], b.face_down()[1]) <= _ASKEW
            known = self._parts[id(a), id(b)] = a, b, parts if is_upright else []
        return known[2]

    def overlap(self, a: Solid, b: Solid, parts: _Parts) -> tuple[float, Point]:
        """How deep (m) the parts overlap that do so most, and in which direction `a` gets out; 0 if none do."""
        known = self._overlaps.get((id(a), id(b)))
        if known is None:
            outlines = ((a.parts[i].footprint, b.parts[j].footprint) for i, j in parts)
            overlaps = [overlap(*both) for both in outlines if not are_apart(*both)]
            known = self._overlaps[id(a), id(b)] = a, b, max(overlaps, default=(0.0, (0.0, 0.0)))
        return known[2]


def separate(
    solids: Sequence[Solid],
    weights: Mapping[str, float],
    around: Collection[str] | None = None,
    known: Pairs | None = None,
) -> dict[str, Vector3]:
    """Push overlapping solids apart sideways, and return the new positions of the solids that had to give way.

    Args:
        solids: at their desired poses.
        weights: how easily each gives way, by name, relative to the others; 0 for never.
        around: names of those that may overlap with others, or push them into others; None if all may.
        known: what was worked out of some of the same solids before.
    """
    known = known or Pairs()
    placed, order = {solid.name: solid for solid in solids}, {solid.name: k for k, solid in enumerate(solids)}
    pairs: dict[tuple[int, int], _Pair] = {}
    left, moved = list(solids), set[str]()
    reached = order.keys() if around is None else order.keys() & around
    for _ in range(_SWEEPS):
        for solid in [solid for solid in left if solid.name in reached]:
            left.remove(solid)
            for pair in _neighbours(solid, left, weights, order, known):
                pairs[order[pair[0]], order[pair[1]]] = pair
        pushed = [pairs[key] for key in sorted(pairs) if _push_apart(placed, pairs[key], weights, known)]
        if not pushed:
            break
        reached = {name for a, b, _ in pushed for name in (a, b)}
        moved |= reached
    return {name: placed[name].position for name in sorted(moved) if weights.get(name, 0.0) > 0.0}


def _neighbours(
    solid: Solid, others: Iterable[Solid], weights: Mapping[str, float], order: Mapping[str, int], known: Pairs
) -> Iterator[_Pair]:
    """Pairs with a solid of which parts share a height and are, or could soon be, in each other's way; in `order`."""
    for other in near(solid, others):
        a, b = (solid, other) if order[solid.name] < order[other.name] else (other, solid)
        if weights.get(a.name, 0.0) + weights.get(b.name, 0.0) <= 0.0:
            continue
        if parts := known.side_by_side(a, b):
            yield a.name, b.name, parts


def _side_by_side_parts(a: Solid, b: Solid) -> list[tuple[int, int]]:
    """By their numbers; the floor of a container is not beside what is in it."""
    return [
        (i, j)
        for i, p in enumerate(a.parts)
        for j, q in enumerate(b.parts)
        if are_side_by_side(p, q) and not (_is_floor(a, p, b) or _is_floor(b, q, a))
    ]


def _is_floor(container: Solid, part: Solid, solid: Solid) -> bool:
    """Whether a part of a container is beneath the centre of what is in it, which may reach into it a little."""
    return (
        _is_content(solid, container)
        and part.top < solid.position[2]
        and contains(part.footprint, solid.position[:2])
    )  # fmt: skip


def are_side_by_side(a: Solid, b: Solid) -> bool:
    """Whether two bodies share so much of their heights that neither stands on the other."""
    common = min(a.top, b.top) - max(a.bottom, b.bottom)
    return common > _SIDE_BY_SIDE * 2.0 * min(a.half_height, b.half_height)


def _push_apart(placed: dict[str, Solid], pair: _Pair, weights: Mapping[str, float], known: Pairs) -> bool:
    """Move the two so that the parts that overlap most do not; false if none did."""
    a, b = placed[pair[0]], placed[pair[1]]
    depth, (x, y) = known.overlap(a, b, pair[2]) if near(a, (b,)) else (0.0, (0.0, 0.0))
    if depth <= 0.0:
        return False
    share = weights.get(a.name, 0.0) / (weights.get(a.name, 0.0) + weights.get(b.name, 0.0))
    for solid, push in ((a, share * (depth + GAP)), (b, (share - 1.0) * (depth + GAP))):
        px, py, pz = solid.position
        placed[solid.name] = solid.moved((px + push * x, py + push * y, pz))
    return True
