"""Costs of the assumptions of an explanation, in nats: minus the logarithm of how probable each is, up to a constant.

All who weigh explanations of what is seen against each other use this one table: the simulation handler for objects
that moved, the calibrator for a camera that moved. ARCHITECTURE.md, "Explaining", gives the reason for each number.
"""

from __future__ import annotations

import math

EXPECTED = 1.0
"""nats: about one case in three. Probabilities are known so roughly that few levels of them are told apart."""
RARE = 3.0
"""nats: about one case in twenty"""
VERY_RARE = 2.0 * RARE
"""nats: as two rare things at once"""

MOVED = RARE
"""nats: an object that is seen was moved."""
MOVED_ALONG = EXPECTED
"""nats: an object was moved along with what carries it."""
PARTED = RARE + EXPECTED
"""nats: objects that moved together move apart now."""
AS_PLANNED = EXPECTED
"""nats: an unseen object is beneath another one now, where a plan puts it."""
FROM_ELSEWHERE = RARE + 2.0 * EXPECTED
"""nats: an unseen object is beneath another one now, and was elsewhere."""
HELD = VERY_RARE
"""nats: something unknown holds an object."""
HELD_ON_ITS_WAY = RARE
"""nats: something unknown holds an object, while percepts show it moving."""
LEANS = RARE
"""nats: an object beside another one leans on it."""
REMOVED = VERY_RARE
"""nats: an object was taken away."""
FELL = VERY_RARE + RARE
"""nats: an object fell unseen."""
FELL_IN_VIEW = RARE + EXPECTED
"""nats: an object that was last seen falling fell as it moved then."""
FELL_ON_FROM_THERE = FELL_IN_VIEW + EXPECTED
"""nats: an object that was last seen falling fell on from there, over the edge in the direction of that motion."""
FALSE_PERCEPT = RARE
"""nats: the percepts of an object are false."""
FALSE_FRAME = RARE
"""nats: the percepts of an object are false, for each frame in which they are."""
CAMERA_MOVED = VERY_RARE
"""nats: the camera moved."""
COINCIDENCE = VERY_RARE
"""nats, at least: an object is seen where it was believed to be, through a camera that moved."""
AGAIN = 0.5 * RARE
"""nats: a frame is wrong as the one before was, 0.1 s ago: what is wrong in one is so in the next."""
MISSED_FRAME = RARE
"""nats: an object that should be seen is missing in a frame."""
SEEN_THOUGH_HIDDEN = 2.0 * VERY_RARE
"""nats: an object is seen though another one should hide it."""
MOST_MISSED = SEEN_THOUGH_HIDDEN + RARE
"""nats, at most, of all frames in which an object is missing."""
CONSEQUENCE = 0.5 * EXPECTED
"""nats: an unseen object falls because what carried it is gone, or is pushed along by what moved against it."""
MOST_MISFIT = MOST_MISSED + REMOVED
"""nats, at most, of a percept that is off: beyond, the object is elsewhere, was taken there, and is missing here."""
AS_GOOD = EXPECTED
"""nats between two explanations that explain the same as well: what noise makes of the same score."""
ACCEPTED = 3600.0
"""s in which one false alarm of an object, a hand or a camera is accepted"""
SURPRISING = math.log(ACCEPTED / 1.0)
"""nats from which something is surprising: by chance this happens once in `ACCEPTED`, as what is seen in 1 s is one
evidence.
"""
DECIDE = math.ceil(SURPRISING / FALSE_FRAME)
"""count of percepts that are off alike, from which they can be surprising: fewer may be false"""
