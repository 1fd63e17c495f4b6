"""Percepts of one object fused over time: noise is averaged, single wrong frames are ignored, moves followed.

While the object rests, an information filter averages its percepts. A percept beyond the gate is set aside;
only several in a row mean that the object has moved. The systematic error along the viewing ray is the same in
each percept and stays out of the average: see `Estimate.total_covariance`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dsr import quaternions
from dsr.quaternions import Quaternion, Vector3
from dsr.transforms import Pose
from simulation_handler.config import BeliefConfig

Array = NDArray[np.float64]

_ROUNDING = 1e-9
_EYE = np.eye(3)
_RECENT = 8  # percepts whose mean shows a move too small for the gate of a single one
_MOST_SIGMAS = 2.0  # standard deviations of the bias beyond which it explains nothing
_STEEP_RAY = 0.5  # vertical part of a viewing ray from which a height tells the depth error
_DOWNWARDS = np.array((0.0, 0.0, -1.0))


@dataclass(frozen=True)
class Percept:
    """One observation of an object, in the world frame."""

    stamp: float
    """s"""
    position: Array
    """(3,) m"""
    rotation: Quaternion
    position_covariance: Array
    """(3, 3) m^2, noise of this percept alone"""
    rotation_covariance: Array
    """(3, 3) rad^2"""
    ray: Array
    """(3,) unit vector from the camera to the object"""


def make_percept(pose: Pose, stamp: float, seen_from: Vector3 | None, config: BeliefConfig) -> Percept:
    """Percept of a world_from_object pose.

    Args:
        pose: its covariance (right perturbation, object frame) is turned into the world frame; without one,
            the defaults of `config` apply.
        stamp: s, when it was seen.
        seen_from: (3,) of the camera in the world, m; None means from right above.
        config: the noise that is added, and the defaults.

    Raises:
        ValueError: for a covariance that none is: with a negative variance in some direction.
    """
    position = np.array(pose.t)
    ray = _DOWNWARDS if seen_from is None else _unit(position - seen_from)
    if pose.cov is None:
        depth, lateral = config.default_depth_noise, config.default_lateral_noise
        noise = lateral**2 * _EYE + (depth**2 - lateral**2) * np.outer(ray, ray)
        turning = config.default_rotation_noise**2 * _EYE
    else:
        cov, turn = np.array(pose.cov).reshape(6, 6), np.array(quaternions.to_matrix(pose.q))
        if np.linalg.eigvalsh(cov)[0] < -_ROUNDING * np.trace(cov):
            raise ValueError(f"covariance with eigenvalues {np.linalg.eigvalsh(cov)}: expected none below 0")
        noise, turning = turn @ cov[:3, :3] @ turn.T, turn @ cov[3:, 3:] @ turn.T
    noise = noise + config.position_noise**2 * _EYE + config.depth_noise**2 * np.outer(ray, ray)
    return Percept(stamp, position, pose.q, noise, turning + config.rotation_noise**2 * _EYE, ray)


def _unit(vector: Array) -> Array:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0.0 else _DOWNWARDS


class Estimate:
    """Average of the percepts of an object at rest."""

    def __init__(self, percept: Percept, config: BeliefConfig) -> None:
        self.position = percept.position
        self.rotation = percept.rotation
        self.position_covariance = percept.position_covariance
        self.rotation_covariance = percept.rotation_covariance
        self.ray = percept.ray
        self.count = 1
        self._config = config

    def accepts(self, percept: Percept) -> bool:
        """Whether the percept may be of an object that has not moved: within the gate in place and rotation."""
        return self.agrees([self.innovation(percept)], percept)

    def agrees(self, innovations: Sequence[tuple[Array, Array]], percept: Percept) -> bool:
        """Whether the mean of some innovations is within the gate, each of them as noisy as `percept`."""
        shift, turn = np.mean(innovations, axis=0) if len(innovations) > 1 else innovations[0]
        limit, share = self._config.gate**2, 1.0 / len(innovations)
        position_covariance = self.position_covariance + share * percept.position_covariance
        rotation_covariance = self.rotation_covariance + share * percept.rotation_covariance
        return _mahalanobis2(shift, position_covariance) <= limit and _mahalanobis2(turn, rotation_covariance) <= limit

    def fuse(self, percept: Percept) -> None:
        """Take in a percept; with more than the window's, the older ones count less and less (Kalman update)."""
        self.count += 1
        keep = 1.0 if self.count <= self._config.window else 1.0 - 1.0 / self._config.window
        innovation, turn = self.innovation(percept)
        gain, self.position_covariance = _update(self.position_covariance / keep, percept.position_covariance)
        self.position = self.position + gain @ innovation
        gain, self.rotation_covariance = _update(self.rotation_covariance / keep, percept.rotation_covariance)
        x, y, z = (gain @ turn).tolist()
        step = quaternions.from_rotvec((x, y, z))
        self.rotation = quaternions.normalised(quaternions.product(step, self.rotation))
        self.ray = percept.ray

    def inherit(self, old: Estimate) -> None:
        """Keep the position of an older estimate if that has not changed, and likewise the rotation."""
        between = quaternions.product(self.rotation, quaternions.conjugate(old.rotation))
        turn = np.array(quaternions.to_rotvec(between))
        shift = self.position - old.position
        limit = self._config.gate**2
        if _mahalanobis2(shift, self.position_covariance + old.position_covariance) <= limit:
            self.position, self.position_covariance, self.count = old.position, old.position_covariance, old.count
        if _mahalanobis2(turn, self.rotation_covariance + old.rotation_covariance) <= limit:
            self.rotation, self.rotation_covariance = old.rotation, old.rotation_covariance

    def corrected(self, bias: float) -> Array:
        """(3,) m, the position without a systematic error of `bias` m along the viewing ray."""
        corrected: Array = self.position - bias * self.ray
        return corrected

    def bias_given(self, height: float) -> float | None:
        """Systematic error along the viewing ray, m, if the object is really at `height` (m).

        None where a height says little, for flat rays, or where more than the bias must be wrong.
        """
        slope = float(self.ray[2])
        if abs(slope) < _STEEP_RAY:
            return None
        bias = float(self.position[2] - height) / slope
        return bias if abs(bias) <= _MOST_SIGMAS * self._config.depth_bias else None

    def total_covariance(self, bias_std: float) -> Array:
        """(3, 3) m^2 of the position: what is left of the noise, and of the bias along the viewing ray."""
        total: Array = self.position_covariance + bias_std**2 * np.outer(self.ray, self.ray)
        return total

    def innovation(self, percept: Percept) -> tuple[Array, Array]:
        """From the estimate to the percept, in the world frame: shift (3,) m and rotation vector (3,) rad."""
        between = quaternions.product(percept.rotation, quaternions.conjugate(self.rotation))
        return percept.position - self.position, np.array(quaternions.to_rotvec(between))


def _mahalanobis2(difference: Array, covariance: Array) -> float:
    return float(difference @ np.linalg.solve(covariance, difference))


def _update(prior: Array, noise: Array) -> tuple[Array, Array]:
    """Kalman gain and posterior covariance of a direct measurement."""
    gain = prior @ np.linalg.inv(prior + noise)
    posterior = (_EYE - gain) @ prior
    return gain, 0.5 * (posterior + posterior.T)


class Track:
    """What perception says of one object over time."""

    def __init__(self, config: BeliefConfig, *, believed: bool = False) -> None:
        """Without percepts; `believed`: there is a belief already, which a single one does not replace."""
        self._config = config
        self._believed = believed
        self._pending: deque[Percept] = deque(maxlen=config.confirm_frames)
        self._recent: deque[Percept] = deque(maxlen=_RECENT)
        self._innovations: deque[tuple[Array, Array]] = deque(maxlen=_RECENT)
        self.estimate: Estimate | None = None
        """None until perception is sure enough."""
        self.last_stamp = -math.inf
        """s, of the newest percept."""
        self.moving = False
        """The newest percepts contradict each other: it is on its way."""
        self.changed = False
        """The estimate changed since `take_change`."""
        self.restarts = 0
        """How often the estimate was begun anew."""

    def add(self, percept: Percept) -> None:
        """Take in a percept; one that is not newer than the last is ignored."""
        if percept.stamp <= self.last_stamp:
            return
        self.last_stamp = percept.stamp
        if self.estimate is not None and self.estimate.accepts(percept):
            self._fuse(self.estimate, percept)
            return
        self._pending.append(percept)
        if len(self._pending) >= self._needed():
            self._restart(list(self._pending), self.estimate)

    def take_change(self) -> bool:
        """Whether the estimate changed since the last call."""
        changed, self.changed = self.changed, False
        return changed

    def forget(self) -> None:
        """Physics moved the object while it was unseen: the percepts so far say nothing any more."""
        self.estimate = None
        self._believed = True
        for percepts in (self._pending, self._recent, self._innovations):
            percepts.clear()

    def is_fresh(self, now: float) -> bool:
        """Whether it was seen lately."""
        return now - self.last_stamp <= self._config.perceived_max_age

    def _needed(self) -> int:
        """How many percepts in a row must disagree: one for what was never seen or may be on its way."""
        confirm_frames = self._config.confirm_frames
        if self.estimate is None:
            return confirm_frames if self._believed else 1
        return confirm_frames if self.estimate.count > confirm_frames + 1 else 1

    def _fuse(self, estimate: Estimate, percept: Percept) -> None:
        """Take in a percept that agrees; start anew if the recent ones together do not (a small move)."""
        self._recent.append(percept)
        self._innovations.append(estimate.innovation(percept))
        self._pending.clear()
        self.moving = False
        self.changed = True
        if len(self._recent) == _RECENT and not estimate.agrees(self._innovations, percept):
            self._restart(list(self._recent)[_RECENT // 2 :])  # the older half may be from before the move
        else:
            estimate.fuse(percept)

    def _restart(self, percepts: Sequence[Percept], old: Estimate | None = None) -> None:
        """Begin anew from these percepts if they agree, else from the newest; keep what still holds of `old`."""
        agreeing = _fused(percepts, self._config)
        self.moving = agreeing is None or len(percepts) < self._config.confirm_frames
        if agreeing is not None and old is not None:
            agreeing.inherit(old)
        self.estimate = agreeing or Estimate(percepts[-1], self._config)
        self._pending.clear()
        self._recent.clear()
        self._innovations.clear()
        self.changed = True
        self.restarts += 1


def _fused(percepts: Sequence[Percept], config: BeliefConfig) -> Estimate | None:
    """Their average, or None if they are not all of one pose."""
    estimate = Estimate(percepts[0], config)
    for percept in percepts[1:]:
        if not estimate.accepts(percept):
            return None
        estimate.fuse(percept)
    return estimate
