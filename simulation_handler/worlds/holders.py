"""Who may hold an object: all human hands that nothing speaks against. They exclude each other."""

from __future__ import annotations

from simulation_handler.hands.covering import is_within_reach
from simulation_handler.hands.state import FINGERS
from simulation_handler.worlds.circumstances import is_unseen
from simulation_handler.worlds.evidence import Evidence, HandEvidence


def who_may_hold(name: str, evidence: Evidence) -> tuple[str, ...]:
    """Names of the human hands that may hold an object as the simulation has it, the likeliest first.

    What is in the air is in some hand. That it is in one that touches it is no more than presumed, if another hand that
    has nothing else has it within reach and its fingertips do not tell that it is free.
    """
    thing = evidence.objects[name]
    hands = dict.fromkeys((thing.hand, *thing.held_by) if thing.hand else thing.touched_by)
    if thing.aloft and thing.solid is not None and (thing.hand or not is_unseen(thing, evidence.now)):
        free = sorted(evidence.hands_free_of_others(name).items())
        solid = thing.solid
        hands |= dict.fromkeys(
            hand for hand, known in free if _may_touch(known) and is_within_reach(known.pose, solid)
        )
    return tuple(hands)


def _may_touch(known: HandEvidence) -> bool:
    """Whether a hand may touch something unseen: not all of its fingertips are in sight."""
    return not known.is_seen or len(known.fingertips) < FINGERS
