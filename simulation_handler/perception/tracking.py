"""Percepts of one object over time: averaged while it rests, single wrong frames ignored, moves followed.

A percept beyond the gate is set aside; only several in a row mean that the object has moved. A move too small for
that shows in the mean of the newest, of as many as tell it best. A small move that nobody saw shows in the mean of all
percepts since the gap.
"""

from __future__ import annotations

import copy
import math
from collections import defaultdict, deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dsr.perception.scales import RECENT_PERCEPTS
from simulation_handler.config import BeliefConfig
from simulation_handler.perception.estimate import (
    Compared,
    Estimate,
    accepted,
    farthest,
    fuse,
    fused,
    innovations,
)
from simulation_handler.perception.percepts import WeighedPercept


class Given(NamedTuple):
    """A percept for a track."""

    track: PerceptTrack
    percept: WeighedPercept
    """Where the object is seen."""
    is_expected: bool = False
    """Whether it is believed there already, so that nothing need confirm that: it is asked without an estimate only."""


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
        self._before: Estimate | None = None
        """As it was before that gap, until the percepts since then tell whether it was moved meanwhile"""
        self._anew: Estimate | None = None
        """Of the percepts since then alone"""
        self.last_stamp = -math.inf
        """s, of the newest percept."""
        self.late = 0.0
        """s by which the cameras that see it are late: what they saw so long ago is the newest that they can tell"""
        self.moving = False
        """The newest percepts contradict each other: it is on its way."""
        self.changed = False
        """The estimate changed since `take_change`."""
        self.restarts = 0
        """How often the estimate was begun anew."""

    @staticmethod
    def add(given: Sequence[Given]) -> None:
        """Let tracks take in percepts, each at most one; one that is not newer than the last is ignored."""
        new = [one for one in given if one.track._note(one.percept)]
        known = [(one, one.track.estimate) for one in new if one.track.estimate is not None]
        agreeing: list[PerceptTrack] = []
        if known:
            estimates, percepts = [estimate for _, estimate in known], [one.percept for one, _ in known]
            shifts = innovations(estimates, percepts)
            agree = accepted(estimates, percepts, shifts).tolist()
            for (one, _), shift in zip(known, shifts, strict=True):
                one.track._recent.append((one.percept, shift.copy()))
            agreeing = [one.track for (one, _), agrees in zip(known, agree, strict=True) if agrees]
        fused_in = set(map(id, agreeing))
        for one in new:
            if id(one.track) not in fused_in:
                one.track._set_aside(one.percept, is_expected=one.is_expected)
        PerceptTrack._fuse(agreeing)

    def _note(self, percept: WeighedPercept) -> bool:
        """Take note of a percept, if it is newer than the last."""
        if percept.stamp <= self.last_stamp:
            return False
        if not self.is_recent(self.last_stamp, percept.stamp):
            self._since = percept.stamp
            self._before, self._anew = copy.copy(self.estimate), None
        self.last_stamp = percept.stamp
        self._newest.append(percept)
        return True

    def _set_aside(self, percept: WeighedPercept, *, is_expected: bool) -> None:
        """Keep a percept that disagrees, until enough of them do."""
        self._pending.append(percept)
        if is_expected and self.estimate is None:
            self._restart([percept], None)
        elif len(self._pending) >= self._needed():
            self._restart(list(self._pending), self.estimate)

    @property
    def newest(self) -> WeighedPercept | None:
        """The newest percept, whatever the estimate; None if there never was one."""
        return self._newest[-1] if self._newest else None

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

    def stray_at(self, now: float) -> WeighedPercept | None:
        """The newest percept at `now` (s) if the estimate does not have it, or there is none; or None."""
        return self._pending[-1] if self._pending and self.is_fresh(now) else None

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
        """Whether the object was seen lately, as far as its cameras have told by time `now` (s)."""
        return self.age(now) <= self._config.perceived_max_age

    def age(self, now: float) -> float:
        """Seconds for which cameras have told nothing of the object at time `now` (s), though they could have."""
        return now - self.last_stamp - self.late

    def is_recent(self, stamp: float, now: float) -> bool:
        """Whether a percept of time `stamp` (s) still counts at time `now`."""
        return now - stamp <= self._config.perceived_max_age

    def _needed(self) -> int:
        """How many percepts in a row must disagree: one for what was never seen or may be on its way."""
        confirm_frames = self._config.confirm_frames
        if self.estimate is None:
            return confirm_frames if self._believed else 1
        return confirm_frames if self.estimate.count > confirm_frames + 1 else 1

    @staticmethod
    def _fuse(tracks: Sequence[PerceptTrack]) -> None:
        """Take in the newest percepts, which agree; if the recent ones of a track together do not, weigh these anew."""
        alike: defaultdict[int, list[tuple[PerceptTrack, Estimate]]] = defaultdict(list)
        for track in tracks:
            track._pending.clear()
            track.moving, track.changed = False, True
            if track.estimate is not None:
                alike[len(track._recent)].append((track, track.estimate))
        for group in alike.values():
            recents = [track._recent for track, _ in group]
            counts = farthest([estimate for _, estimate in group], recents)
            rest = [
                one
                for one, count in zip(group, counts, strict=True)
                if not (count and one[0]._weigh_anew(one[1], count))
            ]
            if rest:
                percepts, shifts = zip(*(track._recent[-1] for track, _ in rest), strict=True)
                fuse([estimate for _, estimate in rest], percepts, np.array(shifts))
        for track in tracks:
            track._compare_with_before()

    def _compare_with_before(self) -> None:
        """Take what percepts tell since a gap for what is true, if they tell that the object was moved meanwhile.

        Nobody would have seen that. So a move is likelier than of what was seen to stay, and may be smaller than what
        a few percepts tell: all since the gap are compared, up to as many as an average takes in.
        """
        percept = self._newest[-1]
        if self._before is None or self.estimate is None:
            return
        if self._anew is None:
            self._anew = Estimate(percept, self._config)
        else:
            fuse([self._anew], [percept], innovations([self._anew], [percept]))
        if self._anew.count >= self._config.confirm_frames and self.estimate.take_over(self._before, self._anew):
            self._before = None
            self._recent.clear()
        elif self._anew.count >= self._config.window:
            self._before = None

    def _weigh_anew(self, estimate: Estimate, count: int) -> bool:
        """Doubt the estimate by its last percepts, of which so many are beyond the gate; false if they do not agree."""
        newer = self._since_moved(estimate, count)
        if newer:
            estimate.loosen(newer)
            self._recent.clear()
            for percept, _ in newer:
                fuse([estimate], [percept], innovations([estimate], [percept]))
        return bool(newer)

    def _since_moved(self, estimate: Estimate, count: int) -> list[Compared]:
        """The newest percepts that agree with each other, and together disagree most with the estimate; none if none
        do. Some of them may have been set aside: not each is beyond the gate, and one that is may be false.
        """
        recent = list(self._recent)
        while count:
            newer = recent[-count:]
            if fused([percept for percept, _ in newer], self._config) is not None:
                return newer
            recent = newer[1:]
            count = farthest([estimate], [recent])[0]
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
        self._before = None
        self.changed = True
        self.restarts += 1
