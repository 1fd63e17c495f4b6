"""How often something is sent at most."""

from __future__ import annotations

import math

from dsr.clock import ROUNDING, Clock


class Throttle:
    """Lets something happen at most so often, on the average: what is a little early now and then is not left out.

    Args:
        clock: the agent's, whose monotonic time counts: that of the day may be set back.
        hz: times a second; infinite for no limit.
    """

    def __init__(self, clock: Clock, hz: float) -> None:
        self._clock = clock
        self._period = 1.0 / hz
        self._due = -math.inf

    @property
    def is_due(self) -> bool:
        """Whether it may happen now."""
        return self._clock.monotonic() >= self._due - ROUNDING

    def take(self) -> bool:
        """Whether it may happen now; if so, it counts as done."""
        now = self._clock.monotonic()
        if now < self._due - ROUNDING:
            return False
        on_time = now - self._due < self._period
        self._due = (self._due if on_time else now) + self._period
        return True
