"""Sentences about a connection for people: few, however many nodes there are to be told of."""

from __future__ import annotations

import math
from collections.abc import Iterable

from dsr.clock import WALL_CLOCK

_MOST = 20
"""Sentences of one kind: more is not read, and names are made up by whoever announces them"""

_SHOWN = 10.0
"""s for which a trouble is told after it happened last: one bad message is no trouble for ever"""


class Lately:
    """Knows of numbers that only grow whether they grew lately."""

    def __init__(self) -> None:
        self._seen: dict[object, tuple[int, float]] = {}
        """By what is counted: its number, and when (s) it grew last"""

    def grew(self, what: object, number: int) -> bool:
        """Whether a number grew within 10 s; to be asked now and then."""
        now = WALL_CLOCK.monotonic()
        last, at = self._seen.get(what, (0, -math.inf))
        if number > last:
            at = now
        self._seen[what] = number, at
        return now - at < _SHOWN


def few(sentences: Iterable[str]) -> list[str]:
    """The first ones in the order of the alphabet, each once, and how many more there are."""
    found = sorted(set(sentences))
    more = len(found) - _MOST
    return [*found[:_MOST], f"and {more} more of this kind"] if more > 0 else found
