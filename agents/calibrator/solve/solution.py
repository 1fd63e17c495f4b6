"""The outcome of a calibration: the pose with its covariance, the residuals, and whether it can be adopted."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agents.calibrator.solve.estimate import PoseEstimate
from agents.calibrator.solve.problem import Problem, solved
from agents.calibrator.solve.robust import OUTLIER
from dsr.math3d.batches import inverses, logs, skew
from dsr.math3d.transforms import Array, Pose

ARM = 0.01
"""m, what an object's orientation counts for: as much as points that far from its centre, known as well as that"""
MOST = 2000.0
"""Condition number beyond which objects do not determine the pose of the camera (benchmarks/calibration_synthetic)."""


class ViewingGeometry(NamedTuple):
    """How well the arrangement of the objects determines the camera's pose."""

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


def geometry_of(problem: Problem) -> ViewingGeometry:
    """Compute the geometry of all sightings of a problem."""
    places = problem.seen[:, :3, 3]
    variances = np.diagonal(problem.covariances, axis1=1, axis2=2)
    arms = np.minimum(ARM, np.sqrt(3.0 * variances[:, :3].mean(axis=1) / variances[:, 3:].mean(axis=1)))
    ends = arms[:, None, None] * np.vstack([np.eye(3), -np.eye(3)])
    points = (places[:, None] + ends @ np.swapaxes(problem.seen[:, :3, :3], 1, 2)).reshape(-1, 3)
    eigenvalues = np.linalg.eigvalsh(_information(points))
    condition = float(eigenvalues[-1] / eigenvalues[0]) if eigenvalues[0] > 0.0 else math.inf
    return ViewingGeometry(condition, float(np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean())))


def _information(points: Array) -> Array:
    """(6, 6) about a twist of the camera, of points (n, 3) in its frame that are known equally well."""
    distance = np.sqrt((points**2).sum(axis=1).mean())
    derivatives = np.concatenate([np.tile(np.eye(3), (len(points), 1, 1)), -skew(points) / distance], axis=2)
    result: Array = np.einsum("nki,nkj->ij", derivatives, derivatives)
    return result


_UNFINISHED = 4.7  # standard deviations: the 99.9 % quantile of six numbers


class Residual(NamedTuple):
    """The distance of one object from its believed pose: root mean squares over its sightings."""

    name: str
    before: tuple[float, float]
    """m, rad, under the pose of the camera that was believed."""
    after: tuple[float, float]
    """m, rad, under the one that was found."""
    mahalanobis: float
    """Length of the residual after the calibration, in standard deviations; of 6 numbers, 2.4 is usual."""
    is_outlier: bool
    """Whether most of its sightings disagree with the pose that was found."""


class CalibrationSolution(NamedTuple):
    """The result of a method."""

    method: str
    before: Pose
    """parent_from_camera as it was believed"""
    pose: Pose
    """parent_from_camera that was found, static, with covariance.

    The covariance is that of sightings that agree, whose errors are taken as independent; greater by as much as these
    sightings scatter more than their own covariances say, and as the method stopped short of the best pose.
    """
    residuals: tuple[Residual, ...]
    """Residuals of the objects, in the order of names."""
    geometry: ViewingGeometry
    """Geometry of the sightings that agree."""
    sightings: int
    agreeing: int
    views: int
    unfinished: float
    """Standard deviations between the pose and the best one for the sightings that agree."""
    history: tuple[float, ...]
    """See `PoseEstimate.history`."""
    has_prior: bool = False
    """Whether a prior says what the sightings leave open; the covariance of the pose tells how well."""

    @property
    def outliers(self) -> tuple[str, ...]:
        """Names of objects that disagree with the pose."""
        return tuple(residual.name for residual in self.residuals if residual.is_outlier)

    @property
    def problem(self) -> str:
        """Why the pose should not be adopted; empty if it should."""
        names = [residual.name for residual in self.residuals]
        if 2 * self.agreeing <= self.sightings or 2 * len(self.outliers) >= len(names):
            return (
                f"no pose of the camera was found that explains what is seen: {self.agreeing} of {self.sightings} "
                f"sightings agree with the best, those of {', '.join(self.outliers) or 'some views'} do not"
            )
        if self.unfinished > _UNFINISHED:
            return (
                f"method {self.method} has not found the best pose: "
                f"it stopped {self.unfinished:.0f} standard deviations from there"
            )
        if self.geometry.is_weak and not self.has_prior:
            return (
                f"the geometry is weak: {len(names) - len(self.outliers)} object(s) within {self.geometry.span:.2f} m, "
                f"in {self.views} view(s), do not determine the pose (condition number {self.geometry.condition:.0f}); "
                "more objects further apart, or views from other arm poses, would"
            )
        return ""

    @property
    def is_adoptable(self) -> bool:
        """Whether most sightings agree with the pose, and determine it."""
        return not self.problem

    @property
    def is_shifted(self) -> bool:
        """Whether the pose is elsewhere than was believed by more than its error, and what is seen agrees better."""
        assert self.pose.covariance is not None
        twist = logs(inverses(self.before.matrix[None]) @ self.pose.matrix)[0]
        squared = float(twist @ np.linalg.solve(self.pose.covariance, twist))
        trusted = [one for one in self.residuals if not one.is_outlier]
        gain = sum(one.before[0] ** 2 - one.after[0] ** 2 for one in trusted)
        return squared > OUTLIER and gain > 0.0

    @property
    def confirms(self) -> bool:
        """Whether the pose deserves to be adopted, but is the one that was believed."""
        return self.is_adoptable and not self.is_shifted

    @property
    def shift(self) -> tuple[float, float]:
        """Displacement of the camera from its believed pose: m, rad."""
        return self.before.distance(self.pose)


def judged(method: str, problem: Problem, before: Pose, estimate: PoseEstimate) -> CalibrationSolution:
    """The outcome of a method, judged alike for all methods."""
    squared = problem.squared(estimate.pose)
    agreeing = squared < OUTLIER
    trusted = problem.subset(agreeing) if agreeing.any() else problem
    covariance, unfinished = _covariance(trusted, estimate.pose)
    return CalibrationSolution(
        method=method,
        before=before,
        pose=Pose.from_matrix(estimate.pose, covariance=covariance),
        residuals=_residuals(problem, before, estimate.pose, squared),
        geometry=geometry_of(trusted),
        sightings=len(problem),
        agreeing=int(agreeing.sum()),
        views=len({sighting.view for sighting in problem.sightings}),
        unfinished=unfinished,
        history=estimate.history,
        has_prior=problem.prior is not None,
    )


def _covariance(problem: Problem, pose: Array) -> tuple[Array, float]:
    """(6, 6) of a right perturbation of the camera pose (m, rad); and how many deviations the best pose is away."""
    information, gradient = problem.normal_equations(pose, np.ones(len(problem)))
    step = solved(information, gradient)
    freedom = 6 * len(problem) - (6 if problem.prior is None else 0)
    scatter = float(problem.squared(pose).sum()) / freedom if freedom > 0 else 1.0
    covariance: Array = max(1.0, scatter) * np.linalg.inv(information).astype(np.float64) + np.outer(step, step)
    return 0.5 * (covariance + covariance.T), math.sqrt(float(step @ information @ step))


def _residuals(problem: Problem, before: Pose, after: Array, squared: Array) -> tuple[Residual, ...]:
    distances = *problem.distances(before.matrix), *problem.distances(after)
    names = np.array([sighting.name for sighting in problem.sightings])
    residuals = []
    for name in sorted(set(names.tolist())):
        its = names == name
        m0, rad0, m1, rad1 = (math.sqrt((values[its] ** 2).mean()) for values in distances)
        outlier = bool(2 * (squared[its] >= OUTLIER).sum() >= its.sum())
        mahalanobis = math.sqrt(squared[its].mean())
        residuals.append(Residual(name, (m0, rad0), (m1, rad1), mahalanobis, outlier))
    return tuple(residuals)
