"""One-Euro filters: strong smoothing at rest, little lag in motion.

A first-order low-pass filter whose cutoff frequency grows with the speed: f = cutoff + per_speed |v|, with the speed
itself low-passed (Casiez, Roussel and Vogel: "1 euro filter", CHI 2012). At a sampling interval dt the new sample
weighs a = 1 / (1 + 1 / (2 pi f dt)).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agents.hand_tracker.config import Smoothing
from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion

Array = NDArray[np.float64]

_GOOD_TURN = 0.08  # rad, standard deviation of a sample of which half is taken


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
        """Put it somewhere without a measurement."""
        self.point, self.stamp = point, stamp


class TurnFilter:
    """Smooths a rotation."""

    def __init__(self, config: Smoothing, rotation: Quaternion, stamp: float) -> None:
        self._config = config
        self.rotation = rotation
        self._stamp = stamp
        self._speed = 0.0

    def update(self, rotation: Quaternion, stamp: float, covariance: Array | None = None) -> Quaternion:
        """The smoothed rotation after a new sample; one that is not newer changes nothing.

        Of what the sample tells badly, by its `covariance` (3, 3) rad^2 in the frame of the parent, little is taken.
        """
        interval = stamp - self._stamp
        if interval > 0.0:
            rotation = self._told(rotation, covariance)
            between = quaternions.product(quaternions.conjugate(self.rotation), rotation)
            angle = math.hypot(*quaternions.to_rotvec(between))
            self._speed += weight(self._config.speed_cutoff, interval) * (angle / interval - self._speed)
            cutoff = self._config.cutoff + self._config.per_turn * self._speed
            self.rotation = quaternions.slerp(self.rotation, rotation, weight(cutoff, interval))
            self._stamp = stamp
        return self.rotation

    def _told(self, rotation: Quaternion, covariance: Array | None) -> Quaternion:
        """A sample moved towards the present rotation about axes that it tells badly."""
        if covariance is None:
            return rotation
        turn = quaternions.to_rotvec(quaternions.product(rotation, quaternions.conjugate(self.rotation)))
        x, y, z = np.linalg.solve(np.eye(3) + covariance / _GOOD_TURN**2, np.array(turn)).tolist()
        return quaternions.product(quaternions.from_rotvec((x, y, z)), self.rotation)


def weight(cutoff: float, interval: float) -> float:
    """Of a new sample in a low-pass filter of `cutoff` Hz, `interval` s after the last one."""
    return 1.0 / (1.0 + 1.0 / (2.0 * math.pi * cutoff * interval))
