"""Does where the objects are determine the pose of the camera? By the condition number of the information they give."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agents.calibrator import se3
from agents.calibrator.problem import Problem
from dsr.math3d.transforms import Array

ARM = 0.01
"""m, what an object's orientation counts for: as much as points that far from its centre, known as well as that"""
MOST = 2000.0
"""Condition number beyond which objects do not determine the pose of the camera (benchmarks/calibration_synthetic)."""


class Geometry(NamedTuple):
    """What the arrangement of the objects is worth, seen from the camera."""

    condition: float
    """Greatest over least eigenvalue of the information about the camera's pose; infinite if one is 0.

    Each object counts alike, as points `ARM` around its centre. A turn is measured by how far it moves objects at the
    mean distance.
    """
    span: float
    """m, root mean square of the distances of the positions from their mean, in the frame of the camera"""

    @property
    def is_weak(self) -> bool:
        """Whether a small error of the percepts can be a large one of the pose."""
        return self.condition > MOST


def geometry_of(problem: Problem) -> Geometry:
    """Of all sightings of a problem."""
    places = problem.seen[:, :3, 3]
    variances = np.diagonal(problem.covariances, axis1=1, axis2=2)
    arms = np.minimum(ARM, np.sqrt(3.0 * variances[:, :3].mean(axis=1) / variances[:, 3:].mean(axis=1)))
    ends = arms[:, None, None] * np.vstack([np.eye(3), -np.eye(3)])
    points = (places[:, None] + ends @ np.swapaxes(problem.seen[:, :3, :3], 1, 2)).reshape(-1, 3)
    eigenvalues = np.linalg.eigvalsh(_information(points))
    condition = float(eigenvalues[-1] / eigenvalues[0]) if eigenvalues[0] > 0.0 else math.inf
    return Geometry(condition, float(np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean())))


def _information(points: Array) -> Array:
    """(6, 6) about a twist of the camera, of points (n, 3) in its frame that are known equally well."""
    distance = np.sqrt((points**2).sum(axis=1).mean())
    derivatives = np.concatenate([np.tile(np.eye(3), (len(points), 1, 1)), -se3.skews(points) / distance], axis=2)
    result: Array = np.einsum("nki,nkj->ij", derivatives, derivatives)
    return result
