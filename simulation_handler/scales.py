"""Lengths, times and levels of certainty that rules of the belief share: each means the same for all of them."""

from __future__ import annotations

import math
import sys
from statistics import NormalDist

from dsr.perception.noise import PerceptNoise
from dsr.vocabulary.nats import FALSE_FRAME, MISSED_FRAME, RARE, SURPRISING

RESOLUTION = 0.001
"""m, lengths that differ by less are the same: so close, physics counts surfaces as touching."""
PLACE_FLOOR = 2.0 * RESOLUTION
"""m, standard deviation of what is no noise of percepts: of bodies in contact, both of which are known so well"""
OWN_ERROR = RESOLUTION
"""m, systematic error of depth of its own that one more thing is imagined to have, beside those that are known"""
TURN_FLOOR = 0.03
"""rad, likewise"""
SAME_PLACE = PerceptNoise().depth_bias
"""m, from which a place is another one: less may be the systematic error of percepts"""
SAME_OUTCOME = 0.5 * SAME_PLACE
"""m, by which places may differ that physics alone makes of the same beginning: two of them are the same place yet"""
UNSEEN_SLACK = SAME_PLACE
"""m, standard deviation of where what is not seen really is, about where a hypothesis says it is"""
ASTRAY = math.sqrt(2.0 * SURPRISING) * PerceptNoise().depth_noise
"""m from where it is known to be, from which it is surprising that something is seen so far away by noise alone"""
GONE_FROM = 2.0 * SAME_PLACE
"""m from where it was, from which an object has surely left there: both places may be off"""
UNSEEN_VARIANCE = SAME_OUTCOME**2
"""m^2, sideways, of an object left to physics: it gives way to what is seen"""

FRAME = 0.1
"""s between two images of a camera"""
_LATE = 0.5 * FRAME
"""s by which an image may be late: later, it would rather be the next one"""
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
STEADY = 1.0
"""s after which it is known that something goes on: the mean of ten percepts tells that"""
CONTACT_DELAY = 2.0 * FRAME
"""s that a contact must last to tell a relation, and be gone to end it: until two images could have shown that"""
LONGEST_GAP = (math.ceil(SURPRISING / MISSED_FRAME) + 1) * FRAME + _LATE
"""s between two percepts of a way without a break: it would be surprising to miss more images in a row"""
TICK_SLACK = 0.001
"""s by which a tick may be early"""

TILTED = 0.44
"""rad that something may seem tilted by noise alone"""
UNSEEN_AFTER = 0.7
"""s without a percept after which something is not seen any more (Sallami et al., Table I)"""

FASTEST_SEEN = 1.2
"""m/s at which hands move things, at most"""
SLOW = SAME_OUTCOME / FRAME
"""m/s up to which a body counts as at rest: from one image to the next it gets no farther than to the same place"""

LIKELY_SIGMAS = NormalDist().inv_cdf(1.0 - 0.5 * math.exp(-RARE))
"""Standard deviations up to which a value is taken for noise: farther off, on either side, is rare."""
SURE_SIGMAS = math.sqrt(2.0 * RARE)
"""Standard deviations beyond which a value is taken for more than noise: something rare explains it as well."""
DIAGONAL = math.sqrt(0.5)
"""Cosine of 45 degrees: a direction is nearer to another one than to all that is across that."""
ROUNDING = math.sqrt(sys.float_info.epsilon)
"""1, error of a result of 1 that was computed from many numbers."""


def even_spread(width: float) -> float:
    """Standard deviation of a value that is anywhere within an interval of that width, as probable everywhere."""
    return width / math.sqrt(12.0)  # 1, by the integral over the interval
