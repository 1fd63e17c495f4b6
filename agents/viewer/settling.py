"""What came or went and has lasted for a while, so that what flickers is not told."""

from __future__ import annotations

from collections import defaultdict
from typing import NamedTuple

_SETTLES = 1.0  # s for which something must last: percepts of hands come and go several times a second

Subject = tuple[str, str, str]
"""What came or went: a node as (name, "", ""), an edge as its key."""


class Shift(NamedTuple):
    """Something came or went."""

    subject: Subject
    is_there: bool


class Settled(NamedTuple):
    """Something came or went and lasts."""

    time: float
    """s, when it came or went"""
    shift: Shift


class Settling:
    """Knows what has been told to be there, and what is there otherwise."""

    def __init__(self) -> None:
        self._there: set[Subject] = set()
        self._waiting: dict[Subject, Settled] = {}

    def note(self, shift: Shift, now: float) -> None:
        """Something came or went at time `now` (s)."""
        if shift.is_there is (shift.subject in self._there):
            self._waiting.pop(shift.subject, None)
        else:
            self._waiting.setdefault(shift.subject, Settled(now, shift))

    def settled(self, now: float) -> list[list[Settled]]:
        """What has lasted until `now` (s), each once; what came or went at the same time is together, in that order."""
        together: dict[float, list[Settled]] = defaultdict(list)
        for subject, waiting in list(self._waiting.items()):
            if not waiting.time <= now < waiting.time + _SETTLES:  # before: a replay went back
                del self._waiting[subject]
                self._there ^= {subject}
                together[waiting.time].append(waiting)
        return [together[time] for time in sorted(together)]
