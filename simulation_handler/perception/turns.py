"""What percepts tell of turns: all of a turn, the turn about some axes only, or nothing.

A percept that tells nothing about an axis states a variance there that is no less than that of any rotation. What it
knows beyond that is its information: 1 / variance - 1 / `ANY_TURN`, and never less than none.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr.math3d import quaternions
from dsr.math3d.batches import exps, matrix_inverses
from dsr.math3d.quaternions import ANY_TURN, Quaternion, Vector3
from dsr.perception.consensus import SURE_OF_ROTATION

Array = NDArray[np.float64]


class ToldAxes(NamedTuple):
    """About which axes each of some percepts tells how an object is turned."""

    axes: Array
    """(n, 3, 3) unit vectors in the world, one in each column"""
    variances: Array
    """(n, 3) rad^2 about these, as stated, in ascending order"""

    @property
    def information(self) -> Array:
        """(n, 3) 1/rad^2 about the axes, beyond that of any rotation."""
        return np.asarray(np.maximum(1.0 / self.variances - 1.0 / ANY_TURN, 0.0))

    @property
    def told(self) -> NDArray[np.bool_]:
        """(n, 3) about which of them a turn is told."""
        return self.variances < ANY_TURN

    @property
    def known(self) -> Array:
        """(n, 3, 3) rad^2, world: covariances of what is known by each percept alone."""
        return self._about(np.minimum(self.variances, ANY_TURN))

    @property
    def noise(self) -> Array:
        """(n, 3, 3) rad^2, world: covariances as stated, none about axes about which nothing is told."""
        return self._about(np.where(self.told, self.variances, 0.0))

    def scaled(self, factor: float) -> Array:
        """(n, 3, 3) rad^2, world: as `known` if what is known beyond any rotation has `factor` times the variance."""
        return self._about(1.0 / (self.information / factor + 1.0 / ANY_TURN))

    def shown(self, turns: Array) -> Array:
        """The part that is told of turns (n, 3), rotation vectors in the world frame, rad.

        A turn is one about an axis after another one across that axis. About how many axes a percept tells turns says
        which of both counts.
        """
        counts, most, least = self.told.sum(axis=1), self.axes[:, :, 2], self.axes[:, :, 0]
        rows = zip(*(each.tolist() for each in (turns, counts, most, least)), strict=True)
        return np.array([_shown(*row) for row in rows])

    def _about(self, values: Array) -> Array:
        found: Array = (self.axes * values[:, None]) @ self.axes.mT
        return found


def are_told(covariances: Array) -> NDArray[np.bool_]:
    """(n,) whether percepts with covariances (n, 3, 3) of their rotations, rad^2, tell all of a turn."""
    return np.asarray(covariances.trace(axis1=1, axis2=2) < SURE_OF_ROTATION)


def tell_none(covariances: Array) -> NDArray[np.bool_]:
    """(n,) whether percepts with such covariances tell nothing of a turn, for sure: by Gershgorin's circles.

    Where they overlap by little, `told_axes` says the same.
    """
    variances = covariances.diagonal(axis1=1, axis2=2)
    radii = np.abs(covariances).sum(axis=2) - np.abs(variances)
    return np.asarray((variances - radii >= ANY_TURN).all(axis=1))


def told_axes(covariances: Array) -> ToldAxes:
    """About which axes percepts with covariances (n, 3, 3) of their rotations, rad^2, world, tell turns."""
    variances, axes = np.linalg.eigh(covariances)
    least = np.finfo(np.float64).eps * variances[:, 2:]  # so far eigenvalues are off by rounding
    return ToldAxes(axes, np.maximum(variances, least))


def updated(
    percepts: ToldAxes, before: Array, noise: Array, keep: Array, turns: Array
) -> tuple[Array, Array, Array]:
    """Kalman updates of rotations by percepts that do not tell all of a turn.

    Only what a percept tells makes older percepts count less (Cao and Schwartz, Automatica 2000). So nothing changes
    about axes about which it tells nothing. These are axes of the object: noise of its tilt moves them in the world. So
    they are taken as they are in the rotation before, and what is known turns with that.

    Args:
        percepts: about which axes they tell turns.
        before: (n, 3, 3) rad^2, covariances of the rotations before, against which percepts are weighed.
        noise: (n, 3, 3) rad^2, the true ones.
        keep: (n,) 1, how much the percepts before count from now on.
        turns: (n, 3) rad, rotation vectors to the percepts, as far as these tell them.

    Returns:
        Both covariances (n, 3, 3), rad^2, and by which rotation vectors (n, 3), rad, the rotations change.
    """
    told, axes = percepts.told, _turned(-turns) @ percepts.axes
    both = told[:, :, None] & told[:, None, :]
    known = np.where(both, axes.mT @ matrix_inverses(before) @ axes, np.eye(3))
    doubt = np.where(both, matrix_inverses(known), 0.0) * (1.0 / keep - 1.0)[:, None, None]
    prior = before + axes @ doubt @ axes.mT
    roots = axes * np.sqrt(percepts.information)[:, None]
    weighed = prior @ roots @ matrix_inverses(roots.mT @ prior @ roots + np.eye(3))
    gain = weighed @ roots.mT
    steps = (gain @ turns[..., None])[..., 0]
    turn, rest = _turned(steps), np.eye(3) - gain
    posterior = turn @ rest @ prior @ turn.mT
    left = turn @ (rest @ noise @ rest.mT + weighed @ weighed.mT) @ turn.mT
    return 0.5 * (posterior + posterior.mT), 0.5 * (left + left.mT), steps


def _turned(turns: Array) -> Array:
    """(n, 3, 3) rotation matrices of rotation vectors (n, 3), rad."""
    return exps(np.hstack([np.zeros_like(turns), turns]))[:, :3, :3]


def _shown(turn: Vector3, told: int, most: Vector3, least: Vector3) -> Vector3:
    """The part of a turn that a percept tells.

    Args:
        turn: rotation vector, rad.
        told: about how many axes the percept tells it.
        most: the axis about which it tells least, a unit vector.
        least: that about which it tells most.
    """
    if told == 0:
        return (0.0, 0.0, 0.0)
    if told == len(turn):
        return turn
    rotation = quaternions.from_rotvec(turn)
    about = _about(rotation, most if told > 1 else least)
    return quaternions.to_rotvec(about if told == 1 else quaternions.product(quaternions.conjugate(about), rotation))


def _about(rotation: Quaternion, axis: Vector3) -> Quaternion:
    """The part of a rotation about an axis, a unit vector: what is left is about an axis across that."""
    x, y, z, w = rotation
    along = x * axis[0] + y * axis[1] + z * axis[2]
    norm = math.hypot(along, w)
    if norm == 0.0:
        return (0.0, 0.0, 0.0, 1.0)
    share = along / norm
    return share * axis[0], share * axis[1], share * axis[2], w / norm
