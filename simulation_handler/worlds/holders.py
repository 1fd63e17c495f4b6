"""Who may hold an object: all human hands that nothing speaks against. They exclude each other."""

from __future__ import annotations

import math
from collections.abc import Mapping

from simulation_handler.hands.covering import is_within_reach
from simulation_handler.hands.state import FINGERS
from simulation_handler.worlds.circumstances import is_unseen
from simulation_handler.worlds.evidence import Evidence, HandEvidence, ObjectEvidence

UNKNOWN = ""
"""Somebody of whom no camera has seen a hand"""


def who_may_hold(name: str, evidence: Evidence) -> tuple[str, ...]:
    """Names of all hands that may hold an object as the simulation has it, the likeliest first; none of a free one.

    What is in the air is in some hand. That it is in one that touches it is no more than presumed, if another hand may
    have it, too. What hovered before that hand came was held by somebody else, and is until it moves.
    """
    thing = evidence.objects[name]
    hands = dict.fromkeys((thing.hand, *thing.held_by) if thing.hand else thing.touched_by)
    if thing.aloft and (thing.hand or not is_unseen(thing, evidence.now)):
        hands |= dict.fromkeys(_within_reach(thing, evidence.hands_free_of_others(name)))
    return (*hands, UNKNOWN) if thing.hand and thing.hovers else tuple(hands)


def shares_of_hold(name: str, evidence: Evidence, taken: float) -> dict[str, float]:
    """How probable it is of each of these hands that it holds an object, if one of them does.

    While the holder is out of sight, any other hand out of sight may have come to it, and have taken the object.

    Args:
        name: of the object.
        evidence: of this moment.
        taken: 1/s, that a hand within reach takes an object.
    """
    hands, free = who_may_hold(name, evidence), evidence.hands_free_of_others(name)
    shares = dict.fromkeys(hands, 1.0 / max(len(hands), 1))
    holder = free.get(evidence.objects[name].hand)
    others = {hand: known for hand, known in sorted(free.items()) if not known.is_seen and hand not in hands}
    if holder is None or holder.is_seen or not others:
        return shares
    begins = (max(holder.pose.stamp, known.pose.stamp) for known in others.values())
    rates = [taken * max(evidence.now - begin, 0.0) for begin in begins]
    if sum(rates) == 0.0:
        return shares
    lost = shares[hands[0]] * -math.expm1(-sum(rates))
    shares[hands[0]] -= lost
    return shares | {hand: lost * rate / sum(rates) for hand, rate in zip(others, rates, strict=True)}


def _within_reach(thing: ObjectEvidence, free: Mapping[str, HandEvidence]) -> list[str]:
    """Names of the hands in sight that have an object within reach, and hide fingertips that may be at it."""
    solid = thing.solid
    if solid is None:
        return []
    hiding = [hand for hand, known in sorted(free.items()) if known.is_seen and len(known.fingertips) < FINGERS]
    return [hand for hand in hiding if is_within_reach(free[hand].pose, solid)]
