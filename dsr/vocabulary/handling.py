"""What a hand has to do with a thing: the attribute `state` of edges `grasping` and `let_go`."""

from __future__ import annotations

from enum import StrEnum


class Handling(StrEnum):
    """What a hand has to do with a thing."""

    FREE = "free"
    """Nothing."""
    TOUCHING = "touching"
    """Its fingertips are on one side of the thing. It holds the thing if that hovers, or if it held it before."""
    PASSING = "passing"
    """It moves along the thing that it touches."""
    PINCHING = "pinching"
    """Its fingertips are on two opposite sides: it holds the thing."""
    HIDING = "hiding"
    """It hides the thing that it touches, and the fingertips that would tell: it is presumed to hold the thing."""
    COVERING = "covering"
    """It rests and hides the thing at its fingers: it is presumed to touch the thing."""
    TAKING = "taking"
    """It has gone away with the thing that it covered, as far as can be known."""
    PUT_DOWN = "put down"
    """It was seen to open about the thing, or to leave it, as that lay still."""
    DROPPED = "dropped"
    """It opened in the air, and the thing came down from it."""
    LET_GO = "let go"
    """It opened, or touches the thing no more, and the thing was not seen to fall nor to lie."""
    LEFT_BEHIND = "left behind"
    """It has gone on without the thing, which is seen elsewhere, should be seen in it, or could not go that way."""


HOLDING = frozenset({Handling.PINCHING, Handling.HIDING, Handling.TAKING})
"""States in which a hand holds the thing, whatever else is known"""
ENDED = frozenset({Handling.FREE, Handling.DROPPED, Handling.LET_GO, Handling.LEFT_BEHIND})
"""States in which a hand has nothing more to do with the thing"""
