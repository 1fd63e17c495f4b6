"""Least squares on SE(3) with covariances of percepts and beliefs and a robust loss, started from the closed form."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.calibrator.solve import closed_form
from agents.calibrator.solve.estimate import PoseEstimate, equation_1
from agents.calibrator.solve.problem import Problem, solved
from dsr.math3d import transforms
from dsr.math3d.transforms import Array

OUTLIER = 22.5
"""Squared Mahalanobis distance beyond which a sighting is an outlier: the 99.9 % quantile of its distribution"""

_ITERATIONS = 30
_HALVINGS = 8
_SMALL_STEP = 1e-7  # m or rad
_REJECTIONS = 3


def solve(problem: Problem, start: Array) -> PoseEstimate:
    """Gauss-Newton on the soft L1 loss of Mahalanobis distances, then again without outliers.

    It begins once with all sightings, and once with those that agree with the closed form, of which single gross errors
    say nothing; the pose with which more agree is the answer.
    """
    first = closed_form.solve(problem, start)
    everything, agreeing = np.ones(len(problem), dtype=bool), _agreeing(problem, first.pose)
    found = [_settled(problem, first.pose, everything)]
    if not agreeing.all():
        found.append(_settled(problem, first.pose, agreeing))
    if problem.prior is not None:  # of what the sightings leave open the closed form knows nothing
        found.append(_settled(problem, start, everything))
    best = min(found, key=lambda estimate: _rejecting(problem, estimate.pose))
    return PoseEstimate(best.pose, (*first.history, *best.history))


def _rejecting(problem: Problem, pose: Array) -> float:
    """Squared Mahalanobis distances of sightings and prior, of which an outlier counts no more than it must."""
    return float(np.minimum(problem.squared(pose), OUTLIER).sum()) + problem.squared_of_prior(pose)


def _settled(problem: Problem, pose: Array, kept: NDArray[np.bool_]) -> PoseEstimate:
    """The pose of least loss, first for the sightings `kept` (n,), then for those that agree with it."""
    history: list[float] = []
    for _ in range(_REJECTIONS):
        pose, further = _minimise(problem.subset(kept), pose, problem)
        history += further
        before, kept = kept, _agreeing(problem, pose)
        if (kept == before).all():
            break
    return PoseEstimate(pose, tuple(history))


def _agreeing(problem: Problem, pose: Array) -> NDArray[np.bool_]:
    """(n,) which sightings are no outliers; all, if there are only such."""
    agreeing = problem.squared(pose) < OUTLIER
    return agreeing if agreeing.any() else np.ones(len(problem), dtype=bool)


def _minimise(problem: Problem, pose: Array, whole: Problem) -> tuple[Array, list[float]]:
    """The pose of least loss near `pose`, and Equation 1 over the whole problem after each iteration."""
    history = []
    cost = _loss(problem, pose)
    for _ in range(_ITERATIONS):
        step = _step(problem, pose)
        for _ in range(_HALVINGS):
            tried = pose @ transforms.exp(step).matrix
            if (reached := _loss(problem, tried)) <= cost:
                break
            step = 0.5 * step
        else:
            break
        pose, cost = tried, reached
        history.append(equation_1(whole, pose))
        if np.abs(step).max() < _SMALL_STEP:
            break
    return pose, history


def _step(problem: Problem, pose: Array) -> Array:
    """(6,) twist by which Gauss-Newton with the weights of the loss moves the camera."""
    weights = 1.0 / np.sqrt(1.0 + problem.squared(pose) / closed_form.SCALE)
    information, gradient = problem.normal_equations(pose, weights)
    return -solved(information, gradient)


def _loss(problem: Problem, pose: Array) -> float:
    """Soft L1 of squared Mahalanobis distances, quadratic near 0 and linear in the distance far away, and the prior."""
    squared, scale = problem.squared(pose), closed_form.SCALE
    return float((2.0 * scale * (np.sqrt(1.0 + squared / scale) - 1.0)).sum()) + problem.squared_of_prior(pose)
