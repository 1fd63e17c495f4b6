"""Pose of a tag with its covariance: corners, depth and the tag's size, weighed together.

Four things tell where a tag is: its corners in the image, the plane of the depth within it, the side that it
should have, and how wrong each may be. Gauss-Newton steps from several starts find the most likely pose; its
covariance is the inverse of the Fisher information. Corners alone fit two poses where perspective is weak
(Schweighofer and Pinz 2006); depth decides.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from agents.scene_estimator.depth_plane import DepthPlane, fit_depth_plane
from agents.scene_estimator.detection import Tag, tag_corners
from dsr.math3d import quaternions
from dsr.math3d.batches import skew
from dsr.math3d.transforms import Array, Pose, exp, log
from dsr.vocabulary.intrinsics import Intrinsics

Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
_SIZE_RATIO = 1.5
"""Seen over true size of a tag; outside 1/1.5 to 1.5 the depth is that of something else."""
_WRONG_SIZE = 0.02
"""Probability that somebody told a wrong size; all sizes up to `_SIZE_RATIO` are alike then."""
_NO_SQUARE = 27.6
"""Sum of squares over their variances of what corners miss the best square by: exceeded by one in 1e6 (chi^2, 2)"""
_LONG_TAIL = 2.45
"""Standard deviations from which a corner weighs less (Huber 1964): 95 % of normal errors in two dimensions are less"""
_FINEST = 0.2
"""px, least standard deviation of a corner when outliers are told: errors of detectors have long tails"""
_CERTAIN = 50.0  # log odds
_STEPS = 20  # of Gauss-Newton; four or five do
_SETTLED = 1e-2  # standard deviations of the result, of the last step
_SAME = 0.1  # standard deviations, between starts that end at one pose
_ABOUT_NORMAL = skew(np.array([0.0, 0.0, 1.0]))


class NoiseModel(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A model of the sensor's errors."""

    corner_std: NotNegative = 0.15
    """px, of corners in sharp images of a real lens, beside the detector's own 0.1: together 0.18, as measured."""
    depth_bias_std: NotNegative = 0.01
    """m, systematic error of depth along the ray: not visible in the residuals, does not average out."""
    depth_ripple_std: NotNegative = 5e-4
    """m, systematic error of depth from one edge of a tag to the middle: by the brightness of what is printed there."""
    inverse_depth_floor: Positive = 3e-4
    """1/m, least standard deviation of a pixel's inverse depth."""
    inverse_depth_std: Positive = 2.5e-3
    """1/m, standard deviation of a pixel's inverse depth, by which a shape fits or not"""
    depth_correlation: NotNegative = 4.0
    """px, over which neighbouring depth errors are alike: stereo compares patches."""
    blur: NotNegative = 7.5e-4
    """s: a moving tag's edges are found inside by so much times their speed, and are as uncertain: part of exposure."""
    size_below: NotNegative = 0.5
    """m, distance beyond which depth alone tells the distance: its bias is common to all tags, wrong sizes are not."""
    size_std: Positive = 0.01
    """Standard deviation of a tag's side over the side that it should have: half a millimetre of a tag of 50 mm."""


class _Plane(NamedTuple):
    """What depth tells: p of a plane p . X = 1 in the camera frame."""

    p: Array
    """(3,) 1/m"""
    information: Array
    """(3, 3) inverse of its covariance, m^2"""


class TagFit(NamedTuple):
    """A most likely pose."""

    pose: Pose
    covariance: Array
    """(6, 6) of a right perturbation"""
    cost: float
    """Twice the negative logarithm of the likelihood, up to a constant"""
    missed: float
    """Sum of the squares over their variances by which the corners miss the pose"""

    def is_apart(self, other: TagFit) -> bool:
        """Whether it is another pose than the other one."""
        apart = log(self.pose.inverse() @ other.pose)
        return bool(apart @ np.linalg.solve(self.covariance, apart) > _SAME**2)


def estimate_tag_pose(
    tag: Tag, depth: NDArray[np.float32] | None, intrinsics: Intrinsics, tag_size: float, noise: NoiseModel
) -> Pose | None:
    """`camera_from_tag` (x right, y up as printed, z off the face) with covariance; None if it cannot be told.

    Where several poses are about as likely, it is the most likely one, with a covariance that spans them.

    Args:
        tag: its corners, px.
        depth: (h, w) m, of the same exposure and intrinsics; None without a depth camera.
        intrinsics: px, and the distortion of the lens.
        tag_size: side of the black square, m.
        noise: error model of the sensor.
    """
    return most_likely(possible_tag_poses(tag, depth, intrinsics, tag_size, noise))


def possible_tag_poses(
    tag: Tag, depth: NDArray[np.float32] | None, intrinsics: Intrinsics, tag_size: float, noise: NoiseModel
) -> list[TagFit]:
    """All poses that fit best among their neighbours, the most likely one first; arguments as above.

    There is none for corners that no square could have: part of the tag is hidden, or a motion blurred it.
    """
    rays = intrinsics.rays(tag.corners)
    if not np.isfinite(rays).all():
        return []
    plane = None if depth is None else _plane(tag, rays, depth, intrinsics, tag_size, noise)
    starts = [(start, 0.0) for start in _perspective_starts(rays, tag_size)]
    told, far = None, False
    if plane is not None:
        starts.append((_pose_on_plane(rays, plane, tag_size), math.log(_side(plane, rays) / tag_size)))
        told = _Plane(plane.p, np.asarray(np.linalg.inv(_plane_covariance(plane, rays, tag_size, noise)), np.float64))
        far = float(plane.points(rays)[:, 2].mean()) > noise.size_below
    problem = _TagProblem(tag, intrinsics, tag_size, None if far else noise.size_std, told)
    solved = (fit for start in starts if (fit := problem.solve(*start)) is not None)
    found: list[TagFit] = []
    for fit in sorted((fit for fit in solved if fit.missed < _NO_SQUARE), key=lambda fit: fit.cost):
        if all(fit.is_apart(other) for other in found):
            found.append(fit)
    return found


def most_likely(fits: list[TagFit]) -> Pose | None:
    """The best of several, with a covariance that spans the others as far as they are likely; None if there is none."""
    if not fits:
        return None
    best = min(fits, key=lambda fit: fit.cost)
    covariance = best.covariance.copy()
    for other in fits:
        if other is not best:
            doubt = 1.0 / (1.0 + math.exp(min(0.5 * (other.cost - best.cost), _CERTAIN)))
            apart = log(best.pose.inverse() @ other.pose)
            covariance += doubt * np.outer(apart, apart)
    return best.pose.with_covariance(covariance)


class _TagProblem:
    """Corners, depth and size of one tag as a least squares problem in the pose and the logarithm of the scale."""

    def __init__(
        self, tag: Tag, intrinsics: Intrinsics, tag_size: float, size_std: float | None, plane: _Plane | None
    ) -> None:
        self._tag, self._intrinsics, self._plane = tag, intrinsics, plane
        self._square = square = tag_corners(tag_size)
        self._size_std = size_std
        self._by_twist = np.concatenate([np.tile(np.eye(3), (4, 1, 1)), -skew(square), square[:, :, None]], axis=-1)
        """(4, 3, 7) derivative of the corners in the tag's frame by a twist and the scale, at a scale of 1"""

    def solve(self, pose: Pose, scale: float) -> TagFit | None:
        """The most likely pose near a start (and a logarithm of the scale); None if there is none before the camera."""
        for _ in range(_STEPS):
            linear = self._linear(pose, scale)
            if linear is None:
                return None
            information, gradient, cost, missed = linear
            try:
                covariance = np.linalg.inv(information)
            except np.linalg.LinAlgError:
                return None
            step = covariance @ gradient
            pose, scale = pose @ exp(step[:6]), scale + float(step[6])
            if gradient @ step < _SETTLED**2:
                break
        return TagFit(pose, np.asarray(covariance[:6, :6], np.float64), cost, missed)

    def _linear(self, pose: Pose, scale: float) -> tuple[Array, Array, float, float] | None:
        """Information (7, 7), gradient (7,), cost and what the corners miss, at a pose and a scale."""
        size, rotation = math.exp(scale), pose.rotation_matrix
        points = (size * self._square) @ rotation.T + pose.t
        if not (np.isfinite(points).all() and points[:, 2].min() > 0.0):
            return None
        pixels, by_point = self._intrinsics.project_with_derivative(points)
        by_twist = self._by_twist.copy()
        by_twist[:, :, 3:] *= size
        jacobian = (by_point @ (rotation @ by_twist)) / self._tag.corner_std
        residual = (self._tag.corners - pixels) / self._tag.corner_std
        if not np.isfinite(residual).all():
            return None
        off = np.sqrt((residual * residual).sum(axis=1))
        weights = np.minimum(1.0, _LONG_TAIL / np.maximum(off, 1e-12))
        information = np.einsum("n,nki,nkj->ij", weights, jacobian, jacobian)
        gradient = np.einsum("n,nki,nk->i", weights, jacobian, residual)
        cost = float(np.where(off < _LONG_TAIL, off**2, _LONG_TAIL * (2.0 * off - _LONG_TAIL)).sum())
        missed = cost * (self._tag.corner_std / max(self._tag.corner_std, _FINEST)) ** 2
        if self._plane is not None:
            p, by_pose = _plane_of(rotation, pose.translation)
            apart = self._plane.p - p
            weighted = by_pose.T @ self._plane.information
            information[:6, :6] += weighted @ by_pose
            gradient[:6] += weighted @ apart
            cost += float(apart @ self._plane.information @ apart)
        if self._size_std is not None:
            wrong = _WRONG_SIZE * self._size_std * math.sqrt(2.0 * math.pi) / (2.0 * math.log(_SIZE_RATIO))
            right = math.exp(-0.5 * (scale / self._size_std) ** 2)
            weight = right / (right + wrong) / self._size_std**2  # none if the size that was told is plainly wrong
            information[6, 6] += weight
            gradient[6] -= weight * scale
            cost -= 2.0 * math.log(right + wrong)
        return information, gradient, cost, missed


def _plane_of(rotation: Array, centre: Array) -> tuple[Array, Array]:
    """The p (3,) of a tag's plane p . X = 1, and its derivative (3, 6) by a right perturbation of the tag's pose."""
    normal = rotation[:, 2]
    distance = float(normal @ centre)
    turned = np.concatenate([np.zeros((3, 3)), -rotation @ _ABOUT_NORMAL], axis=1)
    moved = np.concatenate([normal @ rotation, np.zeros(3)]) + centre @ turned
    return normal / distance, turned / distance - np.outer(normal, moved) / distance**2


def _perspective_starts(rays: Array, tag_size: float) -> list[Pose]:
    """The two poses (one, or none) from which a square looks like that (IPPE, Collins and Bartoli 2014)."""
    try:
        _, rotations, translations, _ = cv2.solvePnPGeneric(
            tag_corners(tag_size), np.ascontiguousarray(rays[:, :2]), np.eye(3), None, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
    except cv2.error:
        return []
    found = zip(translations, rotations, strict=True)
    vectors = [(t.ravel(), r.ravel()) for t, r in found if np.isfinite(t).all() and np.isfinite(r).all()]
    return [Pose.from_rotvec(t, r) for t, r in vectors if t[2] > 0.0]


def _plane(
    tag: Tag, rays: Array, depth: NDArray[np.float32], intrinsics: Intrinsics, tag_size: float, noise: NoiseModel
) -> DepthPlane | None:
    """The tag's plane, unless the depth there contradicts the tag's size."""
    plane = fit_depth_plane(
        tag.corners,
        depth,
        intrinsics,
        noise_floor=noise.inverse_depth_floor,
        correlation=noise.depth_correlation,
    )
    if plane is None:
        return None
    return plane if 1.0 / _SIZE_RATIO < _side(plane, rays) / tag_size < _SIZE_RATIO else None


def _side(plane: DepthPlane, rays: Array) -> float:
    """m, mean side of what has its corners on rays (4, 3) in a plane."""
    points = plane.points(rays)
    return float(np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).mean())


def _plane_covariance(plane: DepthPlane, rays: Array, tag_size: float, noise: NoiseModel) -> Array:
    """(3, 3) of p, with the systematic errors of depth, for a tag whose corners are on rays (4, 3).

    A bias b of the depth z scales p by b / z: the tag moves along its ray. If b is the same for the whole tag, or
    grows with z^2 (a shift of disparity), the ends of a tilted tag move unequally: that adds or takes
    (p - e_z / z) b / z. A ripple tilts the plane about the middle of the tag, along x and y of the image.
    """
    centre = plane.points(rays).mean(axis=0)
    distance = float(centre[2])
    covariance = plane.covariance.copy()
    for direction in (plane.p, plane.p - (0.0, 0.0, 1.0 / distance)):
        covariance += (noise.depth_bias_std / distance) ** 2 * np.outer(direction, direction)
    slope = noise.depth_ripple_std / (0.5 * tag_size * distance)  # 1/m, of inverse depth over a unit of the ray
    for direction in (np.array([1.0, 0.0, -centre[0] / distance]), np.array([0.0, 1.0, -centre[1] / distance])):
        covariance += slope**2 * np.outer(direction, direction)
    return covariance


def _pose_on_plane(rays: Array, plane: DepthPlane, tag_size: float) -> Pose:
    """The pose that the plane and the corners' rays (4, 3) give: axes by Procrustes (Schonemann 1966)."""
    points = plane.points(rays)
    centre = points.mean(axis=0)
    offsets, square, normal = points - centre, tag_corners(tag_size), plane.normal
    x = square[:, 0] @ offsets + square[:, 1] @ np.cross(offsets, normal)
    x -= normal * (normal @ x)
    x /= np.linalg.norm(x)
    rotation = np.column_stack([x, np.cross(normal, x), normal])
    return Pose(centre, quaternions.from_matrix(rotation.tolist()))
