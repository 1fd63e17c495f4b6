"""What the bridge counts, and what it has to tell people: each kind of trouble once in the log, all in numbers."""

from __future__ import annotations

import logging
import math
from collections import Counter

from dsr.clock import Clock

_SHOWN = 10.0
"""s for which a trouble stays in the status after it happened last"""
_MOST_KINDS = 1000
"""Troubles that are logged one by one; who makes up more of them does not fill the log"""
_LONGEST = 500
"""Characters of a trouble in words, and of what it is about: names come from ROS, and may have millions"""


class Tally:
    """Counts what happens, and remembers the newest trouble.

    Args:
        clock: the agent's.
        log: where each trouble is told once.
    """

    def __init__(self, clock: Clock, log: logging.Logger) -> None:
        self.counts: Counter[str] = Counter()
        """Numbers by what was counted, for the status"""
        self.told: list[str] = []
        """Each kind of trouble once, in words"""
        self._clock = clock
        self._log = log
        self._told: set[tuple[str, str]] = set()
        self._newest = ""
        self._until = -math.inf

    def count(self, what: str, number: int = 1) -> None:
        """Count something that needs no words."""
        self.counts[what] += number

    def tell(self, what: str, subject: str, text: str, number: int = 1) -> None:
        """Count a trouble of some kind with some subject, and log the first of its kind with that subject."""
        self.counts[what] += number
        text, subject = _shortened(text), _shortened(subject)
        self._newest, self._until = text, self._clock.monotonic() + _SHOWN
        if (what, subject) not in self._told and len(self._told) < _MOST_KINDS:
            self._told.add((what, subject))
            self.told.append(text)
            self._log.warning("%s (told once; then only counted)", text)

    @property
    def trouble(self) -> str:
        """The newest trouble in words, if it was lately; else empty."""
        return self._newest if self._clock.monotonic() < self._until else ""


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}... ({len(text)} characters)"
