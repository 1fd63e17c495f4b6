"""Which of too many cameras have a place: those that speak, in turn, and of each agent as many as of the others."""

from __future__ import annotations

import heapq
import math
from collections import Counter
from collections.abc import Mapping

TURN = 2.0
"""s that a camera has to send an image while others wait; most send several a second"""


class Places:
    """Gives places to cameras; all times are in s.

    While others wait, who sends nothing for a turn gives way. If all send, one of an agent with most places does.

    Args:
        most: how many places there are.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._heard: dict[str, float] = {}
        """When those that have a place were heard, or came; the one that came first is first."""
        self._waiting: dict[str, None] = {}
        self._turn_began = -math.inf

    def given(self, cameras: Mapping[str, frozenset[str]], now: float) -> list[str]:
        """Cameras that have a place at time `now`, of all that there are, each with the agents that made it."""
        self._heard = {name: heard for name, heard in self._heard.items() if name in cameras}
        order = dict.fromkeys([*self._waiting, *cameras])
        self._waiting = {name: None for name in order if name in cameras and name not in self._heard}
        if not 0.0 <= now - self._turn_began < TURN:
            self._turn_began = now
            self._give_way(cameras, now)
        self._take(cameras, now)
        return list(self._heard)

    def note(self, camera: str, now: float) -> None:
        """A camera that has a place has sent an image."""
        self._heard[camera] = now

    def _give_way(self, cameras: Mapping[str, frozenset[str]], now: float) -> None:
        """Send to the end of the queue who was silent, or one that was not, if room is needed."""
        needed = len(self._waiting) - (self._most - len(self._heard))
        if needed <= 0 or not self._heard:
            return
        leaving = [name for name, heard in self._heard.items() if not 0.0 <= now - heard < TURN]
        if not leaving:
            counts = self._counts(cameras)
            leaving = [max(self._heard, key=lambda name: _share(cameras[name], counts))]
        for name in leaving[:needed]:
            del self._heard[name]
            self._waiting[name] = None

    def _take(self, cameras: Mapping[str, frozenset[str]], now: float) -> None:
        """Let those in that wait, first those whose agents have fewest places."""
        room = self._most - len(self._heard)
        if room <= 0:
            return
        counts, ranks = self._counts(cameras), {}
        for name in self._waiting:
            ranks[name] = _share(cameras[name], counts)
            counts.update(cameras[name])
        for name in heapq.nsmallest(room, self._waiting, key=ranks.__getitem__):
            del self._waiting[name]
            self._heard[name] = now

    def _counts(self, cameras: Mapping[str, frozenset[str]]) -> Counter[str]:
        """Number of places that each agent has."""
        return Counter(maker for name in self._heard for maker in cameras[name])


def _share(makers: frozenset[str], counts: Counter[str]) -> int:
    """Number of places of that agent among those that made a camera which has fewest."""
    return min(counts[maker] for maker in makers)
