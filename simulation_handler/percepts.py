"""What a camera says of an object at one moment, in the world frame, with how sure that is."""

from __future__ import annotations

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
