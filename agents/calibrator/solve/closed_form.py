"""Absolute orientation in closed form (Kabsch 1976) on virtual points of the objects, reweighted against outliers.

Each object counts as seven points: its centre, and both ends of an arm along each axis. The arm's length is what makes
position and orientation weigh as their covariances say, so that an object whose orientation nobody measured has none.
"""

from __future__ import annotations

import numpy as np

from agents.calibrator.solve.estimate import PoseEstimate, equation_1
from agents.calibrator.solve.problem import Problem
from dsr.math3d.batches import rigid_fit
from dsr.math3d.transforms import Array

SCALE = 12.6
"""Squared Mahalanobis distance from which on a sighting counts less: the 95 % quantile of its distribution"""

_ARMS = np.vstack([np.zeros((1, 3)), np.eye(3), -np.eye(3)])  # (7, 3)
_ITERATIONS = 12
_MOST_CANDIDATES = 24
_CONVERGED = 1e-6


def solve(problem: Problem, start: Array) -> PoseEstimate:
    """The weighted closed form, from the best single sighting on; the present pose is one more candidate."""
    points = _Points(problem)
    pose = _beginning(problem, start)
    history = [equation_1(problem, start), equation_1(problem, pose)]
    for _ in range(_ITERATIONS):
        before, pose = pose, points.fit(1.0 / (1.0 + problem.squared(pose) / SCALE))
        history.append(equation_1(problem, pose))
        if np.abs(pose - before).max() < _CONVERGED:
            break
    return PoseEstimate(pose, tuple(history))


def _beginning(problem: Problem, start: Array) -> Array:
    """The candidate that most sightings agree with: least sum of log(1 + d^2 / scale)."""
    every = -(-len(problem) // _MOST_CANDIDATES)
    candidates: list[Array] = [start, *problem.candidates()[::every]]
    costs = [np.log1p(problem.squared(candidate) / SCALE).sum() for candidate in candidates]
    return candidates[int(np.argmin(costs))]


class _Points:
    """The virtual points of all sightings, as seen and as believed, with what each weighs."""

    def __init__(self, problem: Problem) -> None:
        diagonals = np.diagonal(problem.covariances, axis1=1, axis2=2)
        position, turn = diagonals[:, :3].mean(axis=1), diagonals[:, 3:].mean(axis=1)  # m^2, rad^2
        arms = np.sqrt(3.0 * position / turn)[:, None, None] * _ARMS  # (n, 7, 3)
        self._seen = _placed(problem.seen, arms)
        self._believed = _placed(problem.believed, arms)
        # the six ends give half of what is known of the position, the centre the rest; of turns, 4 l^2 / 12 of that
        self._weights = np.array([0.5, *[1.0 / 12.0] * 6]) / position[:, None]

    def fit(self, weights: Array) -> Array:
        """(4, 4) camera pose that maps seen onto believed points best, each sighting weighted by `weights` (n,)."""
        by_point = (weights[:, None] * self._weights).ravel()
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rigid_fit(self._seen.reshape(-1, 3), self._believed.reshape(-1, 3), by_point)
        return pose


def _placed(poses: Array, points: Array) -> Array:
    """Points (n, 7, 3) in the frames of objects, moved to where these are."""
    result: Array = np.einsum("nij,nkj->nki", poses[:, :3, :3], points) + poses[:, None, :3, 3]
    return result
