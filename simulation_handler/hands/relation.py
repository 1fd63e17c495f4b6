"""What a hand has to do with an object, and which evidence leads from one state to the next: all in one table."""

from __future__ import annotations

from enum import Enum, auto
from types import MappingProxyType

from dsr.vocabulary.handling import HOLDING, Handling
from dsr.vocabulary.observed_actions import PLACE, RELEASE

FREE, TOUCHING, PASSING, PINCHING, HIDING, COVERING, TAKING, PUT_DOWN, DROPPED, LET_GO, LEFT_BEHIND = Handling


class Sign(Enum):
    """Evidence about a hand and an object."""

    TOUCHES = auto()
    """A fingertip has been at the object for a moment, or the object moves in the air with the palm."""
    OPPOSED = auto()
    """Two fingertips have been on opposite sides of it for a moment."""
    SHOWN = auto()
    """It is seen, in touch with the hand."""
    OPEN_AT_REST = auto()
    """It is seen to lie still between fingertips that are apart."""
    OPEN_ALOFT = auto()
    """It is seen in the air with fingertips on one side only."""
    FALLS = auto()
    """It is seen to have come down since the hand last had hold of it, by more than the hand."""
    OPEN_UNSEEN = auto()
    """It is not seen, and fingertips that pinched it are seen apart."""
    ALONG = auto()
    """The palm has moved along it by more than a hand does that closes."""
    HIDDEN = auto()
    """The hand hides it, and those of its own fingertips that would tell, and has touched it for a moment."""
    COVERED = auto()
    """The hand rests, hides it and has it at its fingers, of which too few are seen to tell."""
    TAKEN = auto()
    """The hand that covered it went away, and it is not seen where it was."""
    THROUGH_WALL = auto()
    """It is not seen, and by the palm it would have gone through a wall of what it is in."""
    ABSENT = auto()
    """It should be seen in the hand, and is not, for too long."""
    ELSEWHERE = auto()
    """It is seen where the hand cannot have it."""
    PARTED = auto()
    """The hand touches it no more, and it is not seen, or seen in the air."""
    PARTED_AT_REST = auto()
    """The hand touches it no more, and it is seen to lie still."""


_CONTACT = (FREE, TOUCHING, PASSING, HIDING, COVERING, TAKING, PUT_DOWN, DROPPED, LET_GO)
_LOOSE = (TOUCHING, PASSING, HIDING, PUT_DOWN, DROPPED, LET_GO)
_HELD = (TOUCHING, PASSING, PINCHING, HIDING, PUT_DOWN)
_AT_HAND = (TOUCHING, PASSING, PINCHING, HIDING)

TRANSITIONS = MappingProxyType({
    Sign.TOUCHES: {FREE: TOUCHING},
    Sign.OPPOSED: dict.fromkeys(_CONTACT, PINCHING),
    Sign.SHOWN: dict.fromkeys((HIDING, DROPPED, LET_GO, LEFT_BEHIND), TOUCHING),
    Sign.OPEN_AT_REST: {PINCHING: PUT_DOWN},
    Sign.OPEN_ALOFT: {PINCHING: TOUCHING},
    Sign.FALLS: dict.fromkeys((*_HELD, COVERING, TAKING), DROPPED),
    Sign.OPEN_UNSEEN: {PINCHING: LET_GO},
    Sign.ALONG: {TOUCHING: PASSING},
    Sign.HIDDEN: dict.fromkeys((TOUCHING, PASSING, PUT_DOWN), HIDING),
    Sign.COVERED: dict.fromkeys((FREE, *_LOOSE, LEFT_BEHIND), COVERING),
    Sign.TAKEN: {COVERING: TAKING},
    Sign.THROUGH_WALL: dict.fromkeys(_HELD, LEFT_BEHIND),
    Sign.ABSENT: dict.fromkeys(_HELD, LEFT_BEHIND),
    Sign.ELSEWHERE: dict.fromkeys((*_AT_HAND, COVERING, TAKING), LEFT_BEHIND),
    Sign.PARTED: dict.fromkeys(_AT_HAND, LET_GO),
    Sign.PARTED_AT_REST: dict.fromkeys(_AT_HAND, PUT_DOWN),
})  # fmt: skip
"""By evidence: the next state by the present one. States that are not named stay.

Any state ends, and is `FREE` again, once nothing tells that the hand touches the object: `Touching` forgets it then.
"""

DONE = MappingProxyType({DROPPED: RELEASE, PUT_DOWN: PLACE})
"""What was done with an object, by the state in which its hold ended. After other states its way down tells."""


def after(state: Handling, sign: Sign) -> Handling:
    """The state to which evidence leads from another one."""
    return TRANSITIONS[sign].get(state, state)


def holds(state: Handling, *, held: bool, hovers: bool, seen: bool) -> bool:
    """Whether a hand holds an object.

    Args:
        state: what they have to do with one another.
        held: whether the hand held it the moment before.
        hovers: whether it is in the air, and nothing else is known to hold it.
        seen: whether it is in sight.
    """
    if state in HOLDING:
        return True
    if state is PUT_DOWN:
        return hovers or (held and seen)
    return state in (TOUCHING, PASSING, COVERING) and (hovers or held)


def is_told(state: Handling, *, held: bool) -> bool:
    """Whether an edge `grasping` tells of a hand and an object: a hand that passes by does not grasp the object."""
    return state in (TOUCHING, PINCHING, HIDING, COVERING, TAKING) or (held and state in (PASSING, PUT_DOWN))
