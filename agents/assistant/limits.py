"""Bounds what an assistant may ask and gets: calls a second, characters of an answer."""

from __future__ import annotations

import json
from typing import Any

import msgspec

from dsr.clock import Clock

CALLS_PER_SECOND = 5.0
"""calls/s on average: an assistant asks once in several seconds, and a loop gone wild must not load the graph"""
BURST = 20
"""Calls that may come at once: an assistant that begins reads some resources together"""
MOST_CHARACTERS = 40_000
"""Characters of an answer as JSON: about ten thousand tokens, which fit into any assistant's context"""


_SEPARATOR = 2
"""Characters between two rows"""


class RateLimit:
    """A token bucket.

    Args:
        clock: whose monotonic time counts.
        per_second: calls/s on average.
        burst: calls that may come at once.
    """

    def __init__(self, clock: Clock, per_second: float = CALLS_PER_SECOND, burst: int = BURST) -> None:
        self._clock, self._per_second, self._burst = clock, per_second, burst
        self._tokens = float(burst)
        self._at = clock.monotonic()

    def wait_time(self) -> float:
        """Take a call into account; 0 if it may be made, or else s until the next may."""
        now = self._clock.monotonic()
        self._tokens = min(self._burst, self._tokens + (now - self._at) * self._per_second)
        self._at = now
        if self._tokens >= 1.0:
            self._tokens -= 1.0
            return 0.0
        return (1.0 - self._tokens) / self._per_second


def as_json(data: Any) -> str:
    """Data as JSON in ASCII: what no letter of text can break out of, and null for numbers that JSON does not have."""
    return json.dumps(json.loads(msgspec.json.encode(data)))


def trimmed(rows: list[Any], most: int = MOST_CHARACTERS) -> tuple[list[Any], int]:
    """The first rows that fit into so many characters as JSON, and how many are left out."""
    used = 0
    for number, row in enumerate(rows):
        used += len(as_json(row)) + _SEPARATOR
        if used > most:
            return rows[:number], len(rows) - number
    return rows, 0
