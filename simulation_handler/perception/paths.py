"""The path of an object as it was seen: percepts, and poses in between."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from itertools import pairwise

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.math3d.transforms import Pose
from dsr.perception.scales import FASTEST_SEEN, FRAME, LONGEST_GAP, RECENT_PERCEPTS, SLOW
from dsr.vocabulary.nats import DECIDE
from simulation_handler.scales import GONE_FROM

_KEPT_PERCEPTS = 2 * RECENT_PERCEPTS
_FALLING_SPEED = 0.4  # m/s downwards, faster than what somebody puts down


class Path:
    """The newest percepts of one object; poses are in the world."""

    def __init__(self) -> None:
        self._poses: deque[Pose] = deque(maxlen=_KEPT_PERCEPTS)
        self._doubted: Pose | None = None

    def add(self, pose: Pose) -> None:
        """Take in a percept that is newer than the last one. A distant one counts once the next percept confirms it."""
        if pose.stamp <= self.newest:
            return
        if self._poses and _is_break(self._poses[-1], pose):
            doubted, self._doubted = self._doubted, pose
            if doubted is None or _is_break(doubted, pose):
                return
            self._poses.append(doubted)
        self._doubted = None
        self._poses.append(pose)

    def begin_anew(self, pose: Pose) -> None:
        """Forget the way so far, which the object did not take, and begin there."""
        self._poses.clear()
        self._doubted = None
        self._poses.append(pose)

    @property
    def newest(self) -> float:
        """Stamp of the last percept, s."""
        return self._poses[-1].stamp if self._poses else -math.inf

    @property
    def last(self) -> Pose:
        """The last percept."""
        return self._poses[-1]

    def since(self, stamp: float) -> list[Pose]:
        """The percepts that are kept since a time (s), at least the last one."""
        return [pose for pose in self._poses if pose.stamp >= stamp] or [self.last]

    @property
    def is_falling(self) -> bool:
        """Whether the object was falling when it was last seen."""
        if len(self._poses) < 2:
            return False
        before, last = self._poses[-2], self._poses[-1]
        return before.t[2] - last.t[2] > _FALLING_SPEED * (last.stamp - before.stamp)

    def start(self, pose: Pose, distance: float) -> float | None:
        """When (s) the object left `pose`: the stamp of the last percept that is within `distance` m of it.

        None if it did not get from there to the last percept on a way without a break: it was not seen for a while,
        or jumped.
        """
        poses = list(self._poses)
        near = [index for index, one in enumerate(poses) if math.dist(one.t, pose.t) <= distance]
        if not near or any(_is_break(a, b) for a, b in pairwise(poses[near[-1] :])):
            return None
        return poses[near[-1]].stamp

    def reappeared(self, distance: float) -> Pose | None:
        """Where the object was first seen after a break, if it has been seen to move on by `distance` m since.

        None if there was no break, or it does not move.
        """
        poses = list(self._poses)
        breaks = [k for k, (a, b) in enumerate(pairwise(poses), start=1) if _is_break(a, b)]
        if not breaks or len(poses) - breaks[-1] < 3 or not any(self.velocity):  # count: a single one shows no motion
            return None
        first = poses[breaks[-1]]
        return first if math.dist(first.t, poses[-1].t) > distance else None

    def at(self, stamp: float) -> Pose:
        """Where it was at a time (s) between two percepts, smoothed; before all of them, where it was first; after
        them, where it is going, at most 0.1 s ahead.
        """
        index = bisect_right([pose.stamp for pose in self._poses], stamp)
        if index == 0:
            return self._smooth(0)
        before = self._smooth(index - 1)
        if index == len(self._poses):
            return self._ahead(min(stamp - self.newest, FRAME))
        after = self._smooth(index)
        share = (stamp - before.stamp) / (after.stamp - before.stamp)
        return between(before, after, share)

    def is_still(self, seconds: float, metres: float, radians: float) -> bool:
        """Whether it was seen, over the last `seconds`, to move by less than `metres` and `radians` in half of them."""
        if not self._poses or self._poses[0].stamp > self.newest - seconds:
            return False
        middle = 0.5 * 0.5 * seconds  # of either half of the time
        before, after = self.at(self.newest - seconds + middle), self.at(self.newest - middle)
        apart, turned = before.distance(after)
        return apart <= metres and turned <= radians

    def strays_from(self, pose: Pose, metres: float) -> bool:
        """Whether the object was farther than `metres` from `pose` in several of the last percepts, not just in one."""
        if len(self._poses) < 3:  # count: a single wrong percept shows no motion
            return False
        before, last = self._poses[-2], self._poses[-1]
        if min(math.dist(before.t, pose.t), math.dist(last.t, pose.t)) <= metres:
            return False
        smoothed = self._smooth(len(self._poses) - 2)  # of that the last one is a part: alone it would drag it along
        return math.dist(smoothed.t, pose.t) > metres

    def goes_away(self, pose: Pose, metres: float) -> bool:
        """Whether the last three percepts are farther than `metres` from `pose`, each farther than the one before."""
        apart = [math.dist(one.t, pose.t) for one in list(self._poses)[-3:]]
        return len(apart) == 3 and metres < apart[0] < apart[1] < apart[2]

    @property
    def velocity(self) -> Vector3:
        """(3,) m/s, as it was seen to move last; 0 if it was not on its way."""
        return self._velocity(DECIDE)

    @property
    def steady_velocity(self) -> Vector3:
        """(3,) m/s at which it goes on surely: what jumped, turned or has stopped does not go on as before."""
        before, last = self._velocity(DECIDE), self._velocity(1)
        if sum(a * b for a, b in zip(before, last, strict=True)) <= 0.0:
            return 0.0, 0.0, 0.0
        return min(before, last, key=lambda velocity: math.hypot(*velocity))

    def _velocity(self, periods: int) -> Vector3:
        """(3,) m/s, the mean over the last periods between percepts."""
        if not self._poses:
            return 0.0, 0.0, 0.0
        last, before = self._poses[-1], self._poses[max(len(self._poses) - 1 - periods, 0)]
        passed = last.stamp - before.stamp
        if not 0.0 < passed <= LONGEST_GAP * periods or math.dist(last.t, before.t) < SLOW * passed:
            return 0.0, 0.0, 0.0
        x, y, z = ((a - b) / passed for a, b in zip(last.t, before.t, strict=True))
        return x, y, z

    def _ahead(self, seconds: float) -> Pose:
        """Where it is some time after the last percept, if it goes on as it did."""
        last = self._poses[-1]
        x, y, z = (a + seconds * speed for a, speed in zip(last.t, self.velocity, strict=True))
        return Pose.unchecked((x, y, z), last.q, last.stamp)

    def _smooth(self, index: int) -> Pose:
        """Mean of the middles between a percept and those around it; the first and the last are as they are."""
        pose = self._poses[index]
        if 0 < index < len(self._poses) - 1:
            middles = [between(pose, other, 0.5) for other in (self._poses[index - 1], self._poses[index + 1])]
            mean = between(middles[0], middles[1], 0.5)
            return Pose.unchecked(mean.t, mean.q, pose.stamp)
        return pose


def between(a: Pose, b: Pose, share: float) -> Pose:
    """Interpolate from pose a (share 0) to pose b (share 1), in a straight line and turning evenly."""
    x, y, z = (p + share * (q - p) for p, q in zip(a.t, b.t, strict=True))
    return Pose.unchecked((x, y, z), quaternions.slerp(a.q, b.q, share), a.stamp + share * (b.stamp - a.stamp))


def turn_between(a: Quaternion, b: Quaternion) -> Vector3:
    """Rotation vector (rad, in the world frame) from one rotation to another, the shorter way."""
    return quaternions.to_rotvec(quaternions.product(b, quaternions.conjugate(a)))


def _is_break(a: Pose, b: Pose) -> bool:
    seconds = b.stamp - a.stamp
    if seconds > LONGEST_GAP:
        return True
    return math.dist(a.t, b.t) > FASTEST_SEEN * seconds + GONE_FROM
