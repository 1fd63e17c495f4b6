"""What is known before anything is seen: how often things happen that nobody sees, and how well cameras see."""

from __future__ import annotations

import math
from typing import NamedTuple


class EventRates(NamedTuple):
    """Rates of events, and what a camera makes of a thing."""

    push_rate: float = 0.05
    """1/s, at which the motion of a thing changes by something unseen: pushed, caught, let go"""
    push_speed: float = 1.0
    """m/s, standard deviation of the change of each horizontal part of the velocity by that"""
    stops: float = 1.0 / 3.0
    """1, share of these events after which the thing rests"""
    wonder_rate: float = 1e-5
    """1/s, at which a thing vanishes or comes from nothing; nobody knows of a case"""
    strangers: float = 0.1
    """1, things nobody knows of that are expected out of sight, in all"""
    drift: float = 0.02
    """m/s per square root of s, by which physics errs in the velocity of a thing"""
    resolution: float = 0.05
    """m, standard deviation of each coordinate of a percept"""
    seen_from: float = 0.2
    """1, visible share up to which a thing is never recognised"""
    seen_at: float = 0.8
    """1, visible share from which a thing is always recognised, but for missed frames"""
    missed: float = 0.05
    """1, share of the frames in which a thing in full view is not recognised"""
    misplaced: float = 0.02
    """1, probability that a thing is recognised that should not be seen: the belief about what hides it is not exact"""

    def recognised(self, share: float) -> float:
        """Probability that the limit of the visible share from which this thing is recognised is below `share`."""
        return min(max((share - self.seen_from) / (self.seen_at - self.seen_from), 0.0), 1.0)

    @property
    def wonder(self) -> float:
        """nats, of a wonder within a second"""
        return -math.log(self.wonder_rate)
