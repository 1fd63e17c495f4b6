"""How far one percept is from the belief: across and along the viewing ray, and in rotation; how much noise may do."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from surprise.config import SurpriseConfig

Array = NDArray[np.float64]

_EYE = np.eye(3)
_NOTHING = math.sqrt(sys.float_info.epsilon)  # m or rad


class Offset(NamedTuple):
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


class Deviation(NamedTuple):
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
    return compare_all(percept, eye, (belief,), config, prior=prior)[0]


def compare_all(
    percept: Pose, eye: Vector3, beliefs: Sequence[Pose], config: SurpriseConfig, *, prior: Pose | None = None
) -> list[Deviation]:
    """Deviations of one percept from several beliefs, see `compare`; what the percept tells is worked out once."""
    seen = np.array(percept.t)
    ray = _unit(seen - np.array(eye))
    place, rotation = _percept_noise(percept, ray, config)
    along = float(ray @ place @ ray)
    along = max(along - config.depth_bias**2, float(np.trace(place) - along) / 2) + config.depth_noise**2
    deep = _std(along)
    of_prior = None if prior is None else _common(prior, ray, config)
    found = []
    for belief in beliefs:
        believed_place, believed_deep, believed_rotation = of_prior or _common(belief, ray, config)
        difference = seen - np.array(belief.t)
        depth = float(difference @ ray)
        turn = np.array(quaternions.to_rotvec(quaternions.product(percept.q, quaternions.conjugate(belief.q))))
        found.append(
            Deviation(
                _offset(difference - depth * ray, place, believed_place),
                Offset((depth, 0.0, 0.0), deep, believed_deep),
                _offset(turn, rotation, believed_rotation),
            )
        )
    return found


def _common(belief: Pose, ray: Array, config: SurpriseConfig) -> tuple[Array, float, Array]:
    """What percepts share: covariance (3, 3) of the place, m^2, deviation along the ray, m, and of the turn, rad^2."""
    place, rotation = _belief_noise(belief, config)
    return (
        place + config.position_noise**2 * _EYE,
        _std(float(ray @ place @ ray)),
        rotation + config.rotation_covariance(np.zeros((3, 3))),
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
