"""How far one percept is from the belief: across and along the viewing ray, and in rotation; how sure that is."""

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
class Deviation:
    """From where an object is believed to be to where it is perceived, in the world frame."""

    beside: Vector3
    """m, across the viewing ray"""
    beside_sigmas: float
    """Length of `beside` in standard deviations."""
    depth: float
    """m along the viewing ray, positive if it is perceived farther away; holds the sensor's systematic error"""
    depth_std: float
    """m, standard deviation of `depth` without the systematic error"""
    turn: Vector3
    """rad, rotation vector"""
    turn_sigmas: float
    """Length of `turn` in standard deviations."""

    def extent(self, config: SurpriseConfig) -> float:
        """Measure the deviation in units of the least extents that count: below 1 it does not count."""
        return max(
            math.hypot(*self.beside) / config.shift,
            abs(self.depth) / config.depth_bound,
            self.turning(config),
        )

    def turning(self, config: SurpriseConfig) -> float:
        """Measure the rotation in units of the least that counts."""
        x, y, z = self.turn
        return max(abs(z) / config.turn, math.hypot(x, y) / config.tilt)


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
        config: noise and limits.
        prior: the belief before the percept, whose covariance counts; None: `belief` is of before.
    """
    difference = np.subtract(percept.t, belief.t)
    ray = _unit(np.subtract(percept.t, eye))
    depth = float(difference @ ray)
    across = difference - depth * ray
    turn = np.array(quaternions.to_rotvec(quaternions.product(percept.q, quaternions.conjugate(belief.q))))
    place, rotation = _percept_noise(percept, ray, config)
    believed_place, believed_rotation = _belief_noise(belief if prior is None else prior, config)
    along = float(ray @ place @ ray)
    along = max(along - config.depth_bias**2, float(np.trace(place) - along) / 2)
    variance = along + config.depth_noise**2 + float(ray @ believed_place @ ray)
    return Deviation(
        _vector(across),
        _sigmas(across, place + believed_place),
        depth,
        math.sqrt(max(variance, _NOTHING**2)),
        _vector(turn),
        _sigmas(turn, rotation + believed_rotation),
    )


def _percept_noise(percept: Pose, ray: Array, config: SurpriseConfig) -> tuple[Array, Array]:
    """Covariances (3, 3) of its position (m^2) and rotation (rad^2) in the world frame."""
    if percept.cov is None:
        own, rotation = config.depth_bias**2 * np.outer(ray, ray), None
    else:
        own, rotation = percept.parent_covariances()
    return config.position_covariance(own), config.rotation_covariance(rotation)


def _belief_noise(belief: Pose, config: SurpriseConfig) -> tuple[Array, Array]:
    if belief.cov is None:
        return config.unseen_noise**2 * _EYE, config.unseen_rotation_noise**2 * _EYE
    return belief.parent_covariances()


def _sigmas(vector: Array, covariance: Array) -> float:
    """Length of a vector in standard deviations along it; a covariance that is none counts as no noise."""
    length = float(np.linalg.norm(vector))
    if length < _NOTHING:
        return 0.0
    direction = vector / length
    return length / max(math.sqrt(max(float(direction @ covariance @ direction), 0.0)), _NOTHING)


def _unit(vector: Array) -> Array:
    length = float(np.linalg.norm(vector))
    return vector / length if length > _NOTHING else np.array((0.0, 0.0, -1.0))


def _vector(array: Array) -> Vector3:
    x, y, z = array.tolist()
    return x, y, z
