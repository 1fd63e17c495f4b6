"""Which hand is which from frame to frame: two tracks with smoothed palms and fingertips, in the world.

Hands seen are given to tracks at the least total distance (the Hungarian method). A hand out of sight keeps its track:
what appears within what it can have moved since, and is not known to be of the other side, is that hand again. A hand
that no track can be takes a free number, 0 if it is a right one and 1 a left one where that is free, or that of the
hand that was out of sight for longest; what appears closer to one that is seen than two hands can be is a part of that,
which something cuts in two.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from agents.hand_tracker.config import HandTrackerConfig, Smoothing
from agents.hand_tracker.sighting import MOST_TURN, SeenHand, Side, Source
from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion
from dsr.math3d.transforms import Pose

Array = NDArray[np.float64]

_TURNS = 0.08
"""rad, standard deviation of what a palm may have turned since the last frame, however well that told it"""
_SURE = 1e-3  # rad, standard deviation of a sample whose one is unknown, and the least


class PointFilter:
    """Smooths a point (3,) in m."""

    def __init__(self, config: Smoothing, point: Array, stamp: float) -> None:
        self._config = config
        self.point = point
        self.stamp = stamp
        self.velocity: Array = np.zeros(3)
        """m/s"""

    def update(self, point: Array, stamp: float) -> Array:
        """The smoothed point after a new sample; one that is not newer changes nothing."""
        interval = stamp - self.stamp
        if interval > 0.0:
            speed_weight = weight(self._config.speed_cutoff, interval)
            self.velocity = self.velocity + speed_weight * ((point - self.point) / interval - self.velocity)
            cutoff = self._config.cutoff + self._config.per_speed * float(np.linalg.norm(self.velocity))
            self.point = self.point + weight(cutoff, interval) * (point - self.point)
            self.stamp = stamp
        return self.point

    def shift(self, point: Array, stamp: float) -> None:
        """Set the filtered point without a measurement."""
        self.point, self.stamp = point, stamp


class TurnFilter:
    """A One-Euro filter of a rotation that knows how sure it is: of a sample that tells less, it takes little.

    A sample that tells much more than what is known so far is not smoothed with that, but takes its place. Errors of
    samples repeat from frame to frame: many of them tell no more than the best.

    Args:
        config: of the smoothing.
        rotation: the first sample.
        stamp: s, of that.
        covariance: (3, 3) rad^2 of that, in the frame of the parent; None if unknown: it counts as sure.
    """

    def __init__(self, config: Smoothing, rotation: Quaternion, stamp: float, covariance: Array | None = None) -> None:
        self._config = config
        self.rotation = rotation
        self._stamp = stamp
        self._speed = 0.0
        self._known = _between(_information(covariance), 0.0, 1.0 / _TURNS**2)

    def update(self, rotation: Quaternion, stamp: float, covariance: Array | None = None) -> Quaternion:
        """The smoothed rotation after a new sample; one that is not newer changes nothing.

        `covariance` (3, 3) rad^2 is that of the sample in the frame of the parent; None if unknown: it counts as sure.
        """
        interval = stamp - self._stamp
        if interval > 0.0:
            told, known = _information(covariance), self._known
            between = quaternions.product(rotation, quaternions.conjugate(self.rotation))
            turn = np.linalg.pinv(known + told, hermitian=True) @ told @ np.array(quaternions.to_rotvec(between))
            speed = float(np.linalg.norm(turn)) / interval
            self._speed += weight(self._config.speed_cutoff, interval) * (speed - self._speed)
            share = weight(self._config.cutoff + self._config.per_turn * self._speed, interval)
            x, y, z = (turn - (1.0 - share) * _TURNS**2 * known @ turn).tolist()
            self.rotation = quaternions.product(quaternions.from_rotvec((x, y, z)), self.rotation)
            self._known = _between(known + _between(told - known, 0.0, math.inf), 0.0, 1.0 / _TURNS**2)
            self._stamp = stamp
        return self.rotation


def _information(covariance: Array | None) -> Array:
    """(3, 3) 1/rad^2, what a sample of that covariance (rad^2) tells; none along axes of which nothing is known."""
    told = np.eye(3) / _SURE**2 if covariance is None else np.linalg.inv(covariance)
    return _between(told - np.eye(3) / MOST_TURN**2, 0.0, 1.0 / _SURE**2)


def _between(matrix: Array, least: float, most: float) -> Array:
    """A symmetric matrix with its eigenvalues clipped."""
    values, axes = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return np.asarray((axes * np.clip(values, least, most)) @ axes.T, dtype=np.float64)


def weight(cutoff: float, interval: float) -> float:
    """Weight of a new sample in a low-pass filter of `cutoff` Hz, `interval` s after the last one."""
    return 1.0 / (1.0 + 1.0 / (2.0 * math.pi * cutoff * interval))


HANDS = 2
FINGERS = 5
_GATE = 0.15
"""m, that a hand may be off at least; what it can have moved is added"""
_TIP_GATE = 0.05
"""m, that a fingertip may move in the palm's frame from frame to frame"""
_CLOSEST, _LENGTH = 0.08, 0.18
"""m, between palms: nearer than the first no second hand appears, nor what may be a part nearer than the second"""
_NEVER = 1e6


class Fingertip:
    """One fingertip of a track."""

    def __init__(self, filter_: PointFilter, palm: Pose) -> None:
        self.filter = filter_
        self.last_seen = filter_.stamp
        """s"""
        self.in_palm: Array = palm.inverse().apply(filter_.point[None])[0]
        """(3,) m, where it was when it was last seen"""
        self.outlined: Array = filter_.point
        """(3,) m, where it was when the outline of the hand last showed it"""
        self.outlined_at = -math.inf
        """s, when that was"""


class HandTrack:
    """One hand over time, in the world.

    Args:
        number: of the hand.
        config: of the tracker.
        palm: world_from_palm, and when.
        side: of the hand.
        source: of the palm.
        turn_covariance: (3, 3) rad^2 of its rotation, in the world; None if unknown: it counts as sure.
    """

    def __init__(
        self,
        number: int,
        config: HandTrackerConfig,
        palm: Pose,
        side: Side,
        source: Source | str,
        turn_covariance: Array | None = None,
    ) -> None:
        self.number = number
        self.side = side
        self.source = source
        self.last_seen = palm.stamp
        """s"""
        self.sigma = 0.0
        """m, of each coordinate of a fingertip as it was measured"""
        self.palm_sigma = 0.0
        """m, likewise of the palm, where that is more than landmarks would give it"""
        self.turn_sigma = 0.0
        """rad, of the palm's rotation as it was measured, about the axis that is known worst; 0 if unknown"""
        self.tips: dict[int, Fingertip] = {}
        """By finger, 0 (thumb) to 4 (little finger)."""
        self._config = config
        self._point = PointFilter(config.smoothing, palm.translation, palm.stamp)
        self._turn = TurnFilter(config.smoothing, palm.q, palm.stamp, turn_covariance)

    @property
    def palm(self) -> Pose:
        """world_from_palm, smoothed, with its time."""
        return Pose(self._point.point, self._turn.rotation, self._point.stamp)

    def distance(self, hand: SeenHand) -> float:
        """m, from where it is expected."""
        coasting = min(max(hand.palm.stamp - self.last_seen, 0.0), self._config.max_age)
        expected = self._point.point + coasting * self._point.velocity
        return float(np.linalg.norm(hand.palm.translation - expected))

    def reach(self, stamp: float) -> float:
        """m, that it can be from where it is expected."""
        return _GATE + self._config.most_speed * max(stamp - self.last_seen, 0.0)

    def update(self, hand: SeenHand, source: Source) -> None:
        """Take in the hand as it was seen, in the world."""
        stamp = hand.palm.stamp
        if stamp - self.last_seen > self._config.max_age:  # it may have moved anywhere: no smoothing across that
            self._point = PointFilter(self._config.smoothing, hand.palm.translation, stamp)
            self._turn = TurnFilter(self._config.smoothing, hand.palm.q, stamp, hand.turn_covariance)
            self.tips.clear()
        self._point.update(hand.palm.translation, stamp)
        self._update_turn(hand)
        self.last_seen = max(self.last_seen, stamp)
        self.source, self.sigma, self.palm_sigma = source, hand.sigma, hand.palm_sigma
        if hand.side != "unknown":
            self.side = hand.side
        if not hand.is_labelled:
            self._update_tips(self._labelled(hand), stamp)
            return
        outlined = self._outlined(hand)
        is_outlined = any(self._was_outlined(finger, stamp) for finger in self.tips)
        self._update_tips(outlined if outlined or is_outlined else hand.tips, stamp)
        for finger, point in outlined.items():
            self.tips[finger].outlined, self.tips[finger].outlined_at = point, stamp

    def _update_turn(self, hand: SeenHand) -> None:
        """Take in how the palm is turned."""
        covariance = hand.turn_covariance
        self._turn.update(hand.palm.q, hand.palm.stamp, covariance)
        self.turn_sigma = 0.0 if covariance is None else float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))

    def _update_tips(self, tips: dict[int, Array], stamp: float) -> None:
        palm = self.palm
        for finger, point in tips.items():
            known = self.tips.get(finger)
            if known is None or stamp - known.last_seen > self._config.max_age:
                self.tips[finger] = Fingertip(PointFilter(self._config.smoothing, point, stamp), palm)
            else:
                known.filter.update(point, stamp)
                known.in_palm = palm.inverse().apply(known.filter.point[None])[0]
                known.last_seen = max(known.last_seen, stamp)
        for finger, known in list(self.tips.items()):
            if finger not in tips:
                known.filter.shift(palm.apply(known.in_palm[None])[0], stamp)
            if stamp - known.last_seen > self._config.finger_retention:
                del self.tips[finger]

    def _outlined(self, hand: SeenHand) -> dict[int, Array]:
        """The fingers of the outline's fingertips: those that were there before, or to which the landmarks are near."""
        if not hand.outlined:
            return {}
        points, stamp = np.array([tip.point for tip in hand.outlined]), hand.palm.stamp
        distances = np.array([tip.across for tip in hand.outlined]).T
        for finger in range(FINGERS):
            if self._was_outlined(finger, stamp):
                known = self.tips[finger]
                expected = known.outlined + (stamp - known.outlined_at) * self._point.velocity
                distances[finger] = np.linalg.norm(points - expected, axis=1)
        pairs = zip(*linear_sum_assignment(np.minimum(distances, 2 * _TIP_GATE)), strict=True)
        return {int(finger): points[index] for finger, index in pairs if distances[finger, index] <= _TIP_GATE}

    def _was_outlined(self, finger: int, stamp: float) -> bool:
        """Whether the outline showed a finger just now: where the landmarks take fingers to be is a guess then."""
        return finger in self.tips and stamp - self.tips[finger].outlined_at <= self._config.max_age

    def _labelled(self, hand: SeenHand) -> dict[int, Array]:
        """Fingertips that do not tell their finger: those that were there before go on, others take free numbers."""
        points = list(hand.tips.values())[:FINGERS]
        if not self.tips:
            return dict(zip(_first_fingers(len(points)), _around(hand.palm, points), strict=True))
        fingers = list(self.tips)
        inverse = hand.palm.inverse()
        local = inverse.apply(np.array(points).reshape(-1, 3))
        before = np.array([self.palm.inverse().apply(self.tips[k].filter.point[None])[0] for k in fingers])
        distances = np.linalg.norm(before[:, None] - local[None], axis=2)
        found: dict[int, Array] = {}
        left = set(range(len(points)))
        for row, column in zip(*linear_sum_assignment(np.minimum(distances, 2 * _TIP_GATE)), strict=True):
            if distances[row, column] <= _TIP_GATE:
                found[fingers[row]] = points[column]
                left.discard(int(column))
        free = [finger for finger in range(FINGERS) if finger not in self.tips]
        return found | {finger: points[index] for finger, index in zip(free, sorted(left), strict=False)}


class Tracks:
    """The hands that are known.

    Args:
        config: of the tracker.
    """

    def __init__(self, config: HandTrackerConfig) -> None:
        self._config = config
        self.by_number: dict[int, HandTrack] = {}
        self.ignored = 0
        """Hands seen that were one too many, or parts of others."""

    def adopt(self, track: HandTrack) -> None:
        """Go on with a hand that an earlier run knew."""
        self.by_number[track.number] = track

    def forget(self, number: int) -> None:
        """Let a number be free."""
        self.by_number.pop(number, None)

    def update(self, hands: list[SeenHand], source: Source, stamp: float) -> set[int]:
        """Take in the hands of one frame, in the world; returns the numbers of those that are new."""
        tracks = list(self.by_number.values())
        unmatched = set(range(len(hands)))
        if tracks and hands:
            costs = np.array([[self._cost(track, hand, stamp) for hand in hands] for track in tracks])
            for row, column in zip(*linear_sum_assignment(costs), strict=True):
                if costs[row, column] < _NEVER:
                    tracks[row].update(hands[column], source)
                    unmatched.discard(int(column))
        return {number for index in sorted(unmatched) if (number := self._begin(hands[index], source)) is not None}

    def _cost(self, track: HandTrack, hand: SeenHand, stamp: float) -> float:
        other_side = {track.side, hand.side} == {"left", "right"}
        distance = track.distance(hand)
        lost = stamp - track.last_seen > self._config.max_age
        if distance > track.reach(stamp) or (other_side and lost):
            return _NEVER
        return distance + (_GATE if other_side else 0.0)

    def _begin(self, hand: SeenHand, source: Source) -> int | None:
        number = self._free_number(hand) if hand.begins and not self._is_part(hand) else None
        if number is None:
            self.ignored += 1
            return None
        track = HandTrack(number, self._config, hand.palm, hand.side, source, hand.turn_covariance)
        track.update(hand, source)
        self.by_number[number] = track
        return number

    def _is_part(self, hand: SeenHand) -> bool:
        seen = [track for track in self.by_number.values() if track.last_seen == hand.palm.stamp]
        alike = [track.palm for track in seen if {track.side, hand.side} != {"left", "right"}]
        apart = [float(np.linalg.norm(palm.translation - hand.palm.translation)) for palm in alike]
        return min(apart, default=np.inf) < (_CLOSEST if hand.is_whole else _LENGTH)

    def _free_number(self, hand: SeenHand) -> int | None:
        free = [number for number in range(HANDS) if number not in self.by_number]
        if free:
            wanted = 1 if hand.side == "left" else 0
            return wanted if wanted in free else free[0]
        oldest = min(self.by_number.values(), key=lambda track: track.last_seen)
        return oldest.number if hand.palm.stamp - oldest.last_seen > self._config.max_age else None


def _first_fingers(count: int) -> range:
    """Numbers for fingertips that are seen first: one alone is an index finger, more begin with the thumb."""
    return range(1, 2) if count == 1 else range(count)


def _around(palm: Pose, points: list[Array]) -> list[Array]:
    """Fingertips in the order of their angle about the palm, beginning at the end that has more room to the next."""
    if len(points) < 2:
        return points
    local = palm.inverse().apply(np.array(points))
    angles = np.arctan2(local[:, 1], local[:, 0])
    order = [int(index) for index in np.argsort(angles)]
    gaps = np.diff(angles[order])
    if gaps[-1] > gaps[0]:
        order.reverse()
    return [points[index] for index in order]
