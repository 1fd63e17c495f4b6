"""Stamps on our clock of what was stamped by another one: that of a device, or of the time of a recording."""

from __future__ import annotations

import math

_DRIFT = 1e-4
"""s a second by which two clocks may drift apart: twice what quartzes do"""
_JUMP = 1.0
"""s by which stamps jump if the device began anew: no picture takes as long to arrive"""


class DeviceClock:
    """Converts by the pictures that took least to arrive: what is between the clocks is at most that of any picture."""

    def __init__(self) -> None:
        self._offset = math.inf
        self._last = math.nan

    def ours(self, told: float, now: float) -> float:
        """The stamp (s) on our clock of one on the device's that arrived at `now` (s)."""
        passed = told - self._last
        offset = now - told
        if not (passed > -_JUMP and abs(offset - self._offset) < _JUMP):
            self._offset = offset
        else:
            self._offset = min(self._offset + _DRIFT * max(passed, 0.0), offset)
        self._last = told
        return told + self._offset


class RecordingClock:
    """Our times (s) at which recorded pictures are due, as if the first had been taken now.

    Args:
        period: s after the last picture, when a recording begins again.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._offset: float | None = None
        self._last = self._due = 0.0

    def ours(self, told: float, now: float) -> float:
        """When a picture with the stamp `told` (s) is due, asked at `now` (s)."""
        if self._offset is None:
            self._offset = now - told
        elif told < self._last:
            self._offset = self._due + self._period - told
        self._last, self._due = told, told + self._offset
        return self._due
