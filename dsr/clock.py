"""Time for the whole project: the wall clock and a manual one. Nobody else reads the time.

Stamps are seconds since the Unix epoch as `float` (resolution better than 1 us until 2100).
Durations are measured on `monotonic`, which never jumps.
"""

from __future__ import annotations

import threading
import time
from datetime import UTC, datetime
from typing import Protocol, TypeGuard

ROUNDING = 1e-6
"""s by which a span that is a sum of times may fall short by rounding alone"""

_FIRST, _LAST = (datetime(year, 1, 1, tzinfo=UTC).timestamp() for year in (2, 9999))
"""s; between them lies what a calendar tells in any time zone, with a year on both sides for reckoning in days"""


def is_time(value: object) -> TypeGuard[float]:
    """Whether it is a float that can be a time, in seconds since the Unix epoch: from the year 2 until 9998."""
    return isinstance(value, float) and _FIRST <= value < _LAST


class Clock(Protocol):
    """A source of time: `now` for stamps, `monotonic` for durations, and `wait`."""

    def now(self) -> float:
        """Seconds since the Unix epoch."""

    def monotonic(self) -> float:
        """Seconds from an arbitrary start; never goes back."""

    def wait(self, event: threading.Event, timeout: float) -> bool:
        """Wait until `event` is set or `timeout` seconds of this clock passed; true if it is set."""


class WallClock:
    """The machine's clock."""

    def now(self) -> float:
        """Seconds since the Unix epoch."""
        return time.time()

    def monotonic(self) -> float:
        """Seconds since boot or so; never goes back."""
        return time.perf_counter()

    def wait(self, event: threading.Event, timeout: float) -> bool:
        """Block for at most `timeout` seconds, some centuries if it is longer; true if `event` was set."""
        return event.wait(min(max(timeout, 0.0), threading.TIMEOUT_MAX))


class ManualClock:
    """A clock that moves only when told to: for lockstep runs and tests."""

    def __init__(self, start: float = 1_000_000_000.0) -> None:
        self._start = start
        self._now = start

    def now(self) -> float:
        """The time it was last set to, in seconds."""
        return self._now

    def monotonic(self) -> float:
        """Seconds since this clock was made."""
        return self._now - self._start

    def wait(self, event: threading.Event, timeout: float) -> bool:
        """Do not block: nobody else can move the clock meanwhile."""
        return event.is_set()

    def advance_to(self, now: float) -> None:
        """Move to `now` seconds; going back is an error."""
        if now < self._now:
            raise ValueError(f"a clock cannot go back from {self._now} to {now}")
        self._now = now

    def advance(self, seconds: float) -> None:
        """Move forward by `seconds`."""
        self.advance_to(self._now + seconds)


WALL_CLOCK = WallClock()
