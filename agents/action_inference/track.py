"""The record of one thing that may be picked, held and let go of."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

from agents.action_inference.bumps import FRESH
from agents.action_inference.heights import KEPT_SAMPLES, Height, Heights
from agents.action_inference.observation import ObservedEnd, ObservedGrasp
from dsr.vocabulary.handling import Handling
from dsr.vocabulary.observed_actions import UNKNOWN


@dataclass
class ThingTrack:
    """The record of one thing."""

    seen: Heights
    believed: Heights
    held: bool = False
    by: str = UNKNOWN
    last_grasp: float | None = None
    """Time (s) when something was last known to hold the thing since it was picked; None without any."""
    holds: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=KEPT_SAMPLES))
    """Since when (s) who was last known to hold the thing does so with which probability, by the belief"""
    how: str = Handling.FREE
    """What the hand that held the thing had to do with it in the end, if that is known"""
    lifted: float = -math.inf
    """s, the last time of being taken up, by the belief, that was taken in"""
    told: ObservedEnd | None = None
    """The end of the last hold that was taken in"""
    let_go: Height | None = None
    """Believed height of the thing when it was let go; None while it is held."""
    rested: Height | None = None
    """Height of the thing when it last rested on something while it was held."""
    palm_height: float | None = None
    """World z (m) of the palm that held the thing, when it let go; None if the palm was not perceived."""
    hidden: Height | None = None
    """Where it was believed when both it and who holds it were last out of sight, since it was last seen."""
    beneath: tuple[float, frozenset[str]] = (0.0, frozenset())
    """Time (s) and names of the last supports or containers."""
    resting_since: float | None = None
    """Time (s) since when the thing rests on something untouched; None if it does not."""
    returned: bool = False
    """Whether the thing was seen again after a while, and its resting place is not certain yet."""
    returned_at: float = 0.0
    """s, of the first percept then."""
    recalled: bool = False
    hovers_since: float | None = None
    """s, since when something grasps it in the air, while it is not known where it lay."""
    found: Height | None = None
    """Where it was when it was found to be held; None if it was seen to be picked."""

    def note_probability(self, grasp: ObservedGrasp, now: float) -> None:
        """Something seems to hold it at `now` (s); another hold is as probable as it is itself."""
        if not (self.held and self.last_grasp is not None and grasp.holder == self.by):
            self.holds.clear()
        if not self.holds or self.holds[-1][1] != grasp.probability:
            self.holds.append((now, grasp.probability))

    def held_at(self, time: float) -> float:
        """Probability (0 to 1) that who was last known to hold it did so until `time` (s); 1 if nothing was known to.

        A hand that opens holds it less and less probably, but what it did then is as probable as its hold was. So it is
        the greatest probability since shortly before.
        """
        before = [(since, probability) for since, probability in self.holds if since <= time]
        if not before:
            return self.holds[0][1] if self.holds else 1.0
        ends = [*(since for since, _ in before[1:]), math.inf]
        return max(probability for (_, probability), end in zip(before, ends, strict=True) if end > time - FRESH)
