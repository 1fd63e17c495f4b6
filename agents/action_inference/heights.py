"""How high a thing is over time, compared with where it lay: whether and since when it is lifted, lies or falls."""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise
from typing import NamedTuple

from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.perception.scales import CONFIRM_FRAMES, RECENT_PERCEPTS, SLOWLY, STEADY, TICK_RATE

KEPT_SAMPLES = round(2.0 * STEADY * TICK_RATE)
"""Samples that are kept of a thing: of two seconds and more."""
_LIFTED_SIGMAS = 3.0  # by which it must be higher to be lifted
_LOW = 0.4  # of the threshold, up to which it may still lie


class Height(NamedTuple):
    """The height of a thing at one moment."""

    time: float
    """Time of the sample, s."""
    bottom: float
    """World z of its lowest point, m."""
    position: Vector3
    """Position of the thing's centre in the world, m."""
    sigma: float = 0.0
    """m, standard deviation of the height"""

    @staticmethod
    def seen(bottom: float, pose: Pose) -> Height:
        """Make the height of a percept, as certain as its covariance says."""
        sigma = 0.0 if pose.covariance is None else math.sqrt(max(pose.parent_covariances()[0][2, 2], 0.0))
        return Height(pose.stamp, bottom, pose.t, sigma)


class Heights:
    """Samples of one thing from one source: its percepts, or its belief.

    Args:
        lifted: m above where it lay, from which it is lifted, unless that is less than three standard deviations.
        frames: samples in a row that must say so.
        steady: m within which it lies still.
    """

    def __init__(self, lifted: float, frames: int, steady: float) -> None:
        self._lifted = lifted
        self._frames = frames
        self._steady = steady
        self._samples: deque[Height] = deque(maxlen=KEPT_SAMPLES)
        self._stayed_since: float | None = None  # s, of a sample that is not kept, since which it has not moved
        self._rest: Height | None = None

    @property
    def last(self) -> Height | None:
        """The newest sample."""
        return self._samples[-1] if self._samples else None

    @property
    def lies(self) -> bool:
        """Whether the resting place of the thing is known."""
        return self._rest is not None

    def add(self, sample: Height) -> None:
        """Take in a sample; one that is not newer than the last is ignored."""
        if self._samples and sample.time <= self._samples[-1].time:
            return
        if len(self._samples) == KEPT_SAMPLES:
            oldest = self._samples[0]
            since = oldest.time if self._stayed_since is None else self._stayed_since
            self._stayed_since = since if self._are_together([oldest, sample]) else None
        self._samples.append(sample)

    def lie(self) -> None:
        """Note that the thing is not held: the place where it stays still is its resting place, but for a lift that
        shows.
        """
        if self._rest is None or self.is_lowered:
            self._rest = self._samples[-1] if self.is_steady() else self._rest
        elif not self.is_rising:
            rest, last = self._rest, self._samples[-1]
            bottom = rest.bottom + SLOWLY * (last.bottom - rest.bottom)
            z = rest.position[2] + SLOWLY * (last.position[2] - rest.position[2])
            self._rest = Height(last.time, bottom, (*last.position[:2], z))

    def lie_anew(self, since: float) -> bool:
        """Take the mean of the samples since then (s) for the resting place; false while there are too few samples.

        The few percepts before it was hidden may have been of a part of it, and so off.
        """
        samples = [sample for sample in self._samples if sample.time >= since]
        if len(samples) < RECENT_PERCEPTS // 2:
            return False
        bottom = sum(sample.bottom for sample in samples) / len(samples)
        x, y, z = (sum(values) / len(samples) for values in zip(*(one.position for one in samples), strict=True))
        self._rest = Height(samples[-1].time, bottom, (x, y, z))
        return True

    def forget(self) -> None:
        """Note that the thing lies somewhere else from now on."""
        self._rest = None

    def rise(self, sample: Height) -> float:
        """How much higher it is than it lay, m; 0 if unknown. Bottom and centre must agree: it may be tipped over."""
        if self._rest is None:
            return 0.0
        return min(sample.bottom - self._rest.bottom, sample.position[2] - self._rest.position[2])

    @property
    def is_rising(self) -> bool:
        """Whether the newest sample is above the resting place by more than noise."""
        return bool(self._samples) and self.rise(self._samples[-1]) > _LOW * self._lifted

    @property
    def is_lowered(self) -> bool:
        """Whether the thing is now lower than its resting place."""
        newest = list(self._samples)[-self._frames :]
        return len(newest) == self._frames and all(self.rise(sample) < -self._lifted for sample in newest)

    @property
    def is_lifted(self) -> bool:
        """Whether enough samples in a row show the thing above its resting place."""
        newest = list(self._samples)[-self._frames :]
        return len(newest) == self._frames and all(map(self._is_high, newest))

    def is_steady(self, count: int = CONFIRM_FRAMES) -> bool:
        """Whether the last samples are at one place."""
        newest = list(self._samples)[-count:]
        return len(newest) == count and self._are_together(newest)

    def departed(self) -> float:
        """When it left where it lay, s: where the line through the first two samples that are lifted meets that.

        Not before it was last seen there, and not after the first of them.
        """
        samples = list(self._samples)
        low = next((k for k in reversed(range(len(samples))) if self.rise(samples[k]) <= _LOW * self._lifted), -1)
        above = [sample for sample in samples[low + 1 :] if self._is_high(sample)]
        if not above:
            return samples[-1].time
        first, rise = above[0], self.rise(above[0])
        earliest = samples[low].time if low >= 0 else first.time
        if len(above) > 1 and self.rise(above[1]) > rise:
            speed = (self.rise(above[1]) - rise) / (above[1].time - first.time)
            return min(max(first.time - rise / speed, earliest), first.time)
        return 0.5 * (earliest + first.time)

    def settled(self) -> float:
        """When it came to where it is now, s: the first sample of those that stayed there."""
        samples = list(self._samples)
        arrived = samples[-1]
        for sample in reversed(samples):
            if not self._are_together([sample, samples[-1]]):
                return arrived.time
            arrived = sample
        return arrived.time if self._stayed_since is None else self._stayed_since

    def speed(self) -> float:
        """How fast its bottom moves upwards between the last two samples, m/s."""
        if len(self._samples) < 2:
            return 0.0
        before, last = self._samples[-2], self._samples[-1]
        return (last.bottom - before.bottom) / (last.time - before.time)

    def lowering(self, count: int = CONFIRM_FRAMES) -> float:
        """How fast (m/s) it came down in so many steps before the last sample; 0 if it did not in one of them."""
        newest = list(self._samples)[-count - 1 :]
        if len(newest) <= count or any(later.bottom >= sample.bottom for sample, later in pairwise(newest)):
            return 0.0
        return (newest[0].bottom - newest[-1].bottom) / (newest[-1].time - newest[0].time)

    def before(self, time: float) -> Height | None:
        """The last sample until `time` (s)."""
        return next((sample for sample in reversed(self._samples) if sample.time <= time), None)

    def _is_high(self, sample: Height) -> bool:
        return self.rise(sample) > max(self._lifted, _LIFTED_SIGMAS * sample.sigma)

    def _are_together(self, samples: list[Height]) -> bool:
        spans = (
            max(sample.position[k] for sample in samples) - min(sample.position[k] for sample in samples)
            for k in range(3)
        )
        return max(spans) <= self._steady
