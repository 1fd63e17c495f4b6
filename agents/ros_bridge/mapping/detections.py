"""`vision_msgs/Detection3DArray`: objects that a detector in ROS sees, and beliefs of the memory."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.mapping.stamps import to_header, to_seconds
from agents.ros_bridge.mapping.transforms import (
    FARTHEST,
    read_pose,
    read_pose_with_covariance,
    to_pose,
    to_pose_with_covariance,
    to_vector,
)
from agents.ros_bridge.messages.types import RosTypes
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

DETECTIONS = "vision_msgs/msg/Detection3DArray"
_DETECTION, _BOX = "vision_msgs/msg/Detection3D", "vision_msgs/msg/BoundingBox3D"
_RESULT, _HYPOTHESIS = "vision_msgs/msg/ObjectHypothesisWithPose", "vision_msgs/msg/ObjectHypothesis"


class DetectedObject(NamedTuple):
    """One object of a message."""

    frame: str
    """Name of the ROS frame in which the pose is"""
    id: str
    """Which one it is, if the detector follows objects; else empty"""
    kind: str
    """What it is, by the best hypothesis; empty without any"""
    score: float
    """of that, 0 to 1"""
    pose: Pose
    """frame_from_object at the centre of its box, with covariance if there is one, and the stamp of the message"""
    size: Vector3 | None
    """m, of the box; None if it is not told"""


def read_detections(message: Any) -> tuple[list[DetectedObject], list[RosMessageError]]:
    """The objects of a message, and why others are left out: a pose or a size that is none."""
    found, errors = [], []
    for detection in message.detections:
        try:
            found.append(_read(detection, message.header))
        except RosMessageError as error:
            errors.append(error)
    return found, errors


def _read(detection: Any, header: Any) -> DetectedObject:
    own = detection.header
    stamp = to_seconds(own.stamp) or to_seconds(header.stamp)
    best = max(detection.results, key=lambda result: result.hypothesis.score, default=None)
    box = detection.bbox.size
    size: Vector3 = (box.x, box.y, box.z)
    if not all(0.0 <= edge <= FARTHEST for edge in size):
        raise RosMessageError(f"a detection with a box of {size} m")
    has_box = min(size) > 0.0
    if best is None:
        pose = read_pose(detection.bbox.center, stamp)
    else:
        pose = read_pose_with_covariance(best.pose, stamp)
        if has_box:
            pose = _moved(pose, read_pose(detection.bbox.center, stamp))
    hypothesis = None if best is None else best.hypothesis
    return DetectedObject(
        own.frame_id or header.frame_id, detection.id, hypothesis.class_id if hypothesis else "",
        float(hypothesis.score) if hypothesis else 0.0, pose, size if has_box else None,
    )  # fmt: skip


def _moved(pose: Pose, centre: Pose) -> Pose:
    """The centre of the box with the covariance of the pose, carried along as of one rigid body."""
    return (
        centre if pose.cov is None else (pose @ (pose.with_covariance(None).inverse() @ centre)).with_stamp(pose.stamp)
    )


class Believed(NamedTuple):
    """One object as the memory believes it to be."""

    name: str
    kind: str
    """Type of its node"""
    pose: Pose
    """world_from_object at the centre of its box"""
    size: Vector3 | None
    """m, of the box"""
    confidence: float
    """0 to 1"""


def to_detections(types: RosTypes, stamp: float, frame: str, objects: Iterable[Believed]) -> Any:
    """A message of objects in one frame; each has its name as `id`, and its kind as the class of its hypothesis."""
    header = to_header(types, stamp, frame)
    detections = []
    for one in objects:
        size = one.size or (0.0, 0.0, 0.0)
        hypothesis = types.new(_HYPOTHESIS, class_id=one.kind, score=one.confidence)
        result = types.new(_RESULT, hypothesis=hypothesis, pose=to_pose_with_covariance(types, one.pose))
        box = types.new(_BOX, center=to_pose(types, one.pose), size=to_vector(types, size))
        detections.append(types.new(_DETECTION, header=header, results=[result], bbox=box, id=one.name))
    return types.new(DETECTIONS, header=header, detections=detections)


def position_ellipsoid(pose: Pose, deviations: float) -> tuple[Pose, Vector3] | None:
    """The ellipsoid that holds the position of a pose but for `deviations` standard deviations.

    Returns:
        The pose of its axes and its diameters (m) along them, or None without a covariance.
    """
    if pose.cov is None:
        return None
    position, _ = pose.parent_covariances()
    variances, axes = np.linalg.eigh(position)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = axes, pose.t
    x, y, z = (2.0 * deviations * np.sqrt(np.maximum(variances, 0.0))).tolist()
    return Pose.from_matrix(matrix, pose.stamp), (x, y, z)
