"""Whether a camera still sees: the arm moves by what cameras tell, so it stops when they tell nothing more."""

from __future__ import annotations

from collections import deque

from agents.drivers import SILENCE

MISSED = 3.0
"""Intervals between frames without a frame after which a camera counts as gone: single frames get lost"""
LEAST = 0.1
"""s of silence that are never too long: less than that is jitter of ticks"""
INTERVALS = 10
"""Intervals of late, the longest of which is the camera's"""


class Sight:
    """Follows whether one camera delivers frames. One that never delivered any is not missed."""

    def __init__(self, node: str) -> None:
        self._node = node
        self._last: float | None = None
        self._intervals: deque[float] = deque(maxlen=INTERVALS)

    def note(self, now: float) -> None:
        """A frame came at time `now` (s)."""
        if self._last is not None and now - self._last < SILENCE:
            self._intervals.append(now - self._last)
        self._last = now

    def trouble(self, now: float) -> str:
        """What is wrong at time `now` (s), in words; empty if nothing is."""
        if self._last is None or not self._intervals:
            return ""
        silence = now - self._last
        patience = min(max(MISSED * max(self._intervals), LEAST), SILENCE)
        return f"{self._node} gave no frame for {silence:.2f} s" if silence > patience else ""
