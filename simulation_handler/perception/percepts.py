"""A percept of an object by a camera at one moment, in the world frame, with its covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.math3d.transforms import Pose
from simulation_handler.config import BeliefConfig
from simulation_handler.scales import DIAGONAL, ROUNDING

Array = NDArray[np.float64]

_DOWNWARDS = np.array((0.0, 0.0, -1.0))


@dataclass(frozen=True)
class WeighedPercept:
    """One observation of an object, in the world frame."""

    stamp: float
    """Time of the exposure, s."""
    position: Array
    """Position (3,) of the object's centre in the world, m."""
    rotation: Quaternion
    position_covariance: Array
    """(3, 3) m^2, noise of this percept alone"""
    rotation_covariance: Array
    """Covariance (3, 3) of the rotation, rad^2."""
    ray: Array
    """(3,) unit vector, the direction away from the camera in which the systematic error is"""


def make_percept(pose: Pose, stamp: float, seen_from: Vector3 | None, config: BeliefConfig) -> WeighedPercept:
    """Percept of a world_from_object pose.

    Args:
        pose: its covariance (right perturbation, object frame) is turned into the world frame; without one,
            it is as noisy as what `config` adds.
        stamp: s, when it was seen.
        seen_from: (3,) of the camera in the world, m; None means from right above.
        config: the noise that is added.

    Raises:
        ValueError: for a covariance that none is: with a negative variance in some direction.
    """
    position = np.array(pose.t)
    ray = _DOWNWARDS if seen_from is None else _unit(position - seen_from)
    if pose.cov is None:
        noise, turning = config.position_covariance(np.zeros((3, 3)), ray), None
    else:
        _check_covariance(pose)
        noise, turning = pose.parent_covariances()
        noise, ray = _without_bias(noise, ray, config.depth_bias)
    noise, turning = config.position_covariance(noise, ray), config.rotation_covariance(turning)
    return WeighedPercept(stamp, position, pose.q, noise, turning, ray)


def _check_covariance(pose: Pose) -> None:
    """Raise ValueError for a covariance with a negative variance in some direction."""
    covariance = np.array(pose.cov).reshape(6, 6)
    least = np.linalg.eigvalsh(covariance)[0]
    if least < -ROUNDING * np.trace(covariance):
        raise ValueError(f"covariance with eigenvalue {least}: expected none below 0")


def _without_bias(covariance: Array, ray: Array, bias: float) -> tuple[Array, Array]:
    """The part of a position's covariance that changes from frame to frame, and the direction of the rest.

    A sensor that knows of its systematic depth error (`bias`, m) reports a covariance that is long along the
    viewing ray; that part must neither be averaged away nor widen the gate for changes. An axis that is longer by the
    bias, and nearer to the viewing ray than to what is across, is the direction of the bias.
    """
    variances, axes = np.linalg.eigh(covariance)
    along = float(axes[:, 2] @ ray)
    if variances[2] > variances[1] + bias**2 and abs(along) > DIAGONAL:
        ray = axes[:, 2] * math.copysign(1.0, along)
    if variances[2] > bias**2:
        variances[2] = max(variances[2] - bias**2, variances[1])
        covariance = axes @ np.diag(variances) @ axes.T
    return covariance, ray


def _unit(vector: Array) -> Array:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0.0 else _DOWNWARDS
