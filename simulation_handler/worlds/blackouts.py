"""Whether somebody was at work while cameras failed: what was changed meanwhile tells of all that is not seen.

Two variables of all worlds say so. Cameras failed, or the belief tells why nothing is seen: an arm is in the way, say.
The more cameras should see and do not, the more probably they failed. If they did, the prior that somebody was at work
grows with the time. Each object that is seen again tells by how much more probable its place is if somebody was at
work, and one that should be seen and is not tells likewise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from dsr.perception.scales import PRESENT
from simulation_handler.scales import ROUNDING
from simulation_handler.worlds.evidence import Evidence

_SUREST = -math.log(ROUNDING)
"""nats: more than that is lost in rounding"""


class Blackouts:
    """The last time in which cameras saw nothing, and what speaks for somebody who was at work then.

    Args:
        rate: 1/s, at which somebody begins to work while cameras fail.
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._longest = _SUREST / rate if rate > 0.0 else math.inf  # s, after which somebody was surely at work
        self._since = -math.inf
        self._is_open = False
        self._lasted = 0.0
        self._improbable = 0.0
        self.before = 0.0
        """1, probability until the last moment that somebody was at work, while cameras still see nothing; else 0"""
        self._told: dict[str, float] = {}

    def begins(self, evidence: Evidence) -> bool:
        """Whether cameras have just ceased to see anything: several objects vanished at the same time."""
        return not self._is_open and _are_blind(evidence)

    def update(self, evidence: Evidence, improbable: float) -> float:
        """Take in a moment; the probability that somebody began to work since the last one, if nobody had.

        Args:
            evidence: of that moment.
            improbable: nats, how improbable it is that nothing was seen since cameras saw something, if they do not
                fail.
        """
        if self.begins(evidence):
            self._since, self._lasted, self._improbable, self._told = max(evidence.shown()), 0.0, 0.0, {}
            improbable = 0.0
        self._is_open = _are_blind(evidence)
        self.before = self.probability if self._is_open else 0.0
        if not self._is_open:
            return 0.0
        self._improbable = max(self._improbable, improbable)
        self._lasted = min(evidence.now - self._since, self._longest)
        return (self.probability - self.before) / (1.0 - self.before) if self.before < 1.0 else 0.0

    @property
    def failing(self) -> float:
        """Probability that cameras failed the last time that they saw nothing: else they had shown something by then.

        It is 0 where the belief explains that nothing is seen.
        """
        return -math.expm1(-self._improbable)

    @property
    def probability(self) -> float:
        """Prior probability that somebody was at work then, by how long it lasted; 0 before the first time."""
        return -self.failing * math.expm1(-self._rate * self._lasted)

    @property
    def prior(self) -> float:
        """Log odds of the same; -inf before the first time."""
        failing, idle = self.failing, math.exp(-self._rate * self._lasted)
        nobody = (1.0 - failing) + failing * idle
        return math.log(self.probability) - math.log(nobody) if self.probability > 0.0 else -math.inf

    def tell(self, name: str, odds: float) -> None:
        """Know the log odds that somebody was at work by an object alone that is seen again."""
        self._told[name] = odds - self.prior

    def ratios(self, unseen: Mapping[str, float]) -> dict[str, float]:
        """What all others tell to each object that is not seen: by which factor somebody was at work more probably.

        Args:
            unseen: log odds that somebody was at work, by each of these objects alone.
        """
        told = {name: odds - self.prior for name, odds in unseen.items() if name not in self._told}
        total = sum(told.values()) + sum(self._told.values())
        return {name: math.exp(min(total - own, _SUREST)) for name, own in told.items()}


def _are_blind(evidence: Evidence) -> bool:
    stamps = evidence.shown()
    newest = max(stamps, default=-math.inf)
    return evidence.now - newest > PRESENT and sum(newest - stamp < PRESENT for stamp in stamps) > 1
