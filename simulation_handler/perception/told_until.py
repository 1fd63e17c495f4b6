"""Of which time a belief is: until when cameras have told what they see, however long that took to arrive.

On a slow machine images are few, and take long to become percepts. If lateness counted as age, all things would be
unseen while cameras show them. The belief would ask what has become of each: yet more work for the slow machine.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from itertools import pairwise
from statistics import median

from dsr.frames.tree import HISTORY
from dsr.perception.scales import CONFIRM_FRAMES, PRESENT
from simulation_handler.scales import TICK_SLACK


class ToldUntil:
    """The time up to which cameras have told what they see: now, if their percepts come at once, and often.

    Whoever misses one image takes things for present still (`PRESENT`). If images come more seldom, or later, the time
    is as much earlier than now, but no earlier than the newest percept. A camera that falls silent changes nothing of
    how often and how late its images came. So the time goes on, and what the camera saw becomes unseen.
    """

    def __init__(self) -> None:
        self._newest: deque[float] = deque(maxlen=CONFIRM_FRAMES + 1)
        """s, stamps of newer and newer percepts"""
        self._late = 0.0
        self._time = -math.inf

    def look(self, stamps: Iterable[float], now: float) -> float:
        """Take in the stamps (s) of the percepts that came since the last look; return the time (s) by `now` (s).

        The time goes back only if the clock does.
        """
        newest, before = max(stamps, default=-math.inf), self._newest[-1] if self._newest else -math.inf
        if newest > before:
            self._newest.append(newest)
            self._late = self._lateness(now)
        newest = max(newest, before)
        self._time = min(max(self._time, newest, now - self._late), now)
        return self._time

    def _lateness(self, now: float) -> float:
        """S by which the age of the newest percept would be beyond `PRESENT`, were the next image missed.

        How often images come is the median over some: one gap tells that they were silent, not that they are slow.
        What is later than frames are remembered, nobody can place.
        """
        if len(self._newest) <= CONFIRM_FRAMES:
            return 0.0
        period = median(after - before for before, after in pairwise(self._newest))
        late = 2.0 * period + now - self._newest[-1] - PRESENT
        return min(late, HISTORY) if late > TICK_SLACK else 0.0
