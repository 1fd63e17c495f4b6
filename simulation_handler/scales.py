"""Lengths, times and levels of certainty that rules of the belief share: each means the same for all of them."""

from __future__ import annotations

import math
import sys

from dsr.perception.noise import PerceptNoise
from dsr.vocabulary.nats import FALSE_FRAME, SURPRISING

RESOLUTION = 0.001
"""m, lengths that differ by less are the same: so close, physics counts surfaces as touching."""
PLACE_FLOOR = 0.002
"""m, standard deviation of what is no noise of percepts: of bodies in contact, of models"""
OWN_ERROR = RESOLUTION
"""m, systematic error of depth of its own that one more thing is imagined to have, beside those that are known"""
TURN_FLOOR = 0.03
"""rad, likewise"""
SAME_OUTCOME = 0.005
"""m, by which places may differ that physics alone makes of the same beginning"""
SAME_PLACE = 0.010
"""m, from which a place is another one: less is noise of percepts"""
UNSEEN_SLACK = 0.010
"""m, standard deviation of where what is not seen really is, about where a hypothesis says it is"""
ASTRAY = math.sqrt(2.0 * SURPRISING) * PerceptNoise().depth_noise
"""m, from which it is surprising that percepts of the same place are so far apart"""
GONE_FROM = 0.020
"""m from where it was, from which an object has surely left there"""
HAND_REACH = 0.15
"""m from palm or fingertips to what a hand may take or move: a finger's length, and the error of a half-hidden palm"""
UNSEEN_VARIANCE = SAME_OUTCOME**2
"""m^2, sideways, of an object left to physics: it gives way to what is seen"""

FRAME = 0.1
"""s between two images of a camera"""
ONE_MOMENT = 0.15
"""s between percepts of one moment: less than two images"""
PRESENT = 0.25
"""s, age up to which a percept shows the present: one image may be missed"""
CONFIRM_FRAMES = math.ceil(SURPRISING / FALSE_FRAME)
"""Images in a row that must show something: fewer may be false."""
CONFIRMED_IN = CONFIRM_FRAMES * FRAME
"""s of images that are surely not all false"""
AT_REST = 2.0 * CONFIRMED_IN
"""s for which what is at rest is seen to stay where it is, in each half of them"""
STEADY = 1.0
"""s after which it is known that something goes on: the mean of ten percepts tells that"""
CONTACT_DELAY = 0.2
"""s that a contact must last to tell a relation, and be gone to end it"""
LONGEST_GAP = 0.45
"""s between two percepts of a way without a break"""
TICK_SLACK = 0.001
"""s by which a tick may be early"""

TILTED = 0.44
"""rad that something may seem tilted by noise alone"""
UNSEEN_AFTER = 0.7
"""s without a percept after which something is not seen any more (Sallami et al., Table I)"""

FASTEST_SEEN = 1.2
"""m/s at which hands move things, at most"""
SLOW = 0.05
"""m/s up to which a body counts as at rest"""

LIKELY_SIGMAS = 2.0
"""Standard deviations up to which a value is taken for noise."""
SURE_SIGMAS = 2.5
"""Standard deviations beyond which a value is taken for more than noise."""
DIAGONAL = math.sqrt(0.5)
"""Cosine of 45 degrees: a direction is nearer to another one than to all that is across that."""
ROUNDING = math.sqrt(sys.float_info.epsilon)
"""1, error of a result of 1 that was computed from many numbers."""


def even_spread(width: float) -> float:
    """Standard deviation of a value that is anywhere within an interval of that width, as probable everywhere."""
    return width / math.sqrt(12.0)  # 1, by the integral over the interval
