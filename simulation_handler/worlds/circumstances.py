"""In which circumstance an object is: what its place is known by, and so how well."""

from __future__ import annotations

from typing import Final

from simulation_handler.hands.state import UNSEEN
from simulation_handler.worlds.evidence import Evidence, ObjectEvidence

RESTS: Final = "rests in view"
TOUCHED: Final = "touched in view"
HELD: Final = "held in view"
MOVES: Final = "moves in view"
DOUBTED: Final = "seen by doubted cameras"
GRIPPED: Final = "in a gripper"
RESTS_UNSEEN: Final = "rests unseen"
VANISHED: Final = "vanished on its way"
MOVED_UNSEEN: Final = "moved unseen"
HELD_UNSEEN: Final = "held unseen"
HELD_OUT_OF_SIGHT: Final = "held out of sight"
INSIDE: Final = "moved inside something"

CIRCUMSTANCES: Final = (
    *(RESTS, TOUCHED, HELD, MOVES, DOUBTED, GRIPPED, RESTS_UNSEEN, VANISHED, MOVED_UNSEEN),
    *(HELD_UNSEEN, HELD_OUT_OF_SIGHT, INSIDE),
)
"""All of them"""
_MOVED = 0.02  # m from where it was seen last, from which an unseen object has been moved by the simulation


def is_unseen(thing: ObjectEvidence, now: float) -> bool:
    """Whether an object has not been recognised lately, at time `now` (s)."""
    return now - thing.seen_at > UNSEEN


def in_view(thing: ObjectEvidence) -> str:
    """The circumstance of an object that is recognised."""
    if thing.gripper:
        return GRIPPED
    if thing.hand:
        return HELD
    if thing.is_doubted:
        return DOUBTED
    if thing.driven or thing.rides or thing.is_moving or thing.hovers:
        return MOVES
    return TOUCHED if thing.touched_by else RESTS


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
    if moved > _MOVED:
        return INSIDE if thing.container else MOVED_UNSEEN
    if thing.container and before not in (RESTS, TOUCHED):
        return INSIDE
    return RESTS_UNSEEN if before in (RESTS, TOUCHED) else VANISHED


def held(hand: str, evidence: Evidence) -> str:
    """The circumstance of an unseen object in a hand."""
    known = evidence.hands.get(hand)
    return HELD_UNSEEN if known is not None and known.is_seen else HELD_OUT_OF_SIGHT
