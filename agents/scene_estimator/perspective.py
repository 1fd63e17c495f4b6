"""Tag pose from its four corners alone (perspective), for where depth is missing.

IPPE (Collins and Bartoli, "Infinitesimal Plane-Based Pose Estimation", IJCV 2014) returns the two poses
that a small or distant tag can hardly tell apart.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from agents.scene_estimator.detection import Tag
from agents.scene_estimator.geometry import Array, Intrinsics, skew, tag_corners
from dsr.math3d.transforms import Pose, log

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
    covariance = _covariance(best, tag, intrinsics, tag_size)
    doubt = 1.0 / (1.0 + math.exp(min(0.5 * (max(costs) - min(costs)), _CERTAIN)))
    apart = log(best.inverse() @ other)
    uncertain: Pose = best.with_covariance(covariance + doubt * np.outer(apart, apart))
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
    reprojected = intrinsics.pixels(pose.apply(tag_corners(tag_size)))
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
