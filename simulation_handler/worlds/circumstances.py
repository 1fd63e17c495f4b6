"""In which circumstance an object is: what its place is known by, and so how well."""

from __future__ import annotations

from typing import Final

from simulation_handler.hands.state import UNSEEN
from simulation_handler.scales import GONE_FROM
from simulation_handler.worlds.evidence import Evidence, ObjectEvidence

RESTS: Final = "rests in view"
TOUCHED: Final = "touched in view"
HELD: Final = "held in view"
MOVES: Final = "moves in view"
RIDES: Final = "goes along in view"
HOVERS: Final = "hovers in view"
RESTLESS: Final = "percepts contradict each other"
DOUBTED: Final = "seen by doubted cameras"
FOUND_ANEW: Final = "rests in view after cameras were in doubt"
GRIPPED: Final = "in a gripper"
RESTS_UNSEEN: Final = "rests unseen"
VANISHED: Final = "vanished on its way"
MOVED_UNSEEN: Final = "moved unseen"
HELD_UNSEEN: Final = "held unseen"
HELD_OUT_OF_SIGHT: Final = "held out of sight"
INSIDE: Final = "moved inside something"

IN_VIEW: Final = (RESTS, TOUCHED, HELD, MOVES, RIDES, HOVERS, RESTLESS, DOUBTED, FOUND_ANEW, GRIPPED)
"""Those of objects that are recognised, or in a gripper"""
OUT_OF_VIEW: Final = (RESTS_UNSEEN, VANISHED, MOVED_UNSEEN, HELD_UNSEEN, HELD_OUT_OF_SIGHT, INSIDE)
"""Those in which an object may be elsewhere: alternatives tell of that"""
CIRCUMSTANCES: Final = (*IN_VIEW, *OUT_OF_VIEW)
"""All of them"""
ON_ITS_WAY: Final = (MOVES, RIDES, HOVERS, RESTLESS, HELD)
"""Those from which an object may go anywhere once it is not seen any more"""


HELD_ALOFT: Final = "held in view, in the air"
HELD_LYING: Final = "held in view, on something"
HELD_OPENING: Final = "held in view, on something, by fingers that open"
WITHIN_REACH: Final = "in view, in the air, within reach of hidden fingers"


def is_unseen(thing: ObjectEvidence, now: float) -> bool:
    """Whether an object has not been recognised lately, at time `now` (s)."""
    return now - thing.seen_at > UNSEEN


def in_view(thing: ObjectEvidence, *, stays: float, was_doubted: bool) -> str:
    """The likeliest circumstance of an object that is recognised.

    Args:
        thing: the object.
        stays: 1, probability that it is where the simulation has it though it is seen displaced; 0 if it is not.
        was_doubted: whether cameras that saw it have been in doubt.
    """
    first_that_is_so = (
        (GRIPPED, bool(thing.gripper)),
        (HELD, bool(thing.hand)),
        (DOUBTED, stays > 1.0 - stays),
        (MOVES, thing.driven),
        (RIDES, thing.rides),
        (HOVERS, thing.hovers),
        (RESTLESS, thing.is_moving or thing.is_doubted),
        (TOUCHED, bool(thing.touched_by)),
        (FOUND_ANEW, was_doubted),
    )
    return next((circumstance for circumstance, is_so in first_that_is_so if is_so), RESTS)


def unseen(thing: ObjectEvidence, evidence: Evidence, moved: float, before: str) -> str:
    """The circumstance of an object that is not recognised, as the simulation has it.

    Args:
        thing: the object.
        evidence: of the same moment.
        moved: m, how far the simulation has moved it since it was recognised.
        before: its circumstance when it was recognised last.
    """
    if thing.gripper:
        return GRIPPED
    if thing.hand:
        return held(thing.hand, evidence)
    if moved > GONE_FROM:
        return INSIDE if thing.container else MOVED_UNSEEN
    if before not in ON_ITS_WAY:
        return RESTS_UNSEEN
    return INSIDE if thing.container else VANISHED


def hold(thing: ObjectEvidence, circumstance: str) -> str:
    """How a hand seems to hold or touch an object that is in a circumstance: what tells whether it does hold it.

    What is in the air is held, or falls. What lies on something may be held or just touched; fingers that open let go.
    What no hand touches is asked about only in the air, within reach of a hand that hides fingertips. What hovers is in
    the hand of somebody unknown, or in the one that touches it by now.
    """
    if not thing.hand and (circumstance == HOVERS or not thing.touched_by):
        return WITHIN_REACH
    if circumstance == DOUBTED:
        return TOUCHED
    if circumstance != HELD:
        return circumstance
    return HELD_ALOFT if thing.aloft else HELD_OPENING if thing.opens else HELD_LYING


def held(hand: str, evidence: Evidence) -> str:
    """The circumstance of an unseen object in a hand."""
    known = evidence.hands.get(hand)
    return HELD_UNSEEN if known is not None and known.is_seen else HELD_OUT_OF_SIGHT
