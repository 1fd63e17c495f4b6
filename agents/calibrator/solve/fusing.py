"""Many percepts of one object that stands still before a camera that stands still: one pose."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from agents.calibrator.solve.robust import OUTLIER
from dsr.math3d import batches, transforms
from dsr.math3d.transforms import Array, Pose

MOST_INDEPENDENT = 4
"""Percepts from one place share errors: of the tag, the lens and the surface. No more of them than this count.

Rotations do not average out at all: depth images tilt all tags alike, and always so.
"""
CORNERS = 0.006
"""rad about the viewing ray, by which all percepts of a tag from one place are turned: its corners are seen askew"""
_ENOUGH = 8  # percepts whose scatter tells how large the noise of depth is
_DOUBT = 2.0  # that variance may be so much larger, for there are few of them
_LONG = 2.0  # ratio of standard deviations from which the longest axis may be taken for the viewing ray
_ALIGNED = 0.95  # cosine of the angle between the two up to which it is
_LEAST_SHARE = 0.001
"""What stays of a variance along the viewing ray at least, when the systematic part is taken out"""


def fuse(percepts: Sequence[Pose], depth_bias: float, depth_scatter: float) -> Pose:
    """camera_from_object, with covariance, of percepts (camera_from_object, with covariance) of one view.

    The mean of those that agree with the one most others agree with: single flipped percepts have no influence. Of the
    systematic error of depth, `depth_bias` (m, in the percepts' covariances), `depth_scatter` (m) remains, see
    `CalibratorConfig`; it does not average out. Noise of depth beyond what the percepts show is taken for such, too.
    """
    middle, agreeing = _agreeing(percepts)
    mean = agreeing.mean(axis=0)
    counted = min(len(agreeing), MOST_INDEPENDENT)
    pose = Pose.from_matrix(percepts[middle].matrix @ transforms.exp(mean).matrix)
    ray = pose.rotation_matrix.T @ pose.translation
    ray = ray / max(float(np.linalg.norm(ray)), 1e-9)
    excess = _excess(percepts[middle], agreeing, ray, depth_bias)
    each = np.repeat([1.0 / math.sqrt(counted), 1.0], 3)
    covariance = _without(percepts[middle].covariance, ray, excess) * np.outer(each, each)
    covariance[:3, :3] += depth_scatter**2 * np.outer(ray, ray)
    covariance[3:, 3:] += CORNERS**2 * np.outer(ray, ray)
    return pose.with_covariance(covariance)


def _agreeing(percepts: Sequence[Pose]) -> tuple[int, Array]:
    """The index of the percept with most agreement, and the twists (k, 6) from it to those that agree with it."""
    matrices = np.array([percept.matrix for percept in percepts])
    information = np.linalg.inv(np.array([_regular(percept.covariance) for percept in percepts]))
    pairs = batches.inverses(matrices)[:, None] @ matrices
    between = batches.logs(pairs.reshape(-1, 4, 4)).reshape(len(percepts), len(percepts), 6)
    squared = np.einsum("mni,mij,mnj->mn", between, 0.5 * information, between)
    middle = int(np.argmin(np.minimum(squared, OUTLIER).sum(axis=1)))
    return middle, between[middle][squared[middle] < OUTLIER]


def _excess(percept: Pose, agreeing: Array, ray: Array, bias: float) -> float:
    """M, standard deviation along the ray that the covariance of a percept has, and those that agree do not show."""
    if len(agreeing) < _ENOUGH:
        return bias
    told = float(ray @ _regular(percept.covariance)[:3, :3] @ ray)
    shown = _DOUBT * float(np.var(agreeing[:, :3] @ ray, ddof=1))
    return math.sqrt(max(bias**2, told - shown)) if bias > 0.0 else 0.0


def _without(covariance: Array | None, ray: Array, bias: float) -> Array:
    """The covariance less `bias` (m) along the unit vector `ray` (3,), as far as it has that.

    What is measured is a tag, beside the centre: the bias is along the longest axis, where that is close to the ray.
    """
    reduced = _regular(covariance)
    variances, axes = np.linalg.eigh(reduced[:3, :3])
    is_long = variances[2] > _LONG**2 * variances[1] and abs(float(axes[:, 2] @ ray)) > _ALIGNED
    direction = np.concatenate([axes[:, 2] if is_long else ray, np.zeros(3)])
    most = 1.0 / float(direction @ np.linalg.solve(reduced, direction))  # with more it would not be positive any more
    reduced -= min(bias**2, (1.0 - _LEAST_SHARE) * most) * np.outer(direction, direction)
    return reduced


def _regular(covariance: Array | None) -> Array:
    """A covariance that can be inverted."""
    assert covariance is not None
    return covariance + np.diag([1e-10] * 3 + [1e-8] * 3)
