"""How far one percept is from the belief: across and along the viewing ray, and in rotation; how much noise may do."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from surprise.config import SurpriseConfig

Array = NDArray[np.float64]

_EYE = np.eye(3)
_NOTHING = math.sqrt(sys.float_info.epsilon)  # m or rad


@dataclass(frozen=True)
class Offset:
    """From where an object is believed to be to where it is perceived, in one way."""

    vector: Vector3
    """m, or rad as a rotation vector, in the world frame"""
    noise: float
    """m or rad along `vector`, standard deviation of what differs from percept to percept"""
    common: float
    """m or rad along `vector`, standard deviation of what percepts share: errors of the belief, and systematic ones"""

    @property
    def length(self) -> float:
        """M or rad."""
        return math.hypot(*self.vector)


@dataclass(frozen=True)
class Deviation:
    """From where an object is believed to be to where it is perceived."""

    beside: Offset
    """m, across the viewing ray"""
    depth: Offset
    """m along the viewing ray as (depth, 0, 0), positive if it is perceived farther away.

    The systematic error of the sensor is in it; `common` is without that.
    """
    turn: Offset
    """rad"""


def compare(
    percept: Pose, eye: Vector3, belief: Pose, config: SurpriseConfig, *, prior: Pose | None = None
) -> Deviation:
    """Deviation of a percept from a belief (both world_from_object), seen from `eye` (m, world frame).

    Covariances are right perturbations in the object's frame; those of percept and belief add up, as the one is not
    made of this percept. Standard deviations are those along the deviation itself, which needs no inverse.

    Args:
        percept: with covariance, if it is known.
        eye: of the camera.
        belief: where the object is believed to be.
        config: noise.
        prior: the belief before the percept, whose covariance counts; None: `belief` is of before.
    """
    difference = np.subtract(percept.t, belief.t)
    ray = _unit(np.subtract(percept.t, eye))
    depth = float(difference @ ray)
    turn = np.array(quaternions.to_rotvec(quaternions.product(percept.q, quaternions.conjugate(belief.q))))
    place, rotation = _percept_noise(percept, ray, config)
    believed_place, believed_rotation = _belief_noise(belief if prior is None else prior, config)
    along = float(ray @ place @ ray)
    along = max(along - config.depth_bias**2, float(np.trace(place) - along) / 2) + config.depth_noise**2
    return Deviation(
        _offset(difference - depth * ray, place, believed_place + config.position_noise**2 * _EYE),
        Offset((depth, 0.0, 0.0), _std(along), _std(float(ray @ believed_place @ ray))),
        _offset(turn, rotation, believed_rotation + config.rotation_covariance(np.zeros((3, 3)))),
    )


def _percept_noise(percept: Pose, ray: Array, config: SurpriseConfig) -> tuple[Array, Array]:
    """Covariances (3, 3) of its position (m^2) and rotation (rad^2) in the world frame, by the percept itself."""
    if percept.cov is None:
        return config.depth_bias**2 * np.outer(ray, ray), np.zeros((3, 3))
    return percept.parent_covariances()


def _belief_noise(belief: Pose, config: SurpriseConfig) -> tuple[Array, Array]:
    if belief.cov is None:
        return config.unseen_noise**2 * _EYE, config.unseen_rotation_noise**2 * _EYE
    return belief.parent_covariances()


def _offset(vector: Array, noise: Array, common: Array) -> Offset:
    """An offset with the standard deviations along it; a covariance that is none counts as no noise."""
    direction = _unit(vector)
    x, y, z = vector.tolist()
    return Offset((x, y, z), _std(float(direction @ noise @ direction)), _std(float(direction @ common @ direction)))


def _std(variance: float) -> float:
    return max(math.sqrt(max(variance, 0.0)), _NOTHING)


def _unit(vector: Array) -> Array:
    length = float(np.linalg.norm(vector))
    return vector / length if length > _NOTHING else np.array((0.0, 0.0, -1.0))
