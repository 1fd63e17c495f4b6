"""Who may hold an object: all human hands that nothing speaks against. They exclude each other."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import zip_longest

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

    While the holder is out of sight, all hands out of sight may take the object from each other.

    Args:
        name: of the object.
        evidence: of this moment.
        taken: 1/s, that a hand within reach takes an object.
    """
    hands = who_may_hold(name, evidence)
    if not hands:
        return {}
    free = evidence.hands_free_of_others(name)
    shares = dict.fromkeys(hands, 1.0 / len(hands))
    holder = free.get(evidence.objects[name].hand)
    if holder is None or holder.is_seen:
        return shares
    others = {hand: known for hand, known in sorted(free.items()) if not known.is_seen and hand not in hands}
    hidden = {hand: max(holder.pose.stamp, known.pose.stamp) for hand, known in others.items()}
    begins = {hand: begin for hand, begin in hidden.items() if begin < evidence.now}
    passed = _passed_on(hands[0], begins, evidence.now, taken)
    return shares | {hand: shares[hands[0]] * share for hand, share in passed.items()}


def _passed_on(holder: str, begins: Mapping[str, float], now: float, taken: float) -> dict[str, float]:
    """Probabilities of hands that pass an object on from any to any at the rate `taken` (1/s), at the time `now` (s).

    They are those of a Markov chain that begins with the holder. After a long time, all of them are alike.

    Args:
        holder: name of the hand that had it.
        begins: s, from when another hand may have it, by its name; all before `now`.
        now: s
        taken: 1/s, of each ordered pair of hands.
    """
    shares, begun = {holder: 1.0}, sorted(begins, key=lambda hand: (begins[hand], hand))
    for hand, following in zip_longest(begun, begun[1:]):
        shares[hand] = 0.0
        lasted = (now if following is None else begins[following]) - begins[hand]
        mean, kept = 1.0 / len(shares), math.exp(-taken * len(shares) * lasted)
        shares = {name: mean + (share - mean) * kept for name, share in shares.items()}
    return shares


def _within_reach(thing: ObjectEvidence, free: Mapping[str, HandEvidence]) -> list[str]:
    """Names of the hands in sight that have an object within reach, and hide fingertips that may be at it."""
    solid = thing.solid
    if solid is None:
        return []
    hiding = [hand for hand, known in sorted(free.items()) if known.is_seen and len(known.fingertips) < FINGERS]
    return [hand for hand in hiding if is_within_reach(free[hand].pose, solid)]
