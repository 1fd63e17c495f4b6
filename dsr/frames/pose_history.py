"""The recent samples of one moving frame, to be asked for its pose at a time."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from operator import attrgetter

from dsr.math3d.transforms import Pose, interpolate

_stamp_of = attrgetter("stamp")


class PoseHistory:
    """Samples of one geometric edge, sorted by stamp and bounded in time and number; never empty.

    A single sample, and any with the stamp 0.0, holds at all times. One thread may add while others read:
    each change of the list is one indivisible operation, and `at` works on its own copy of the list.

    Args:
        pose: the first sample.
        seconds: s, how far samples reach back from the newest.
        most: how many samples are kept.
    """

    __slots__ = ("_most", "_samples", "_seconds")

    def __init__(self, pose: Pose, seconds: float, most: int) -> None:
        self._samples = [pose]
        self._seconds = seconds
        self._most = most

    def copy(self) -> PoseHistory:
        """Make an independent history with the same samples."""
        other = PoseHistory.__new__(PoseHistory)
        other._samples, other._seconds, other._most = self._samples[:], self._seconds, self._most
        return other

    @property
    def newest(self) -> Pose:
        """The sample with the latest stamp."""
        return self._samples[-1]

    @property
    def span(self) -> tuple[float, float]:
        """Stamps of the oldest and the newest sample, s."""
        samples = self._samples[:]
        return samples[0].stamp, samples[-1].stamp

    def add(self, pose: Pose) -> None:
        """Insert a sample in the order of stamps, in the place of one with an equal stamp.

        A sample that is static, or older than the history reaches back (a clock was set back), starts
        the history afresh; a moving sample ends a static one.
        """
        samples = self._samples
        stamp, newest = pose.stamp, samples[-1].stamp
        if stamp == 0.0 or newest == 0.0 or stamp < newest - self._seconds:
            if pose != samples[-1]:
                self._samples = [pose]
        elif stamp > newest:
            samples.append(pose)
            self._trim()
        else:
            self._insert(pose)

    def end_with(self, pose: Pose) -> None:
        """Insert a sample and forget those of later stamps."""
        earlier = bisect_left(self._samples, pose.stamp, key=_stamp_of)
        self._samples = [*self._samples[:earlier], pose]

    def _insert(self, pose: Pose) -> None:
        samples = self._samples
        place = bisect_left(samples, pose.stamp, key=_stamp_of)
        if samples[place].stamp != pose.stamp:
            samples.insert(place, pose)
            self._trim()
        elif samples[place] != pose:
            samples[place] = pose

    def _trim(self) -> None:
        samples = self._samples
        horizon = samples[-1].stamp - self._seconds
        if len(samples) <= self._most and samples[0].stamp >= horizon:
            return
        if len(samples) <= self._most + 1 and samples[1].stamp >= horizon:
            del samples[0]
        else:
            del samples[: bisect_left(samples, horizon, max(0, len(samples) - self._most), key=_stamp_of)]

    def since(self, time: float) -> list[Pose]:
        """The samples of later stamps than `time` s, the oldest first."""
        samples = self._samples[:]
        return samples[bisect_right(samples, time, key=_stamp_of) :]

    def at(self, time: float, hold: float) -> Pose | None:
        """The pose at `time` s, interpolated between samples; None where it is not known.

        For `hold` s after the newest sample, that one still holds; nothing is known before the oldest.
        """
        samples = self._samples[:]
        after = bisect_right(samples, time, key=_stamp_of)
        if len(samples) == 1:
            return samples[0]
        if after == len(samples):
            return samples[-1] if time <= samples[-1].stamp + hold else None
        return interpolate(samples[after - 1], samples[after], time) if after > 0 else None
