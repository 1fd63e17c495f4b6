"""Pose of a tag with its covariance: depth gives the plane it lies in, the corners place it there.

The corners' rays are cut with the plane fitted to the depth within the tag. Near the camera the tag's known
size tells its distance better than depth does; further away it is the other way round. The orientation is
that of the plane at all distances: flips cannot occur, and the error is a fraction of that of perspective.
Without depth, perspective is all there is.
"""

from __future__ import annotations

import math
from typing import Annotated

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from agents.scene_estimator.depth_plane import DepthPlane, fit_depth_plane
from agents.scene_estimator.detection import Tag, tag_corners
from dsr.math3d import quaternions
from dsr.math3d.batches import skew
from dsr.math3d.transforms import Array, Pose, log
from dsr.vocabulary.intrinsics import Intrinsics

_CERTAIN = 50.0  # log odds


def pose_from_perspective(tag: Tag, intrinsics: Intrinsics, tag_size: float) -> Pose | None:
    """`camera_from_tag` with covariance, or None if the corners are no projection of a square.

    Of the two poses it is the more likely one, with a covariance that spans both as far as both are likely.
    """
    candidates = _candidates(tag, intrinsics, tag_size)
    if not candidates:
        return None
    costs = [_cost(pose, tag, intrinsics, tag_size) for pose in candidates]
    best, other = (candidates[i] for i in np.argsort(costs)[[0, -1]])
    doubt = 1.0 / (1.0 + math.exp(min(0.5 * (max(costs) - min(costs)), _CERTAIN)))
    apart = log(best.inverse() @ other)
    try:
        covariance = _covariance(best, tag, intrinsics, tag_size)
        uncertain: Pose = best.with_covariance(covariance + doubt * np.outer(apart, apart))
    except (np.linalg.LinAlgError, ValueError):  # corners in one place, or on a line
        return None
    return uncertain


def _candidates(tag: Tag, intrinsics: Intrinsics, tag_size: float) -> list[Pose]:
    try:
        _, rotations, translations, _ = cv2.solvePnPGeneric(
            tag_corners(tag_size), tag.corners, intrinsics.matrix, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
    except cv2.error:
        return []
    found = zip(translations, rotations, strict=True)
    vectors = [(t.ravel(), r.ravel()) for t, r in found if np.isfinite(t).all() and np.isfinite(r).all()]
    return [Pose.from_rotvec(t, r) for t, r in vectors if t[2] > 0.0]


def _cost(pose: Pose, tag: Tag, intrinsics: Intrinsics, tag_size: float) -> float:
    """Squared normalised reprojection error."""
    reprojected = intrinsics.project(pose.apply(tag_corners(tag_size)))
    return float(((reprojected - tag.corners) ** 2).sum()) / tag.corner_std**2


def _covariance(pose: Pose, tag: Tag, intrinsics: Intrinsics, tag_size: float) -> Array:
    """(6, 6) of a right perturbation: the inverse of the corners' Fisher information."""
    square = tag_corners(tag_size)
    x, y, z = pose.apply(square).T
    zero = np.zeros(4)
    by_point = np.stack(
        [
            np.stack([intrinsics.fx / z, zero, -intrinsics.fx * x / z**2], axis=-1),
            np.stack([zero, intrinsics.fy / z, -intrinsics.fy * y / z**2], axis=-1),
        ],
        axis=1,
    )
    by_twist = pose.rotation_matrix @ np.concatenate([np.tile(np.eye(3), (4, 1, 1)), -skew(square)], axis=-1)
    jacobian = (by_point @ by_twist).reshape(8, 6)
    return np.asarray(tag.corner_std**2 * np.linalg.inv(jacobian.T @ jacobian))


Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
_SIZE_RATIO = 1.5
"""Seen over true size of a tag; outside 1/1.5 to 1.5 the depth is that of something else."""


class NoiseModel(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A model of the sensor's errors."""

    depth_bias_std: NotNegative = 0.01
    """m, systematic error of depth along the ray: not visible in the residuals, does not average out."""
    inverse_depth_floor: Positive = 3e-4
    """1/m, least standard deviation of a pixel's inverse depth."""
    inverse_depth_std: Positive = 2.5e-3
    """1/m, standard deviation of a pixel's inverse depth, by which a shape fits or not"""
    depth_correlation: NotNegative = 4.0
    """px, over which neighbouring depth errors are alike: stereo compares patches."""
    size_below: NotNegative = 0.5
    """m, distance below which the tag's size tells the distance instead of depth."""


def estimate_tag_pose(
    tag: Tag, depth: NDArray[np.float32] | None, intrinsics: Intrinsics, tag_size: float, noise: NoiseModel
) -> Pose | None:
    """`camera_from_tag` (x right, y up as printed, z off the face) with covariance; None if it cannot be told.

    Args:
        tag: its corners, px.
        depth: (h, w) m, of the same exposure and intrinsics; None without a depth camera.
        intrinsics: px.
        tag_size: side of the black square, m.
        noise: error model of the sensor.
    """
    plane = None if depth is None else _plane(tag, depth, intrinsics, tag_size, noise)
    if plane is None:
        return pose_from_perspective(tag, intrinsics, tag_size)
    return _pose_on_plane(tag, plane, intrinsics, tag_size, noise)


def _plane(
    tag: Tag, depth: NDArray[np.float32], intrinsics: Intrinsics, tag_size: float, noise: NoiseModel
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
    points = plane.points(intrinsics.rays(tag.corners))
    side = float(np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).mean())
    return plane if 1.0 / _SIZE_RATIO < side / tag_size < _SIZE_RATIO else None


def _pose_on_plane(tag: Tag, plane: DepthPlane, intrinsics: Intrinsics, tag_size: float, noise: NoiseModel) -> Pose:
    """Centre from the corners' points on the plane, axes by Procrustes; errors propagated to first order."""
    points = plane.points(intrinsics.rays(tag.corners))
    centre = points.mean(axis=0)
    offsets, square = points - centre, tag_corners(tag_size)
    by_input = _point_derivatives(points, plane, intrinsics)
    moved = by_input.mean(axis=0)
    turned = _rotation_derivative(offsets, by_input, plane)
    if np.linalg.norm(centre) < noise.size_below:
        spread = (offsets**2).sum()
        scale = np.sqrt((square**2).sum() / spread)
        moved = scale * (moved - np.outer(centre, np.einsum("ni,nij->j", offsets, by_input) / spread))
        centre = scale * centre
    rotation = _axes(offsets, square, plane.normal)
    to_tag = np.concatenate([rotation.T @ moved, rotation.T @ turned])
    inputs = _input_covariance(tag, plane, float(points[:, 2].mean()), noise.depth_bias_std)
    quaternion = quaternions.from_matrix(rotation.tolist())
    return Pose(centre, quaternion, covariance=to_tag @ inputs @ to_tag.T)


def _axes(offsets: Array, square: Array, normal: Array) -> Array:
    """(3, 3) rotation with z = normal that best turns the tag's corners (4, 3) onto the offsets (4, 3)."""
    x = square[:, 0] @ offsets + square[:, 1] @ np.cross(offsets, normal)
    x -= normal * (normal @ x)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(normal, x), normal])


def _point_derivatives(points: Array, plane: DepthPlane, intrinsics: Intrinsics) -> Array:
    """(4, 3, 11) of the corners' points by the corners' pixels u0, v0, u1, ... and the plane p.

    With X = z r and z = 1 / (p . r): dX = z (I - X p^T) dr - X X^T dp.
    """
    by_ray = points[:, 2, None, None] * (np.eye(3) - points[:, :, None] * plane.p)
    by_pixel = by_ray[:, :, :2] / (intrinsics.fx, intrinsics.fy)
    derivatives = np.zeros((4, 3, 11))
    for corner in range(4):
        derivatives[corner, :, 2 * corner : 2 * corner + 2] = by_pixel[corner]
    derivatives[:, :, 8:] = -points[:, :, None] * points[:, None, :]
    return derivatives


def _rotation_derivative(offsets: Array, by_input: Array, plane: DepthPlane) -> Array:
    """(3, 11) rotation vector in camera axes: turn of the corners about the normal, tilt with the plane."""
    normal = plane.normal
    lever = np.cross(normal, offsets) / (offsets**2).sum()
    derivative = np.outer(normal, np.einsum("ni,nij->j", lever, by_input))
    derivative[:, 8:] -= skew(normal) / np.linalg.norm(plane.p)
    return derivative


def _input_covariance(tag: Tag, plane: DepthPlane, distance: float, depth_bias_std: float) -> Array:
    """(11, 11) of the corners' pixels and the plane, for a tag `distance` m along the optical axis.

    A bias b of the depth z in proportion to z scales p by b / z: the tag moves along its ray. If b is the same
    for the whole tag, or grows with z^2 (a shift of disparity), the ends of a tilted tag move unequally: that
    adds or takes (p - e_z / z) b / z, a tilt.
    """
    covariance = np.zeros((11, 11))
    covariance[:8, :8] = tag.corner_std**2 * np.eye(8)
    covariance[8:, 8:] = plane.covariance
    for direction in (plane.p, plane.p - (0.0, 0.0, 1.0 / distance)):
        covariance[8:, 8:] += (depth_bias_std / distance) ** 2 * np.outer(direction, direction)
    return covariance
