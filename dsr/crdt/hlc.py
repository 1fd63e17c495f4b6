"""Hybrid logical clock: stamps that respect causality and stay close to physical time.

Kulkarni et al., "Logical Physical Clocks" (OPODIS 2014). A stamp is one integer: microseconds since
the Unix epoch in the high bits, a logical counter in the low `LOGICAL_BITS`, so that stamps compare
as integers. A clock follows the stamps of others only so far: a forged one must not move every clock.
"""

from __future__ import annotations

LOGICAL_BITS = 10
MAX_STAMP = (1 << 63) - 1
"""The greatest stamp of the format. Every replica refuses a message with a greater one."""
MAX_LEAD = 86_400.0
"""s beyond its own physical time up to which a clock follows others: more than a wrong time zone is off (14 h at most),
so that causality holds among all clocks that somebody may have set."""
_HORIZON = 1 << 62
"""A stamp in the year 2112. Later physical times count as this one: a clock so wrong still leaves room above."""


def stamp_at(time: float) -> int:
    """The first stamp at a physical time (s since the Unix epoch)."""
    return min(max(int(time * 1e6) << LOGICAL_BITS, 0), _HORIZON)


class HybridClock:
    """Issues stamps greater than every stamp issued before, or observed and not beyond `MAX_LEAD`."""

    def __init__(self) -> None:
        self.latest = 0
        self._ticked = 0.0

    def tick(self, now: float) -> int:
        """A new stamp at physical time `now` (s)."""
        self._ticked = now
        stamp = int(now * 1e6) << LOGICAL_BITS
        if not 0 <= stamp <= _HORIZON:
            stamp = stamp_at(now)
        if stamp <= self.latest:
            stamp = self.latest + 1
        self.latest = stamp
        return stamp

    @property
    def limit(self) -> int:
        """The greatest stamp that it would follow at the last tick."""
        return stamp_at(self._ticked + MAX_LEAD)

    def observe(self, stamp: int, now: float) -> bool:
        """Take note of a stamp from elsewhere at physical time `now` (s): later ones of ours are greater.

        False if it is too far ahead to be followed.
        """
        if stamp > stamp_at(now + MAX_LEAD):
            return False
        self.latest = max(self.latest, stamp)
        return True


def physical_time(stamp: int) -> float:
    """The physical part of a stamp, in seconds since the Unix epoch."""
    return (stamp >> LOGICAL_BITS) / 1e6
