"""Percepts of objects by cameras, each at one moment, in the world frame, with their covariances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr.math3d.quaternions import Quaternion, Vector3, to_matrix
from dsr.math3d.transforms import Pose
from dsr.perception.reach import FARTHEST
from simulation_handler.config import BeliefConfig
from simulation_handler.scales import DIAGONAL, ROUNDING

Array = NDArray[np.float64]

_DOWNWARDS = np.array((0.0, 0.0, -1.0))
_UNTOLD = np.full(3, np.nan)


class SeenObject(NamedTuple):
    """An object as a camera saw it."""

    name: str
    """Of the object"""
    pose: Pose
    """world_from_object, with covariance (right perturbation, object frame) if there is one"""
    stamp: float
    """s, when it was seen"""
    seen_from: Vector3 | None = None
    """(3,) of the camera in the world, m; None means from right above"""
    camera: str = ""
    """Its name"""


class Covariances:
    """What is left of noise, of a position and of a rotation."""

    covariances: Array
    """(2, 3, 3) of the position, m^2, and of the rotation, rad^2"""

    @property
    def position_covariance(self) -> Array:
        """(3, 3) m^2"""
        covariance: Array = self.covariances[0]
        return covariance

    @property
    def rotation_covariance(self) -> Array:
        """(3, 3) rad^2"""
        covariance: Array = self.covariances[1]
        return covariance


@dataclass(frozen=True)
class WeighedPercept(Covariances):
    """One observation of an object, in the world frame."""

    stamp: float
    """Time of the exposure, s."""
    position: Array
    """Position (3,) of the object's centre in the world, m."""
    rotation: Quaternion
    covariances: Array
    """(2, 3, 3) of this percept alone: of the position, m^2, and of the rotation, rad^2"""
    ray: Array
    """(3,) unit vector, the direction away from the camera in which the systematic error is"""


def flaws(sights: Sequence[SeenObject]) -> list[str]:
    """Why each cannot be used: its covariance has a negative variance in some direction, or a place beyond all rooms.

    Empty for those that can.
    """
    found, told = [""] * len(sights), _told(sights)
    if told:
        covariances = _told_covariances(sights, told)
        farthest = covariances.diagonal(axis1=1, axis2=2)[:, :3].max(axis=1)
        for place in np.flatnonzero(farthest > FARTHEST**2).tolist():
            found[told[place]] = f"variance of {farthest[place]:.3g} m^2: expected at most {FARTHEST**2:g}"
        least, traces = np.linalg.eigvalsh(covariances)[:, 0], covariances.trace(axis1=1, axis2=2)
        for place in np.flatnonzero(least < -ROUNDING * traces).tolist():
            found[told[place]] = f"covariance with eigenvalue {least[place]}: expected none below 0"
    return found


def _told(sights: Sequence[SeenObject]) -> list[int]:
    """The indexes of those with a covariance."""
    return [place for place, sight in enumerate(sights) if sight.pose.cov is not None]


def _told_covariances(sights: Sequence[SeenObject], told: Sequence[int]) -> Array:
    """(n, 6, 6) of those"""
    return np.array([sights[place].pose.cov for place in told], dtype=np.float64).reshape(-1, 6, 6)


def weighed(sights: Sequence[SeenObject], config: BeliefConfig) -> list[WeighedPercept]:
    """Percepts of sights without `flaws`, all worked out at once.

    Covariances are turned into the world frame. A position without one is as noisy as what `config` adds.
    """
    if not sights:
        return []
    positions = np.array([sight.pose.t for sight in sights])
    rays = _rays(positions, sights)
    covariances = np.zeros((len(sights), 2, 3, 3))
    covariances[:, 0] = config.position_covariance(covariances[:, 0], rays)
    if told := _told(sights):
        own = _told_covariances(sights, told)
        turns = np.array([to_matrix(sights[place].pose.q) for place in told])[:, None]
        covariances[told] = turns @ np.stack([own[:, :3, :3], own[:, 3:, 3:]], axis=1) @ turns.mT
        covariances[told, 0], rays[told] = _without_bias(covariances[told, 0], rays[told], config.depth_bias)
    covariances[:, 0] = config.position_covariance(covariances[:, 0], rays)
    covariances[:, 1] = config.rotation_covariance(covariances[:, 1])
    return [
        WeighedPercept(sight.stamp, position.copy(), sight.pose.q, covariance.copy(), ray.copy())
        for sight, position, covariance, ray in zip(sights, positions, covariances, rays, strict=True)
    ]


def _rays(positions: Array, sights: Sequence[SeenObject]) -> Array:
    """(n, 3) unit vectors from the cameras to positions (n, 3)."""
    eyes = np.array([_UNTOLD if sight.seen_from is None else sight.seen_from for sight in sights])
    ways = positions - eyes
    lengths = np.linalg.norm(ways, axis=1, keepdims=True)
    is_told = lengths > 0.0
    return np.where(is_told, ways / np.where(is_told, lengths, 1.0), _DOWNWARDS)


def _without_bias(covariances: Array, rays: Array, bias: float) -> tuple[Array, Array]:
    """The part of positions' covariances (n, 3, 3) that changes from frame to frame, and directions (n, 3) of the rest.

    A sensor that knows of its systematic depth error (`bias`, m) reports a covariance that is long along the
    viewing ray; that part must neither be averaged away nor widen the gate for changes. An axis that is longer by the
    bias, and nearer to the viewing ray than to what is across, is the direction of the bias.
    """
    variances, axes = np.linalg.eigh(covariances)
    longest = axes[:, :, 2]
    along = (longest * rays).sum(axis=1)
    is_bias = (variances[:, 2] > variances[:, 1] + bias**2) & (np.abs(along) > DIAGONAL)
    is_long = variances[:, 2] > bias**2
    variances[:, 2] = np.maximum(variances[:, 2] - bias**2, variances[:, 1])
    shorter = (axes * variances[:, None]) @ axes.mT
    turned = longest * np.copysign(1.0, along)[:, None]
    return np.where(is_long[:, None, None], shorter, covariances), np.where(is_bias[:, None], turned, rays)
