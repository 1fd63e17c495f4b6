"""What limits the pose of one tag of the block: its corners, the layout of the tags, or those that predict it."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np

from agents.scene_estimator.detection import Tag, tag_corners
from dsr.math3d import quaternions
from dsr.math3d.batches import skew
from dsr.math3d.transforms import Array, Pose, exp
from dsr.vocabulary.intrinsics import Intrinsics

_STEPS = 5
"""Of Gauss-Newton; three or four do"""
_ROUNDS = 5
"""Rounds of fitting the frames to the layout, and the layout to the frames"""
_FAR_OFF = 2.0
"""px from which a corner weighs less in a layout"""
_WITHIN_95 = 1.96
"""Standard deviations that hold 95 % of normal errors"""


class View(NamedTuple):
    """The block in one frame."""

    camera_from_block: Pose
    tags: list[Tag]


class Budget(NamedTuple):
    """Where errors of poses come from."""

    corner_rms: float
    """px along one axis, of corners from the pose that fits all tags of a frame, root mean square"""
    corner_median: float
    """px, likewise the median of its amount"""
    single: float
    """mm along the viewing ray by which a tag is off if each corner is off by 1 px, the median"""
    others: float
    """mm, likewise of what the other tags predict"""

    @property
    def floor(self) -> float:
        """mm, 95 % of the errors of one tag that corners as wrong as these leave, if each frame is judged by itself."""
        return _WITHIN_95 * self.corner_rms * math.hypot(self.single, self.others)


def budget(views: list[View], layout: dict[int, Pose], side: float, lens: Intrinsics) -> Budget:
    """Where the errors come from, by views with at least three tags."""
    square = tag_corners(side)
    off, single, others = [], [], []
    for view in views:
        places = {tag.marker_id: layout[tag.marker_id].apply(square) for tag in view.tags}
        for tag in view.tags:
            off.append(tag.corners - lens.project(view.camera_from_block.apply(places[tag.marker_id])))
            tag_from_block = layout[tag.marker_id].inverse()
            camera_from_tag = view.camera_from_block @ layout[tag.marker_id]
            single.append(_along(camera_from_tag, square, lens))
            rest = [tag_from_block.apply(points) for name, points in places.items() if name != tag.marker_id]
            others.append(_along(camera_from_tag, np.concatenate(rest), lens))
    errors = np.concatenate(off)
    return Budget(
        math.sqrt(float((errors**2).mean())),
        float(np.median(np.linalg.norm(errors, axis=1))),
        1e3 * float(np.median(single)),
        1e3 * float(np.median(others)),
    )


def refined(views: list[View], layout: dict[int, Pose], side: float, lens: Intrinsics) -> dict[int, Pose]:
    """The layout that fits the corners of these views best; the tag with the smallest id stays where it is."""
    square, found = tag_corners(side), dict(layout)
    for _ in range(_ROUNDS):
        cameras = [_fitted(view, found, square, lens) for view in views]
        for name in sorted(found)[1:]:
            seen = [
                (camera, tag.corners)
                for camera, view in zip(cameras, views, strict=True)
                for tag in view.tags
                if tag.marker_id == name
            ]
            if seen:
                found[name] = _placed(found[name], seen, square, lens)
    return found


def _fitted(view: View, layout: dict[int, Pose], square: Array, lens: Intrinsics) -> Pose:
    points = np.concatenate([layout[tag.marker_id].apply(square) for tag in view.tags])
    rays = np.ascontiguousarray(lens.rays(np.concatenate([tag.corners for tag in view.tags]))[:, :2])
    start = view.camera_from_block
    begin = [np.array(part, np.float64) for part in (quaternions.to_rotvec(start.q), start.t)]
    turn, move = cv2.solvePnPRefineLM(points, rays, np.eye(3), None, begin[0], begin[1])
    return Pose.from_rotvec(move.ravel(), turn.ravel())


def _placed(start: Pose, seen: list[tuple[Pose, Array]], square: Array, lens: Intrinsics) -> Pose:
    """Gauss-Newton steps with the weights of Huber (1964)."""
    turns = np.array([camera.rotation_matrix for camera, _ in seen])[:, None]
    moves = np.array([camera.t for camera, _ in seen])[:, None]
    corners, pose = np.array([found for _, found in seen]), start
    for _ in range(_STEPS):
        points = (turns @ pose.apply(square)[..., None])[..., 0] + moves
        pixels, by_point = lens.project_with_derivative(points)
        jacobian = by_point @ turns @ _by_twist(pose, square)
        off = corners - pixels
        weights = np.minimum(1.0, _FAR_OFF / np.maximum(np.linalg.norm(off, axis=-1), _FAR_OFF))
        information = np.einsum("vn,vnki,vnkj->ij", weights, jacobian, jacobian)
        pose = pose @ exp(np.linalg.solve(information, np.einsum("vn,vnki,vnk->i", weights, jacobian, off)))
    return pose


def _along(pose: Pose, points: Array, lens: Intrinsics) -> float:
    """Standard deviation, m along the viewing ray, of a body whose points are each off by 1 px in both axes."""
    jacobian = (lens.project_with_derivative(pose.apply(points))[1] @ _by_twist(pose, points)).reshape(-1, 6)
    covariance = np.linalg.inv(jacobian.T @ jacobian)[:3, :3]
    ray = pose.rotation_matrix.T @ (pose.translation / np.linalg.norm(pose.translation))
    return math.sqrt(float(ray @ covariance @ ray))


def _by_twist(pose: Pose, points: Array) -> Array:
    """(n, 3, 6) derivative of moved points (n, 3) by a right perturbation of the pose."""
    unit = np.broadcast_to(np.eye(3), (len(points), 3, 3))
    return np.asarray(pose.rotation_matrix @ np.concatenate([unit, -skew(points)], axis=-1), dtype=np.float64)
