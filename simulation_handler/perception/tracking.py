"""Percepts of one object over time: averaged while it rests, single wrong frames ignored, moves followed.

A percept beyond the gate is set aside; only several in a row mean that the object has moved. A move too small for
that shows in the mean of the newest, of as many as tell it best.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from dsr.perception.scales import RECENT_PERCEPTS
from simulation_handler.config import BeliefConfig
from simulation_handler.perception.estimate import Compared, Estimate, fused
from simulation_handler.perception.percepts import WeighedPercept


class PerceptTrack:
    """The percepts of one object over time, and the estimate that follows from them."""

    def __init__(self, config: BeliefConfig) -> None:
        self._config = config
        self._believed = False  # there is a belief without an estimate, which a single percept does not replace
        self._pending: deque[WeighedPercept] = deque(maxlen=config.confirm_frames)
        self._recent: deque[Compared] = deque(maxlen=RECENT_PERCEPTS)
        self._newest: deque[WeighedPercept] = deque(maxlen=RECENT_PERCEPTS)
        self.estimate: Estimate | None = None
        """None until perception is sure enough."""
        self._since = -math.inf
        """s, of the first percept after the last gap"""
        self.last_stamp = -math.inf
        """s, of the newest percept."""
        self.moving = False
        """The newest percepts contradict each other: it is on its way."""
        self.changed = False
        """The estimate changed since `take_change`."""
        self.restarts = 0
        """How often the estimate was begun anew."""

    def add(self, percept: WeighedPercept, *, is_expected: bool = False) -> None:
        """Take in a percept; one that is not newer than the last is ignored.

        Args:
            percept: where the object is seen.
            is_expected: whether it is believed there already, so that nothing need confirm that.
        """
        if percept.stamp <= self.last_stamp:
            return
        if not self.is_fresh(percept.stamp):
            self._since = percept.stamp
        self.last_stamp = percept.stamp
        self._newest.append(percept)
        if self.estimate is not None:
            self._recent.append((percept, self.estimate.innovation(percept)))
        if self.estimate is not None and self.estimate.accepts(percept):
            self._fuse(self.estimate)
            return
        self._pending.append(percept)
        if is_expected and self.estimate is None:
            self._restart([percept], None)
        elif len(self._pending) >= self._needed():
            self._restart(list(self._pending), self.estimate)

    @property
    def trail(self) -> tuple[WeighedPercept, ...]:
        """The newest percepts, the last one at the end."""
        return tuple(self._newest)

    @property
    def way(self) -> tuple[WeighedPercept, ...]:
        """The newest percepts since the last gap: nobody knows how it came from those before to these."""
        return tuple(percept for percept in self._newest if percept.stamp >= self._since)

    def estimate_at(self, now: float) -> Estimate | None:
        """The estimate from percepts at `now` (s); None while unseen, or if all in it is from before a gap."""
        if self.estimate is None or not self.is_fresh(now):
            return None
        return self.estimate if self.estimate.stamp >= self._since else None

    def glance_at(self, now: float) -> WeighedPercept | None:
        """The newest percept of what is seen again at `now` (s), but too shortly yet to tell where it is; or None."""
        is_glanced = self._pending and self.is_fresh(now) and self.estimate_at(now) is None
        return self._pending[-1] if is_glanced else None

    @property
    def is_restless(self) -> bool:
        """Whether the newest percept disagrees with the estimate, or with those before."""
        return self.moving or bool(self._pending)

    def begin_anew(self, since: float) -> None:
        """Start the estimate anew from the percepts since `since` (s), because the object has come to rest.

        Of these, the newest count that agree with each other: the others may be of its way.
        """
        percepts = [percept for percept in self._newest if percept.stamp >= since]
        while len(percepts) > self._config.confirm_frames and fused(percepts, self._config) is None:
            del percepts[0]
        if percepts:
            self._restart(percepts, None)

    def take_change(self) -> bool:
        """Whether the estimate changed since the last call."""
        changed, self.changed = self.changed, False
        return changed

    def forget(self) -> None:
        """The belief comes from elsewhere than perception now: the percepts so far say nothing any more."""
        self.estimate = None
        self._believed = True
        self._pending.clear()
        self._recent.clear()

    def is_fresh(self, now: float) -> bool:
        """Whether the object was seen lately."""
        return self.is_recent(self.last_stamp, now)

    def is_recent(self, stamp: float, now: float) -> bool:
        """Whether a percept of time `stamp` (s) still counts at time `now`."""
        return now - stamp <= self._config.perceived_max_age

    def _needed(self) -> int:
        """How many percepts in a row must disagree: one for what was never seen or may be on its way."""
        confirm_frames = self._config.confirm_frames
        if self.estimate is None:
            return confirm_frames if self._believed else 1
        return confirm_frames if self.estimate.count > confirm_frames + 1 else 1

    def _fuse(self, estimate: Estimate) -> None:
        """Take in a percept that agrees; if the recent ones together do not, weigh these anew."""
        self._pending.clear()
        self.moving = False
        self.changed = True
        newer = self._since_moved(estimate)
        if newer:
            estimate.loosen(newer)
            self._recent.clear()
        for recent, _ in newer or [self._recent[-1]]:
            estimate.fuse(recent)

    def _since_moved(self, estimate: Estimate) -> list[Compared]:
        """The newest percepts that agree with each other, and together disagree most with the estimate; none if none
        do. Some of them may have been set aside: not each is beyond the gate, and one that is may be false.
        """
        recent = list(self._recent)
        while count := estimate.farthest(recent, self._config.recent_gate, self._config.confirm_frames):
            newer = recent[-count:]
            if fused([percept for percept, _ in newer], self._config) is not None:
                return newer
            recent = newer[1:]
        return []

    def _restart(self, percepts: Sequence[WeighedPercept], old: Estimate | None) -> None:
        """Begin anew from these percepts if they agree, else from the newest; keep what still holds of `old`."""
        agreeing = fused(percepts, self._config)
        self.moving = agreeing is None or len(percepts) < self._config.confirm_frames
        self.estimate = agreeing or Estimate(percepts[-1], self._config)
        if old is not None:
            self.estimate.inherit(old)
        self._pending.clear()
        self._recent.clear()
        self.changed = True
        self.restarts += 1
