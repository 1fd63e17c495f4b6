"""Poses, covariances, transforms and stamps, there and back, and against the definition of ROS."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.mapping.stamps import split, to_duration, to_seconds, to_time
from agents.ros_bridge.mapping.transforms import (
    is_same,
    read_pose,
    read_pose_with_covariance,
    read_transform,
    to_child,
    to_parent,
    to_pose,
    to_pose_with_covariance,
    to_stamped,
    to_transform,
)
from agents.ros_bridge.messages.transforms import decode_transforms, encode_transforms
from agents.ros_bridge.messages.types import types_of
from dsr.math3d.transforms import Pose, exp, log

TYPES = types_of("jazzy")
NUMBER = st.floats(-100.0, 100.0)
ROTATION = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: math.hypot(*q) > 0.1)
POSES = st.builds(
    lambda t, q: Pose(t, tuple(v / math.hypot(*q) for v in q)), st.tuples(NUMBER, NUMBER, NUMBER), ROTATION
)
SQUARES = st.lists(st.floats(-0.1, 0.1), min_size=36, max_size=36).map(
    lambda values: np.array(values).reshape(6, 6) @ np.array(values).reshape(6, 6).T
)
STAMPS = st.floats(0.0, 2.0e9)


@given(POSES)
def test_a_pose_comes_back(pose: Pose) -> None:
    again = read_pose(
        TYPES.decode("geometry_msgs/msg/Pose", TYPES.encode("geometry_msgs/msg/Pose", to_pose(TYPES, pose))), 3.0
    )
    assert pose.distance(again) == pytest.approx((0.0, 0.0), abs=1e-7) and again.stamp == 3.0
    message = to_transform(TYPES, pose)
    assert (message.translation.x, message.rotation.w) == (pose.t[0], pose.q[3])


@given(POSES, SQUARES)
def test_a_covariance_comes_back_in_the_child_frame(pose: Pose, covariance: np.ndarray) -> None:
    message = to_pose_with_covariance(TYPES, pose.with_covariance(covariance))
    again = read_pose_with_covariance(message, 0.0)
    if covariance.any():
        assert again.covariance is not None
        np.testing.assert_allclose(again.covariance, covariance, atol=1e-12)
    np.testing.assert_allclose(to_child(pose, to_parent(pose, covariance)), covariance, atol=1e-12)


@settings(max_examples=25)
@given(POSES, SQUARES, st.integers(0, 2**32))
def test_the_covariance_of_ros_is_that_of_positions_and_rotations_along_the_parents_axes(
    pose: Pose, covariance: np.ndarray, seed: int
) -> None:
    """Drawn from the definition of ours: T exp(xi). Of small errors, whose second order is nothing."""
    small = covariance * 1e-6
    rng = np.random.default_rng(seed)
    twists = rng.multivariate_normal(np.zeros(6), small, size=800, method="eigh")
    errors = []
    for twist in twists:
        moved = pose @ exp(twist)
        turned = Pose((0.0, 0.0, 0.0), moved.q) @ Pose((0.0, 0.0, 0.0), pose.q).inverse()
        errors.append([*(np.array(moved.t) - pose.t), *log(turned)[3:]])
    drawn = np.cov(np.array(errors).T)
    scale = max(float(np.abs(small).max()), 1e-12)
    np.testing.assert_allclose(drawn / scale, to_parent(pose, small) / scale, atol=0.5)
    exact = np.array(errors).T @ np.array(errors)
    rotation = np.kron(np.eye(2), pose.rotation_matrix)
    np.testing.assert_allclose(exact, rotation @ (twists.T @ twists) @ rotation.T, atol=2e-2 * len(twists) * scale)


def test_unknown_covariances_and_broken_poses() -> None:
    zeros = to_pose_with_covariance(TYPES, Pose((1.0, 2.0, 3.0)))
    assert not np.any(zeros.covariance)
    assert read_pose_with_covariance(zeros, 0.0).covariance is None
    zeros.covariance[:] = np.eye(6).ravel()
    zeros.covariance[35] = 1e308
    assert read_pose_with_covariance(zeros, 0.0).covariance is None
    zeros.covariance[0] = -1.0
    assert read_pose_with_covariance(zeros, 0.0).covariance is None
    zeros.pose.orientation.w = 0.0
    with pytest.raises(RosMessageError, match="no pose"):
        read_pose_with_covariance(zeros, 0.0)


@given(POSES, STAMPS)
def test_a_transform_of_tf_comes_back(pose: Pose, stamp: float) -> None:
    (found,) = decode_transforms(encode_transforms([to_stamped("map", "base", stamp, pose)]))
    assert (found.parent, found.child) == ("map", "base")
    assert found.sec + found.nanosec * 1e-9 == pytest.approx(stamp, abs=5e-7)
    again = read_transform(found.parent, found.child, found.pose, 5.0)
    assert is_same(again, pose) and again.stamp == 5.0
    assert not is_same(again, pose @ Pose((0.0, 0.0, 1e-3)))


def test_numbers_that_are_no_transform_are_refused() -> None:
    broken = Pose.unchecked((math.nan, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    with pytest.raises(RosMessageError, match="'a' -> 'b'"):
        read_transform("a", "b", (*broken.t, *broken.q), 1.0)


@given(STAMPS)
def test_stamps_come_back_to_a_microsecond(stamp: float) -> None:
    assert to_seconds(to_time(TYPES, stamp)) == pytest.approx(stamp, abs=5e-7)
    assert to_seconds(to_duration(TYPES, -stamp)) == pytest.approx(-stamp, abs=5e-7)
    assert 0 <= split(stamp)[1] < 10**9


@pytest.mark.parametrize("stamp", [math.inf, math.nan, 1e12])
def test_a_stamp_that_ros_does_not_have_is_refused(stamp: float) -> None:
    with pytest.raises(RosMessageError):
        split(stamp)
