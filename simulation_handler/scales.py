"""Lengths and times that rules of the belief share, beside those of `dsr.perception.scales`."""

from __future__ import annotations

import math
import sys

from dsr.perception.noise import PerceptNoise
from dsr.perception.scales import RESOLUTION, SAME_OUTCOME, SAME_PLACE
from dsr.vocabulary.nats import SURPRISING

GAP = 5e-5
"""m that does not count: less than physics lets bodies overlap. So far are those apart that were moved apart."""
PLACE_FLOOR = 2.0 * RESOLUTION
"""m, standard deviation of what is no noise of percepts: of bodies in contact, both of which are known so well"""
OWN_ERROR = RESOLUTION
"""m, systematic error of depth of its own that one more thing is imagined to have, beside those that are known"""
TURN_FLOOR = 0.03
"""rad, likewise"""
UNSEEN_SLACK = SAME_PLACE
"""m, standard deviation of where what is not seen really is, about where a hypothesis says it is"""
ASTRAY = math.sqrt(2.0 * SURPRISING) * PerceptNoise().depth_noise
"""m from where it is known to be, from which it is surprising that something is seen so far away by noise alone"""
GONE_FROM = 2.0 * SAME_PLACE
"""m from where it was, from which an object has surely left there: both places may be off"""
UNSEEN_VARIANCE = SAME_OUTCOME**2
"""m^2, sideways, of an object left to physics: it gives way to what is seen"""

GRAVITY = 9.81
"""m/s^2, towards -z."""
FRICTION = 0.7
"""1, Coulomb coefficient of a body of which nobody says it; that of a contact is the product of both bodies'"""

TICK_SLACK = 0.001
"""s by which a tick may be early"""

ANGLES = 8
"""Angles that stand for all of half a turn: of corners of what is round, or of how a body may be turned or tipped"""
TILTED = 0.44
"""rad that something may seem tilted by noise alone"""

DIAGONAL = math.sqrt(0.5)
"""Cosine of 45 degrees: a direction is nearer to another one than to all that is across that."""
ROUNDING = math.sqrt(sys.float_info.epsilon)
"""1, error of a result of 1 that was computed from many numbers."""


def even_spread(width: float) -> float:
    """Standard deviation of a value that is anywhere within an interval of that width, as probable everywhere."""
    return width / math.sqrt(12.0)  # 1, by the integral over the interval
