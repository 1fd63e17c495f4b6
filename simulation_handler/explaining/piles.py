"""Which unseen objects may be beneath a seen one, and in which order: those first that moved the least for that."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

from dsr.math3d.quaternions import Vector3
from dsr.perception.scales import SAME_PLACE
from simulation_handler.contact.placement import find_support
from simulation_handler.contact.supports import stacks_of
from simulation_handler.explaining.situation import Situation
from simulation_handler.shapes.geometry import Solid

BREADTH = 3
"""Ways that a search goes on from one place, the best first; so many in vain end it."""


def piles_beneath(
    situation: Situation, name: str, solids: Mapping[str, Solid], missing: Collection[str]
) -> list[tuple[str, ...]]:
    """Unseen objects that fill the gap beneath a seen one; the likeliest first, lowest first in each.

    Likelier are those that a plan put there, that were beneath it, and that are `missing` where they were; then the
    fewest; then those that have moved the least from where they were believed to be.

    Args:
        situation: what is known.
        name: of the seen object.
        solids: where everything is by the hypothesis that is to be extended.
        missing: what that leaves unexplained.
    """
    top, seen = situation.seen[name].percept, situation.seen[name]
    free = _free(situation, name)
    others = [solid for other, solid in solids.items() if other not in free and other != name]
    others += situation.fixtures.values()
    level = find_support(top, top.bottom, [solid for solid in others if solid.top < top.bottom], math.inf)[1]
    if level is None:
        return []
    tolerance = situation.config.explain_sigmas * math.sqrt(seen.covariance[2, 2])
    tolerance = max(tolerance, SAME_PLACE)
    chain = situation.chain_beneath(name)

    def likely(other: str) -> int:
        return ((name, other) in situation.planned or other in chain) + (other in missing)

    preferred = sorted(free, key=lambda other: (-likely(other), _rearranged(situation, (other,), top), other))
    found = stacks_of(top.bottom - level, {other: free[other] for other in preferred}, tolerance)
    piles = [_as_believed(situation, pile) for pile in found]
    return sorted(piles, key=lambda pile: (-sum(map(likely, pile)), len(pile), _rearranged(situation, pile, top)))[
        :BREADTH
    ]


def moved(before: Vector3, after: Vector3) -> float:
    """Measure the way of something, m: sideways plus in height.

    In a tower that was moved far, all cubes have moved by about the same distance, whatever their order is now. Their
    heights tell.
    """
    return math.dist(before[:2], after[:2]) + abs(before[2] - after[2])


def _free(situation: Situation, name: str) -> dict[str, Vector3]:
    """Edge lengths (m) of the boxes that may be anywhere, for nobody sees or holds them."""
    return {
        other: situation.size(other)
        for other in (*situation.believed, *situation.unplaced)
        if situation.is_unseen(other) and other != name
        if not situation.properties[other].shape
    }


def _as_believed(situation: Situation, pile: Collection[str]) -> tuple[str, ...]:
    """Objects in a pile, lowest first, as they stood on each other before, or else by how high they were."""

    def height(name: str) -> float:
        return situation.believed[name].bottom if name in situation.believed else math.inf

    members = set(pile)
    return tuple(sorted(pile, key=lambda name: (len(situation.known_beneath(name) & members), height(name), name)))


def _rearranged(situation: Situation, pile: Sequence[str], top: Solid) -> float:
    """How far (m) the objects of a pile, lowest first, have moved if it is beneath `top` now.

    Of what had no place nothing was believed that could be wrong.
    """
    level, metres = top.bottom, 0.0
    for name in reversed(pile):
        height = situation.size(name)[2]
        if name in situation.believed:
            x, y, _ = top.position
            metres += moved(situation.believed[name].position, (x, y, level - 0.5 * height))
        level -= height
    return metres
