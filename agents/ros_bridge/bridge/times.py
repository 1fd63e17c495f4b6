"""The two times: stamps of ROS and stamps of the memory, and whose clock ROS follows."""

from __future__ import annotations

import math
from typing import Literal

from agents.ros_bridge.bridge.tally import Tally
from dsr.clock import Clock, ManualClock

Mode = Literal["auto", "wall", "follow", "publish"]
_SLACK = 0.005
"""s by which a message on `/clock` may come late: less does not move stamps, so that they do not tremble"""
_JUMP = 1.0
"""s by which `/clock` may go back or forth at once before it counts as set"""
MOST_AHEAD = 0.5
"""s that a stamp may be ahead of our clock, as of percepts (`dsr.perception.percepts`)"""

MOST_BEHIND = 10.0
"""s that a stamp may be behind our clock before that is told: messages are on their way for less, tf keeps as much"""


class TimeSource:
    """Converts stamps between ROS and the memory.

    Args:
        clock: the agent's.
        mode: as in the configuration.
        tally: is told when a clock was set.
    """

    def __init__(self, clock: Clock, mode: Mode, tally: Tally) -> None:
        self._clock = clock
        self._tally = tally
        self._mode: Mode = mode
        self._offset: float | None = None
        """s, our time minus that of `/clock`"""
        self._heard = -math.inf
        self._replayed: float | None = None

    @property
    def publishes(self) -> bool:
        """Whether we publish `/clock`: our time is not that of the wall."""
        if self._mode == "auto":
            return self._replayed is not None or isinstance(self._clock, ManualClock)
        return self._mode == "publish"

    @property
    def follows(self) -> bool:
        """Whether ROS has a time of its own, on `/clock`."""
        return self._mode == "follow"

    @property
    def is_known(self) -> bool:
        """Whether stamps can be converted: `/clock` was heard, if ROS follows that."""
        return not self.follows or self._offset is not None

    def now(self) -> float:
        """S, the time of the memory: of a replay, that of the recording."""
        return self._clock.now() if self._replayed is None else self._replayed

    def replay(self, stamp: float) -> None:
        """Take note of where (s) a replay is."""
        self._replayed = stamp

    def hear(self, ros: float, arrival: float) -> None:
        """Take note of a message on `/clock` (s) that arrived at our time `arrival` (s)."""
        offset = arrival - ros
        if self._offset is None:
            self._offset = offset
        elif ros < self._heard - _JUMP:
            self._tally.tell("clock set back", "/clock", f"/clock went back from {self._heard:.3f} s to {ros:.3f} s")
            self._offset = offset
        elif abs(offset - self._offset) > _SLACK:
            self._offset = offset
        self._heard = ros

    def to_graph(self, stamp: float) -> float:
        """The memory's stamp (s) of one of ROS (s)."""
        return stamp + (self._offset or 0.0) if self.follows else stamp

    def to_ros(self, stamp: float) -> float:
        """The stamp of ROS (s) of one of the memory (s)."""
        return stamp - (self._offset or 0.0) if self.follows else stamp
