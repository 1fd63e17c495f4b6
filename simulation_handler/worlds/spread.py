"""How far an object may be from where a world has it: covariances by circumstance, of one pose or of many at once."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dsr.math3d.quaternions import to_matrix
from dsr.math3d.transforms import Pose
from simulation_handler.perception.turns import are_told, told_axes
from simulation_handler.worlds.parameters import PlaceNoise

Array = NDArray[np.float64]
_EYE = np.eye(3)
_UP = np.diag((0.0, 0.0, 1.0))
_SIDEWAYS = _EYE - _UP
_ENDLESS = np.array(math.inf)


def position_covariance(
    noise: PlaceNoise, own: Array, age: Array, moved: Array, velocity: Array, reach: Array = _ENDLESS
) -> Array:
    """Covariances (..., 3, 3) of positions in the world frame, m^2.

    Args:
        noise: of the circumstance.
        own: (..., 3, 3) m^2, as perception tells.
        age: (...) s since the object was recognised.
        moved: (...) m, how far the simulation has moved it since.
        velocity: (..., 3) m/s.
        reach: (...) m, how far what speaks against the place is away: `level` and `height` are at most as large.
    """
    drift = noise.growth**2 * age + (noise.path * moved) ** 2
    level, height = np.minimum(noise.level, reach), np.minimum(noise.height, reach)
    sideways = (level**2 + drift)[..., None, None] * _SIDEWAYS
    upwards = (height**2 + noise.upwards**2 * drift)[..., None, None] * _UP
    along = noise.lag**2 * velocity[..., :, None] * velocity[..., None, :]
    return np.asarray(noise.scale**2 * own + sideways + upwards + along)


def rotation_covariance(noise: PlaceNoise, own: Array, moved: Array) -> Array:
    """Covariances (..., 3, 3) of rotations in the world frame, rad^2; arguments as of `position_covariance`.

    The factor is on what perception tells: about axes about which it tells nothing, any turn is as probable as before.
    """
    more = noise.turn**2 + (noise.turning * moved) ** 2
    scaled, factor = noise.scale**2 * own, noise.scale**2
    told = own.reshape(-1, 3, 3)
    untold = ~are_told(told)
    if untold.any():
        scaled.reshape(-1, 3, 3)[untold] = told_axes(told[untold]).scaled(factor)
    return np.asarray(scaled + more[..., None, None] * _EYE)


def levels_of_wrong(noise: PlaceNoise) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Weights of the place with its own covariance, wide and wider, and factors on standard deviations.

    That something is wrong is as probable at each level, for what is wrong is wrong by any size: the tails are heavy.
    """
    wrong = noise.wrong
    return (1.0 - wrong, wrong * (1.0 - wrong), wrong**2), (1.0, noise.wide, noise.wide**2)


def percept_covariance(noise: PlaceNoise, own: Array, velocity: Array) -> Array:
    """Covariances (..., 3, 3) of perceived positions in the world frame, m^2; arguments as of `position_covariance`."""
    along = noise.lag**2 * velocity[..., :, None] * velocity[..., None, :]
    return np.asarray(noise.percept**2 * own + along)


def odds_of_percepts(noise: PlaceNoise, distance2: Array) -> Array:
    """(...) odds of being where percepts have an object against where the simulation has it.

    Likelihoods with heavy tails, as of Student's t, have such a ratio: the simulation errs at times by far more than
    its covariance tells.

    Args:
        noise: of the circumstance.
        distance2: (...) squared Mahalanobis distances between the two places.
    """
    return np.asarray(noise.perceived / (1.0 - noise.perceived) * (1.0 + distance2) ** noise.trust)


def squared_distance(offsets: Array, covariances: Array) -> Array:
    """(...) squared Mahalanobis distances of offsets (..., 3) with covariances (..., 3, 3)."""
    solved = np.linalg.solve(covariances, offsets[..., None])[..., 0]
    return np.asarray((offsets * solved).sum(axis=-1))


def with_spread(
    pose: Pose,
    noise: PlaceNoise,
    age: float,
    moved: float,
    velocity: Array,
    reach: float = math.inf,
) -> Pose:
    """The pose with the covariance of its circumstance; arguments as of `with_spreads`, of one pose."""
    told = np.array([age]), np.array([moved]), velocity[None], np.array([reach])
    return with_spreads([pose], noise, *told)[0]


def with_spreads(
    poses: Sequence[Pose],
    noise: PlaceNoise,
    age: Array,
    moved: Array,
    velocity: Array,
    reach: Array,
) -> list[Pose]:
    """The poses with the covariances of their circumstance; arguments as of `position_covariance`, (n, ...)."""
    places, turns = world_covariances(poses)
    places = position_covariance(noise, places, age, moved, velocity, reach)
    return all_with_world_covariances(poses, places, rotation_covariance(noise, turns, moved))


def with_world_covariances(pose: Pose, place: Array, turn: Array) -> Pose:
    """The pose with covariances (3, 3) of position (m^2) and rotation (rad^2) that are given in the world frame."""
    return all_with_world_covariances([pose], place[None], turn[None])[0]


def all_with_world_covariances(poses: Sequence[Pose], places: Array, turns: Array) -> list[Pose]:
    """The poses with covariances (n, 3, 3) of position (m^2) and rotation (rad^2) that are given in the world frame."""
    rotations = _rotations(poses)
    covariances = np.zeros((len(poses), 6, 6))
    covariances[:, :3, :3] = rotations.mT @ places @ rotations
    covariances[:, 3:, 3:] = rotations.mT @ turns @ rotations
    rows = (0.5 * (covariances + covariances.mT)).reshape(-1, 36).tolist()
    return [Pose.unchecked(pose.t, pose.q, pose.stamp, tuple(row)) for pose, row in zip(poses, rows, strict=True)]


def world_covariances(poses: Sequence[Pose]) -> tuple[Array, Array]:
    """Covariances (n, 3, 3) of positions (m^2) and rotations (rad^2) in the world frame; zero where none is told."""
    own = np.array([pose.cov or _UNKNOWN for pose in poses]).reshape(-1, 6, 6)
    rotations = _rotations(poses)
    return rotations @ own[:, :3, :3] @ rotations.mT, rotations @ own[:, 3:, 3:] @ rotations.mT


def _rotations(poses: Sequence[Pose]) -> Array:
    """(n, 3, 3)"""
    return np.array([to_matrix(pose.q) for pose in poses])


def all_scaled(poses: Sequence[Pose], factors: Sequence[float]) -> list[list[Pose]]:
    """The poses with all standard deviations times each of the factors, factor by factor."""
    covariances = np.array([pose.cov for pose in poses])
    return [
        list(poses) if factor == 1.0
        else [
            Pose.unchecked(pose.t, pose.q, pose.stamp, tuple(row))
            for pose, row in zip(poses, (factor**2 * covariances).tolist(), strict=True)
        ]
        for factor in factors
    ]  # fmt: skip


_UNKNOWN = tuple(np.zeros(36).tolist())
