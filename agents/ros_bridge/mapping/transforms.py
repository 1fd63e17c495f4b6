"""Poses of the graph and of `geometry_msgs`, with covariance.

ROS states a covariance along the axes of the parent: position, then rotation about the fixed axes. The graph states
that of a perturbation in the child frame (`dsr.math3d.transforms`). To first order the one is the other turned by the
rotation of the pose: neither moves the other's origin.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.mapping.stamps import split
from agents.ros_bridge.messages.transforms import StampedTransform
from agents.ros_bridge.messages.types import RosTypes
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Array, Pose

POINT, VECTOR = "geometry_msgs/msg/Point", "geometry_msgs/msg/Vector3"
QUATERNION = "geometry_msgs/msg/Quaternion"
POSE, TRANSFORM = "geometry_msgs/msg/Pose", "geometry_msgs/msg/Transform"
POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovariance"


def read_pose(message: Any, stamp: float, covariance: Array | None = None) -> Pose:
    """Read a `geometry_msgs/Pose`. Raises `RosMessageError` for one that is none; (6, 6) `covariance` as in ROS."""
    p, q = message.position, message.orientation
    try:
        pose = Pose(_near((p.x, p.y, p.z)), (q.x, q.y, q.z, q.w), stamp)
        return pose if covariance is None else pose.with_covariance(to_child(pose, covariance))
    except ValueError as error:
        raise RosMessageError(f"no pose: {error}") from error


def read_pose_with_covariance(message: Any, stamp: float) -> Pose:
    """Read a `geometry_msgs/PoseWithCovariance`; one of zeros or with a negative variance means that it is not known.

    Raises:
        RosMessageError: for a pose that is none.
    """
    covariance = np.asarray(message.covariance, dtype=np.float64).reshape(6, 6)
    bounded = (np.abs(covariance) <= FARTHEST).all()  # also no "not a number"
    known = bounded and covariance.any() and (covariance.diagonal() >= 0.0).all()
    return read_pose(message.pose, stamp, 0.5 * (covariance + covariance.T) if known else None)


def read_transform(parent: str, child: str, numbers: Sequence[float], stamp: float) -> Pose:
    """parent_from_child of one transform of tf, at a stamp (s) of the graph. Raises `RosMessageError` for none.

    `numbers` are its translation (m) and its quaternion (x, y, z, w).
    """
    x, y, z, qx, qy, qz, qw = numbers
    if abs(qx * qx + qy * qy + qz * qz + qw * qw - 1.0) < _UNIT_TOLERANCE and abs(x) + abs(y) + abs(z) < FARTHEST:
        return Pose.unchecked((x, y, z), (qx, qy, qz, qw), stamp)
    try:
        return Pose(_near((x, y, z)), (qx, qy, qz, qw), stamp)
    except ValueError as error:
        raise RosMessageError(f"transform {parent!r} -> {child!r}: {error}") from error


def to_stamped(parent: str, child: str, stamp: float, pose: Pose) -> StampedTransform:
    """One transform of tf, of frames by their names in ROS. Raises `RosMessageError` for a stamp beyond ROS."""
    return StampedTransform(*split(stamp), parent, child, (*pose.t, *pose.q))


def is_same(one: Pose, other: Pose) -> bool:
    """Whether two transforms are the same but for rounding: one of them is the other, passed on by somebody."""
    metres, radians = one.distance(other)
    return metres <= _ROUNDING and radians <= _ROUNDING


def _near(xyz: Vector3) -> Vector3:
    if max(map(abs, xyz)) > FARTHEST:
        raise ValueError(f"translation {xyz}: expected at most {FARTHEST:g} m")
    return xyz


FARTHEST = 1e9
"""m, of a translation: farther than the Moon; products of larger ones are no numbers any more. A larger variance (m^2)
says that nothing is known"""
_UNIT_TOLERANCE = 1e-12
"""Rounding of a unit quaternion: within it the numbers are taken as they are, which is what most publishers send"""
_ROUNDING = 1e-6
"""m and rad by which a transform changes when somebody passes it on in numbers of single precision"""


def to_pose(types: RosTypes, pose: Pose) -> Any:
    """A `geometry_msgs/Pose`."""
    return types.new(POSE, position=to_point(types, pose.t), orientation=to_quaternion(types, pose.q))


def to_transform(types: RosTypes, pose: Pose) -> Any:
    """A `geometry_msgs/Transform`."""
    return types.new(TRANSFORM, translation=to_vector(types, pose.t), rotation=to_quaternion(types, pose.q))


def to_pose_with_covariance(types: RosTypes, pose: Pose) -> Any:
    """A `geometry_msgs/PoseWithCovariance`, with zeros if the covariance is not known."""
    covariance = np.zeros((6, 6)) if pose.covariance is None else to_parent(pose, pose.covariance)
    return types.new(POSE_WITH_COVARIANCE, pose=to_pose(types, pose), covariance=covariance.ravel())


def to_point(types: RosTypes, xyz: Any) -> Any:
    """A `geometry_msgs/Point`, m."""
    return types.new(POINT, x=float(xyz[0]), y=float(xyz[1]), z=float(xyz[2]))


def to_vector(types: RosTypes, xyz: Any) -> Any:
    """A `geometry_msgs/Vector3`."""
    return types.new(VECTOR, x=float(xyz[0]), y=float(xyz[1]), z=float(xyz[2]))


def to_quaternion(types: RosTypes, xyzw: Any) -> Any:
    """A `geometry_msgs/Quaternion` (x, y, z, w)."""
    x, y, z, w = map(float, xyzw)
    return types.new(QUATERNION, x=x, y=y, z=z, w=w)


def to_parent(pose: Pose, covariance: Array) -> Array:
    """(6, 6) covariance as ROS states it, along the parent's axes, of one in the child frame of `pose`."""
    return _turned(pose.rotation_matrix, covariance)


def to_child(pose: Pose, covariance: Array) -> Array:
    """(6, 6) covariance in the child frame of `pose`, of one as ROS states it."""
    return _turned(pose.rotation_matrix.T, covariance)


def _turned(rotation: Array, covariance: Array) -> Array:
    both = np.zeros((6, 6))
    both[:3, :3] = both[3:, 3:] = rotation
    moved: Array = both @ covariance @ both.T
    moved = 0.5 * (moved + moved.T)
    np.fill_diagonal(moved, np.maximum(moved.diagonal(), 0.0))
    return moved
