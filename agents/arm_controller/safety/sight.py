"""Whether a device still tells something: the arm moves by what cameras and encoders tell, and stops without it."""

from __future__ import annotations

from collections import deque

from agents.drivers import SILENCE

MISSED = 3.0
"""Intervals between frames without a frame after which a camera counts as gone: single frames get lost"""
LEAST = 0.1
"""s of a camera's silence that are never too long: less than that is jitter of ticks"""
INTERVALS = 10
"""Intervals of late, the longest of which is a device's"""


class Patience:
    """How long a device may be silent: a share of its longest interval of late, within bounds.

    Args:
        share: of that interval.
        least: s, and at least so long.
        most: s, and at most so long; longer intervals are breaks, and do not count.
    """

    def __init__(self, share: float, least: float, most: float) -> None:
        self._share, self._least, self._most = share, least, most
        self._last: float | None = None
        self._intervals: deque[float] = deque(maxlen=INTERVALS)

    def note(self, now: float) -> None:
        """Something came at time `now` (s)."""
        if self._last is not None and now - self._last < self._most:
            self._intervals.append(now - self._last)
        self._last = now

    @property
    def seconds(self) -> float:
        """How long the device may be silent, s."""
        return min(max(self._share * max(self._intervals, default=0.0), self._least), self._most)

    def silence(self, now: float) -> float:
        """For how long (s) the device has been silent at time `now` (s); 0 before it has told two things."""
        return 0.0 if self._last is None or not self._intervals else now - self._last


class Sight:
    """Follows whether one camera delivers frames. One that never delivered any is not missed."""

    def __init__(self, node: str) -> None:
        self._node = node
        self._patience = Patience(MISSED, LEAST, SILENCE)

    def note(self, now: float) -> None:
        """A frame came at time `now` (s)."""
        self._patience.note(now)

    def trouble(self, now: float) -> str:
        """What is wrong at time `now` (s), in words; empty if nothing is."""
        silence = self._patience.silence(now)
        return f"{self._node} gave no frame for {silence:.2f} s" if silence > self._patience.seconds else ""
