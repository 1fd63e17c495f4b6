"""Pairs the pictures of two streams that were taken at about the same time: colour with depth."""

from __future__ import annotations

from collections import deque
from typing import Generic, NamedTuple, TypeVar

import numpy as np

T = TypeVar("T")

PATIENCE = 1.0
"""s without any pair after which colour goes on alone"""
_LIKELY_PERIOD = 1.0 / 30.0
"""s between two pictures, until stamps tell it: that of most cameras"""
_LONGEST_PERIOD = 1.0 / 15.0
"""s, no longer one counts: half of it later a hand at 1 m/s is 33 mm elsewhere"""
_SHORTEST_PERIOD = 1.0 / 60.0
"""s, no shorter one counts: in a burst of pictures that waited, stamps of arrival say nothing"""
_KEPT = 4
"""Pictures of each kind that wait for their partner: it comes within a picture or two, or never"""
_LAG = 2
"""Pictures that wait on while others go on alone: depth that comes again, and late, must find a partner"""
_REMEMBERED = 8
"""Spans between pictures whose median is the period: one that was lost changes nothing"""


class _Waiting(NamedTuple, Generic[T]):
    item: T
    stamp: float
    """s"""


class _Stream(Generic[T]):
    """The pictures of one kind that wait for a partner, and how often such ones come."""

    def __init__(self) -> None:
        self.waiting: deque[_Waiting[T]] = deque()
        self._spans: deque[float] = deque(maxlen=_REMEMBERED)
        self._last: float | None = None

    def note(self, stamp: float) -> None:
        if self._last is not None and stamp > self._last:
            self._spans.append(stamp - self._last)
        self._last = stamp

    @property
    def period(self) -> float:
        """Time between two pictures, s"""
        return float(np.median(self._spans)) if self._spans else _LIKELY_PERIOD

    def nearest(self, stamp: float, apart: float) -> _Waiting[T] | None:
        """What was taken nearest to `stamp`, at most `apart` s from it."""
        found = min(self.waiting, key=lambda one: abs(one.stamp - stamp), default=None)
        return found if found is not None and abs(found.stamp - stamp) <= apart else None

    def forget(self, stamp: float) -> int:
        """Drop those before `stamp` and the one of then; the number of those before."""
        dropped = sum(one.stamp < stamp for one in self.waiting)
        kept = [one for one in self.waiting if one.stamp > stamp]
        self.waiting.clear()
        self.waiting.extend(kept)
        return dropped


class Pairing(Generic[T]):
    """Pairs by the nearest stamp within half the time between two pictures of the faster stream.

    Args:
        patience: s without any pair after which colour goes on alone.
    """

    def __init__(self, patience: float = PATIENCE) -> None:
        self.unpaired = 0
        """Pictures of either kind that never got a partner."""
        self.gap: float | None = None
        """Time (s) between the last colour that went on alone and the depth nearest to it; None if there was none."""
        self.passed_over = 0
        """Pairs that nobody took before the next one was there."""
        self._colors: _Stream[T] = _Stream()
        self._depths: _Stream[T] = _Stream()
        self._patience = patience
        self._ready: tuple[T, T | None] | None = None
        self._paired_at: float | None = None
        """s, arrival of the last pair, or of the first colour"""

    @property
    def apart(self) -> float:
        """Time by which the stamps of a pair may differ, s"""
        return 0.5 * max(_SHORTEST_PERIOD, min(self._colors.period, self._depths.period, _LONGEST_PERIOD))

    def add_color(self, item: T, stamp: float, at: float) -> None:
        """Take in a picture with `stamp` (s) that arrived at `at` (s, of any clock that never goes back)."""
        if self._paired_at is None:
            self._paired_at = at
        partner = self._partner(self._colors, self._depths, stamp)
        if partner is not None:
            self._pair(item, partner.item, at)
            return
        self._wait(self._colors, item, stamp)
        if at - self._paired_at > self._patience and len(self._colors.waiting) > _LAG:
            alone = self._colors.waiting[-1 - _LAG]
            self.gap = min((abs(depth.stamp - alone.stamp) for depth in self._depths.waiting), default=None)
            self._set_ready((alone.item, None))
            self.unpaired += self._colors.forget(alone.stamp) + 1

    def add_depth(self, item: T, stamp: float, at: float) -> None:
        """Take in a depth image likewise."""
        partner = self._partner(self._depths, self._colors, stamp)
        if partner is not None:
            self._pair(partner.item, item, at)
            return
        self._wait(self._depths, item, stamp)

    def take(self) -> tuple[T, T | None] | None:
        """The newest colour with its depth, or alone, if it was not returned before; else None."""
        ready, self._ready = self._ready, None
        return ready

    def _partner(self, own: _Stream[T], other: _Stream[T], stamp: float) -> _Waiting[T] | None:
        own.note(stamp)
        partner = other.nearest(stamp, self.apart)
        if partner is not None:
            self.unpaired += other.forget(partner.stamp) + own.forget(stamp)
        return partner

    def _wait(self, stream: _Stream[T], item: T, stamp: float) -> None:
        stream.waiting.append(_Waiting(item, stamp))
        if len(stream.waiting) > _KEPT:
            stream.waiting.popleft()
            self.unpaired += 1

    def _pair(self, color: T, depth: T, at: float) -> None:
        self._paired_at = at
        self._set_ready((color, depth))

    def _set_ready(self, pair: tuple[T, T | None]) -> None:
        self.passed_over += self._ready is not None
        self._ready = pair
