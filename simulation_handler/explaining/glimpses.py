"""The last glimpse of an object on its way: where it was, how it moved, and in which ways it may have gone on.

How a thing falls depends on so little that no glimpse can tell exactly: what matters are a few mm, and how fast it
was turning. A glimpse therefore stands for several beginnings, all of which may be simulated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.perception.scales import LIKELY_SIGMAS, LONGEST_GAP
from simulation_handler.perception.percepts import Array, WeighedPercept
from simulation_handler.shapes.geometry import Solid

DRAW_COUNT = 12
"""Number of ways in which an object may have gone on from where it was last seen: quantiles that are 8 % apart."""

_GROWTHS = (1.0, 2.0, 3.0)  # of the spin, over its mean since the glimpse before
# 1, standard normal; DRAW_COUNT times position, rotation and velocity; drawn once, with one seed for all runs
_DRAWS = np.random.default_rng(0).standard_normal((DRAW_COUNT, 9))
_DRAWS[: len(_GROWTHS)] = 0.0  # the first ones begin right where it was seen


class Motion(NamedTuple):
    """An object at one moment on its way."""

    solid: Solid
    velocity: Vector3
    """Velocity of the object's centre in the world, m/s."""
    spin: Vector3
    """Angular velocity of the object in the world, rad/s."""


@dataclass(frozen=True)
class Glimpse:
    """The last percept of an object that is not seen any more, and how it moved."""

    solid: Solid
    """The object where it was last seen, corrected by its known systematic error."""
    covariance: Array
    """(3, 3) m^2 of its position"""
    turning: Array
    """(3, 3) rad^2 of its rotation"""
    ray: Array
    """(3,) unit vector, away from the camera"""
    velocity: Array
    """(3,) m/s, the mean since the percept before; 0 if that was too long ago"""
    velocity_covariance: Array
    """Covariance (3, 3) of the velocity, m^2/s^2."""
    spin: Array
    """(3,) rad/s, angular velocity in the world."""

    def motion(self, draw: int) -> Motion:
        """How it may have moved when it was last seen; `draw` is from 0 to `DRAW_COUNT` - 1.

        What turned at a constant rate still has the mean `spin`; what began to turn after the percept before has
        more: twice that if its angle grew with the square of time, thrice with the cube, as of what tips over.
        """
        place, turn, speed = _DRAWS[draw % DRAW_COUNT].reshape(3, 3)
        rotation = quaternions.from_rotvec(_vector(_root(self.turning) @ turn))
        solid = self.solid.at(
            _vector(np.array(self.solid.position) + _root(self.covariance) @ place),
            quaternions.normalised(quaternions.product(rotation, self.solid.rotation)),
        )
        velocity = self.velocity + _root(self.velocity_covariance) @ speed
        return Motion(solid, _vector(velocity), _vector(_GROWTHS[draw % len(_GROWTHS)] * self.spin))


def glimpse_of(solid: Solid, trail: tuple[WeighedPercept, ...], bias: float, bias_std: float) -> Glimpse:
    """Estimate pose, velocity and spin of an object from its last percepts.

    Args:
        solid: the object, wherever it is.
        trail: its newest percepts, the last one at the end.
        bias: m along the viewing ray, the systematic error of its percepts.
        bias_std: m, what is not known of that.
    """
    last = trail[-1]
    lengthwise = np.outer(last.ray, last.ray)
    x, y, z = _vector(last.position - bias * last.ray)
    velocity, spin, noise = np.zeros(3), np.zeros(3), np.zeros((3, 3))
    if len(trail) > 1 and last.stamp - trail[-2].stamp <= LONGEST_GAP:
        seconds = last.stamp - trail[-2].stamp
        velocity = (last.position - trail[-2].position) / seconds
        noise = (last.position_covariance + trail[-2].position_covariance) / seconds**2
        along = float(last.ray @ velocity)
        if along**2 <= LIKELY_SIGMAS**2 * float(last.ray @ noise @ last.ray):
            velocity = velocity - along * last.ray
            across = np.eye(3) - lengthwise
            noise = across @ noise @ across
        turn = quaternions.product(last.rotation, quaternions.conjugate(trail[-2].rotation))
        spin = np.array(quaternions.to_rotvec(turn)) / seconds
    return Glimpse(
        solid=solid.at((x, y, z), last.rotation),
        covariance=last.position_covariance + bias_std**2 * lengthwise,
        turning=last.rotation_covariance,
        ray=last.ray,
        velocity=velocity,
        velocity_covariance=noise,
        spin=spin,
    )


def _root(covariance: Array) -> Array:
    """(3, 3) square root of a covariance, which may be singular."""
    variances, axes = np.linalg.eigh(covariance)
    root: Array = axes @ np.diag(np.sqrt(np.maximum(variances, 0.0)))
    return root


def _vector(array: Array) -> Vector3:
    x, y, z = array.tolist()
    return x, y, z
