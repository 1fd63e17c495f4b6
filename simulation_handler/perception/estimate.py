"""The pose of an object at rest, averaged over its percepts.

An information filter averages the noise of the percepts, which changes from frame to frame. The systematic error
along the viewing ray is the same in all of them and stays out of the average: see `Estimate.total_covariance`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion
from dsr.perception.scales import LIKELY_SIGMAS, SAME_PLACE, SURE_SIGMAS
from simulation_handler.config import BeliefConfig
from simulation_handler.perception.percepts import Array, WeighedPercept
from simulation_handler.scales import PLACE_FLOOR, TURN_FLOOR

Innovation = tuple[Array, Array]
"""From an estimate to a percept, in the world frame: shift (3,) m and rotation vector (3,) rad."""
Compared = tuple[WeighedPercept, Innovation]
"""A percept, and how far it was from the estimate when it came."""

_EYE = np.eye(3)


class RayError(NamedTuple):
    """Systematic error of percepts along the viewing ray: a Gaussian."""

    mean: float
    """m"""
    std: float
    """m, standard deviation"""

    @property
    def is_known(self) -> bool:
        """Whether it is known so well that it makes no other place of where something is seen."""
        return SURE_SIGMAS * self.std <= SAME_PLACE


class Estimate:
    """Average of the percepts of an object at rest."""

    def __init__(self, percept: WeighedPercept, config: BeliefConfig) -> None:
        self.position = percept.position
        self.rotation = percept.rotation
        self.position_covariance = percept.position_covariance
        self.rotation_covariance = percept.rotation_covariance
        self.ray = percept.ray
        self.stamp = percept.stamp
        self.count = 1
        self._config = config

    def accepts(self, percept: WeighedPercept) -> bool:
        """Whether the percept may be of an object that has not moved: within the gate in place and rotation."""
        shift, rotation = self.innovation(percept)
        limit = self._config.gate**2
        is_near = _mahalanobis2(shift, self.position_covariance + percept.position_covariance) <= limit
        return is_near and _mahalanobis2(rotation, self.rotation_covariance + percept.rotation_covariance) <= limit

    def farthest(self, recent: Sequence[Compared], gate: float, fewest: int) -> int:
        """Of how many of the last percepts, `fewest` or more, the mean is farthest beyond the gate; 0 if none is."""
        if len(recent) < fewest:
            return 0
        counts = np.arange(1, len(recent) + 1)[:, None]
        newest = recent[::-1]
        means = np.cumsum(np.array([innovation for _, innovation in newest]), axis=0) / counts[:, None]
        noises = np.array([(percept.position_covariance, percept.rotation_covariance) for percept, _ in newest])
        noise = np.cumsum(noises, axis=0) / (counts**2)[..., None, None]
        known = np.stack([self.position_covariance, self.rotation_covariance])
        solved = np.linalg.solve(known + noise, means[..., None])[..., 0]
        distances2 = (means * solved).sum(axis=-1).max(axis=1)[fewest - 1 :]
        if not np.any(distances2 > gate**2):
            return 0
        return fewest + int(np.argmax(distances2))

    def fuse(self, percept: WeighedPercept) -> None:
        """Take in a percept; with more than the window's, the older ones count less and less (Kalman update)."""
        self.count += 1
        keep = 1.0 if self.count <= self._config.window else 1.0 - 1.0 / self._config.window
        innovation, rotation = self.innovation(percept)
        gain, self.position_covariance = _update(self.position_covariance / keep, percept.position_covariance)
        self.position = self.position + gain @ innovation
        gain, self.rotation_covariance = _update(self.rotation_covariance / keep, percept.rotation_covariance)
        x, y, z = (gain @ rotation).tolist()
        step = quaternions.from_rotvec((x, y, z))
        self.rotation = quaternions.normalised(quaternions.product(step, self.rotation))
        self.ray, self.stamp = percept.ray, percept.stamp

    def loosen(self, recent: Sequence[Compared]) -> None:
        """Doubt the estimate in the direction in which some percepts agree that it is off, as surely as they tell."""
        shift, rotation = np.mean([innovation for _, innovation in recent], axis=0)
        noises = np.array([(percept.position_covariance, percept.rotation_covariance) for percept, _ in recent])
        noise, turning = noises.sum(axis=0) / len(recent) ** 2
        self.position_covariance = self.position_covariance + np.outer(shift, shift) + noise
        self.rotation_covariance = self.rotation_covariance + np.outer(rotation, rotation) + turning

    def inherit(self, old: Estimate) -> None:
        """Keep position and rotation of an older estimate, each if it has not changed beyond noise."""
        shift, rotation = old.position - self.position, self._rotation_to(old.rotation)
        limit = self._config.gate**2
        if _mahalanobis2(shift, self.position_covariance + old.position_covariance) <= limit:
            self.position, self.position_covariance, self.count = old.position, old.position_covariance, old.count
        if _mahalanobis2(rotation, self.rotation_covariance + old.rotation_covariance) <= limit:
            self.rotation, self.rotation_covariance = old.rotation, old.rotation_covariance

    def corrected(self, error: float) -> Array:
        """(3,) m, the position without a systematic error of `error` m along the viewing ray."""
        corrected: Array = self.position - error * self.ray
        return corrected

    def error_given(self, height: float) -> RayError | None:
        """Systematic error along the viewing ray, if the object is really at `height` (m); None if more must be wrong.

        The error is Gaussian around 0, and heights are known but for `PLACE_FLOOR`. So the flatter the ray, the less a
        height tells (Bayes' theorem for Gaussians).
        """
        prior, slope, off = self._config.depth_bias**2, float(self.ray[2]), float(self.position[2] - height)
        surprise = slope**2 * prior + PLACE_FLOOR**2
        if not abs(off) <= LIKELY_SIGMAS * math.sqrt(surprise):
            return None
        return RayError(slope * prior * off / surprise, PLACE_FLOOR * math.sqrt(prior / surprise))

    def total_covariance(self, error_std: float) -> Array:
        """Covariance (3, 3) of the position, m^2: remaining noise, and systematic error along the viewing ray (m)."""
        total: Array = self.position_covariance + error_std**2 * (self.ray[:, None] * self.ray)
        return total

    def total_turning(self) -> Array:
        """Covariance (3, 3) of the rotation, rad^2: remaining noise, and what is no noise of percepts."""
        total: Array = self.rotation_covariance + TURN_FLOOR**2 * _EYE
        return total

    def standard_deviations(self) -> tuple[float, float]:
        """The remaining noise sideways (m, of one axis) and in yaw (rad)."""
        position, rotation = self.position_covariance, self.rotation_covariance
        return math.sqrt(0.5 * (position[0, 0] + position[1, 1])), math.sqrt(rotation[2, 2])

    def innovation(self, percept: WeighedPercept) -> Innovation:
        """Measure the difference between a percept and the estimate."""
        return percept.position - self.position, self._rotation_to(percept.rotation)

    def _rotation_to(self, rotation: Quaternion) -> Array:
        """(3,) rotation vector in the world frame from the estimate to another rotation, rad."""
        return np.array(quaternions.to_rotvec(quaternions.product(rotation, quaternions.conjugate(self.rotation))))


def fused(percepts: Sequence[WeighedPercept], config: BeliefConfig) -> Estimate | None:
    """Their average, or None if they are not all of one pose."""
    estimate = Estimate(percepts[0], config)
    for percept in percepts[1:]:
        if not estimate.accepts(percept):
            return None
        estimate.fuse(percept)
    return estimate


def _mahalanobis2(difference: Array, covariance: Array) -> float:
    return float(difference @ np.linalg.solve(covariance, difference))


def _update(prior: Array, noise: Array) -> tuple[Array, Array]:
    """Kalman gain and posterior covariance of a direct measurement."""
    gain = prior @ np.linalg.inv(prior + noise)
    posterior = (_EYE - gain) @ prior
    return gain, 0.5 * (posterior + posterior.T)
