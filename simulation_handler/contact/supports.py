"""Finds the objects that must be beneath one that hovers steadily where it was first seen, though nothing was ever seen
there.

First the objects that are known to exist and were never seen, then a stack of things like itself that nobody
told about. What neither explains is held where it is perceived. This is for first placements: nothing was believed
before, so there is nothing to compare hypotheses with. What happened to objects with a place is for `explaining`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.perception.scales import RESOLUTION
from simulation_handler.contact.placement import find_support, given_height
from simulation_handler.perception.percepts import Array
from simulation_handler.shapes.geometry import Solid

UNKNOWN = ""
"""Name of a support that is no object of the graph."""
_MOST_BENEATH = 4  # count of unseen objects that may be beneath one
MOST_COMBINED = 8
"""count of objects of which all combinations are tried, those that come first: of more that takes too long"""


@dataclass(frozen=True)
class Beneath:
    """The objects that are put beneath a hovering object."""

    stack: tuple[Solid, ...] = ()
    """Objects that were never seen, lowest first."""
    prop: Solid | None = None
    """An unknown support, if no known objects explain it."""


def find_beneath(
    hovering: Solid, covariance: Array, unseen: Mapping[str, Vector3], others: Iterable[Solid], sigmas: float
) -> Beneath | None:
    """Find objects that could carry an object that is steadily perceived above all possible supports;

    None if there are none.

    Args:
        hovering: the object as it is perceived, face down.
        covariance: (3, 3) m^2 of its position.
        unseen: edge lengths (m) of the objects that exist and were never seen, by name, the likeliest first.
        others: all other solids.
        sigmas: standard deviations of its height by which the height of what is beneath may miss.
    """
    level = find_support(hovering, hovering.bottom, [o for o in others if o.top < hovering.bottom], float("inf"))[1]
    if level is None:
        return None
    gap, tolerance = hovering.bottom - level, sigmas * math.sqrt(covariance[2, 2])
    names = _stack_of(gap, unseen, tolerance)
    parts = [(name, unseen[name]) for name in names] or _like(hovering, gap, tolerance)
    if not parts:
        return None
    height = level + sum(size[2] for _, size in parts) + hovering.half_height
    above = hovering.moved(given_height(hovering.position, covariance, height))
    pile = _piled(parts, above, level)
    return Beneath(stack=pile) if names else Beneath(prop=pile[0])


def _like(hovering: Solid, gap: float, tolerance: float) -> list[tuple[str, Vector3]]:
    """One unknown thing as high as a number of objects like the hovering one; none if that does not fit."""
    height = 2.0 * hovering.half_height
    count = round(gap / height)
    if not 1 <= count <= _MOST_BENEATH or abs(gap - count * height) > tolerance:
        return []
    return [(UNKNOWN, (*hovering.size[:2], count * height))]


def _stack_of(gap: float, unseen: Mapping[str, Vector3], tolerance: float) -> tuple[str, ...]:
    """The fewest, then best fitting, then first, whose heights add up to `gap` (m)."""
    return next(iter(stacks_of(gap, unseen, tolerance)), ())


def stacks_of(gap: float, unseen: Mapping[str, Vector3], tolerance: float) -> list[tuple[str, ...]]:
    """Sets of objects whose heights add up to `gap` (m): the fewest first, then the best fitting, then as in `unseen`.

    Of more than eight objects, the first ones count.
    """
    names = list(unseen)[:MOST_COMBINED]
    fitting = []
    for count in range(1, min(_MOST_BENEATH, len(names)) + 1):
        misses = [
            (abs(gap - math.fsum(unseen[name][2] for name in chosen)), chosen)
            for chosen in itertools.combinations(names, count)
        ]
        misses.sort(key=lambda entry: round(entry[0] / RESOLUTION))
        fitting += [chosen for miss, chosen in misses if miss <= tolerance]
    return fitting


def _piled(parts: Sequence[tuple[str, Vector3]], above: Solid, level: float) -> tuple[Solid, ...]:
    """Solids on each other from height `level` (m) upwards, upright, in line with the one above."""
    (ax, ay), (bx, by) = above.footprint[:2]
    rotation = quaternions.from_rotvec((0.0, 0.0, math.atan2(by - ay, bx - ax)))
    x, y, _ = above.position
    pile = []
    for name, size in parts:
        pile.append(Solid(name, size, (x, y, level + 0.5 * size[2]), rotation))
        level += size[2]
    return tuple(pile)
