"""Hybrid logical clock: stamps that respect causality and stay close to physical time.

Kulkarni et al., "Logical Physical Clocks" (OPODIS 2014). A stamp is one integer: microseconds since
the Unix epoch in the high bits, a logical counter in the low `LOGICAL_BITS`, so that stamps compare
as integers.
"""

from __future__ import annotations

LOGICAL_BITS = 10
_HORIZON = 1 << 62
"""A stamp in the year 2112. A greater one, which only a broken clock can have made, wins where it was written but
leaves the clocks of others alone: else they would run out of stamps."""


class HybridClock:
    """Issues stamps greater than every stamp issued or observed before."""

    def __init__(self) -> None:
        self.latest = 0

    def tick(self, now: float) -> int:
        """A new stamp at physical time `now` (s)."""
        physical = int(now * 1e6) << LOGICAL_BITS
        self.latest = physical if physical > self.latest else self.latest + 1
        return self.latest

    def observe(self, stamp: int) -> None:
        """Take note of a stamp received from elsewhere; later stamps of ours are greater."""
        self.latest = max(self.latest, min(stamp, _HORIZON))


def physical_time(stamp: int) -> float:
    """The physical part of a stamp, in seconds since the Unix epoch."""
    return (stamp >> LOGICAL_BITS) / 1e6
