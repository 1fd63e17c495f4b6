"""Lengths, times and levels of certainty that all who weigh percepts share: each means the same for every agent."""

from __future__ import annotations

import math
from statistics import NormalDist

from dsr.perception.noise import PerceptNoise
from dsr.vocabulary.nats import FALSE_FRAME, MISSED_FRAME, RARE, SURPRISING

RESOLUTION = 0.001
"""m, lengths that differ by less are the same: so close, physics counts surfaces as touching."""
SAME_PLACE = PerceptNoise().depth_bias
"""m, from which a place is another one: less may be the systematic error of percepts"""
SAME_OUTCOME = 0.5 * SAME_PLACE
"""m, by which places may differ that physics alone makes of the same beginning: two of them are the same place yet"""

FRAME = 0.1
"""s between two images of a camera"""
_LATE = 0.5 * FRAME
"""s by which an image may be late: later, it would rather be the next one"""
TICK_RATE = 2.0 / FRAME
"""Hz, of agents that follow cameras: an image waits for no longer than it may be late"""
ONE_MOMENT = FRAME + _LATE
"""s between percepts of one moment: less than two images"""
PRESENT = 2.0 * FRAME + _LATE
"""s, age up to which a percept shows the present: one image may be missed"""
CONFIRM_FRAMES = math.ceil(SURPRISING / FALSE_FRAME)
"""Images in a row that must show something: fewer may be false."""
CONFIRMED_IN = CONFIRM_FRAMES * FRAME
"""s of images that are surely not all false"""
AT_REST = 2.0 * CONFIRMED_IN
"""s for which what is at rest is seen to stay where it is, in each half of them"""
RECENT_PERCEPTS = 10
"""Percepts of an object at rest whose mean tells what a single one does not: a small move, the error of depth."""
SLOWLY = 1.0 / RECENT_PERCEPTS
"""Weight of the newest, by which what changes little is averaged over as many"""
WINDOW = round((SAME_PLACE / RESOLUTION) ** 2)
"""Percepts over which something at rest is averaged: errors that seem to be another place are `RESOLUTION` then"""
STEADY = RECENT_PERCEPTS * FRAME
"""s after which it is known that something goes on: the mean of so many percepts tells that"""
CONTACT_DELAY = 2.0 * FRAME
"""s that a contact must last to tell a relation, and be gone to end it: until two images could have shown that"""
LONGEST_GAP = (math.ceil(SURPRISING / MISSED_FRAME) + 1) * FRAME + _LATE
"""s between two percepts of a way without a break: it would be surprising to miss more images in a row"""
UNSEEN_AFTER = 0.7
"""s without a percept after which something is not seen any more (Sallami et al., Table I)"""

LIKELY_SIGMAS = NormalDist().inv_cdf(1.0 - 0.5 * math.exp(-RARE))
"""Standard deviations up to which a value is taken for noise: farther off, on either side, is rare."""
SURE_SIGMAS = math.sqrt(2.0 * RARE)
"""Standard deviations beyond which a value is taken for more than noise: something rare explains it as well."""

FASTEST_SEEN = 1.2
"""m/s at which hands move things, at most"""
HAND_SPEED = FASTEST_SEEN / LIKELY_SIGMAS
"""m/s, standard deviation of each part of the velocity of a hand and of what it moves"""
SLOW = SAME_OUTCOME / FRAME
"""m/s up to which a body counts as at rest: from one image to the next it gets no farther than to the same place"""

BUMP = 0.05
"""m and rad, standard deviation along and about each axis by which whoever touches its stand moves a camera: seldom by
more than 0.1
"""
STANDING = 0.3
"""rad that a thing may be off from how it stands and still count as standing so"""
