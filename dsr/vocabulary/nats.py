"""Costs of the assumptions of an explanation, in nats: minus the logarithm of how probable each is, up to a constant.

All who weigh explanations of what is seen against each other use this one table: the simulation handler for objects
that moved, the calibrator for a camera that moved. ARCHITECTURE.md, "Explaining", gives the reason for each number.
"""

from __future__ import annotations

import math

MOVED = 3.0
"""nats: an object that is seen was moved; about one displacement in twenty."""
MOVED_ALONG = 1.0
"""nats: an object was moved along with what carries it."""
PARTED = 4.0
"""nats: objects that moved together move apart now."""
FROM_ELSEWHERE = 5.0
"""nats: an unseen object is beneath another one now, and was elsewhere."""
AS_PLANNED = 1.0
"""nats: an unseen object is beneath another one now, where a plan puts it."""
HELD = 6.0
"""nats: something unknown holds an object."""
HELD_ON_ITS_WAY = 3.0
"""nats: something unknown holds an object, while percepts show it moving."""
REMOVED = 6.0
"""nats: an object was taken away."""
FELL = 9.0
"""nats: an object fell unseen."""
FELL_IN_VIEW = 4.0
"""nats: an object that was last seen falling fell as it moved then."""
FELL_ON_FROM_THERE = 5.0
"""nats: an object that was last seen falling fell on from there, over the edge in the direction of that motion."""
FALSE_PERCEPT = 3.0
"""nats: the percepts of an object are false."""
FALSE_FRAME = 3.0
"""nats: the percepts of an object are false, for each frame in which they are."""
CAMERA_MOVED = 6.0
"""nats: the camera moved."""
COINCIDENCE = 6.0
"""nats, at least: an object is seen where it was believed to be, through a camera that moved."""
MISSED_FRAME = 3.0
"""nats: an object that should be seen is missing in a frame."""
MOST_MISSED = 15.0
"""nats, at most, of all frames in which an object is missing."""
SEEN_THOUGH_HIDDEN = 12.0
"""nats: an object is seen though another one should hide it."""
LOST_SUPPORT = 0.5
"""nats: an unseen object falls because what carried it is gone."""
MOST_MISFIT = 20.0
"""nats, at most, of a percept that is off: beyond, it is as good as false."""
AS_GOOD = 1.0
"""nats between two explanations that explain the same as well: what noise makes of the same score."""
ACCEPTED = 3600.0
"""s in which one false alarm of an object, a hand or a camera is accepted"""
SURPRISING = math.log(ACCEPTED / 1.0)
"""nats from which something is surprising: by chance this happens once in `ACCEPTED`, as what is seen in 1 s is one
evidence.
"""
