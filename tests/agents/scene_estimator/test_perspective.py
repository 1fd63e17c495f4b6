"""Pose from four corners: exact on exact corners, and honest about the other pose that fits as well."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from agents.scene_estimator.detection import Tag, tag_corners
from agents.scene_estimator.perspective import square_poses
from agents.scene_estimator.pose import NoiseModel, estimate_tag_pose
from benchmarks.tag_camera import facing
from dsr import Pose
from dsr.vocabulary.intrinsics import Intrinsics

from .conftest import covariance, nees

LENS = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)
SIDE = 0.032
STD = 0.1


def seen(pose: Pose, noise: float = 0.0, rng: np.random.Generator | None = None) -> Tag:
    """The tag at `pose`, with an error of its corners in px."""
    corners = LENS.project(pose.apply(tag_corners(SIDE)))
    return Tag(1, corners if rng is None else corners + rng.normal(0.0, noise, (4, 2)), STD)


def from_corners(tag: Tag, side: float = SIDE) -> Pose | None:
    """The pose of a tag whose size is known well."""
    return estimate_tag_pose(tag, None, LENS, side, NoiseModel(size_std=1e-3))


@pytest.mark.parametrize("tilt", [0.1, 0.5, 1.0])
def test_exact_corners_give_the_pose(tilt: float, rng: np.random.Generator) -> None:
    truth = facing(0.3, tilt, rng)
    pose = from_corners(seen(truth))
    assert pose is not None
    metres, radians = pose.distance(truth)
    assert metres < 1e-5
    assert radians < 1e-3


def test_a_larger_tag_is_further_away(rng: np.random.Generator) -> None:
    truth = facing(0.3, 0.4, rng)
    pose = from_corners(seen(truth), 2 * SIDE)
    assert pose is not None
    assert pose.translation == pytest.approx(2 * truth.translation, rel=1e-3)


def test_covariance_tells_the_error_of_a_near_tag(rng: np.random.Generator) -> None:
    truths = [facing(0.25, rng.uniform(0.4, 0.8), rng) for _ in range(100)]
    poses = [from_corners(seen(truth, STD, rng)) for truth in truths]
    squares = [nees(pose, truth) for pose, truth in zip(poses, truths, strict=True) if pose is not None]
    assert len(squares) == len(truths)
    assert 4.0 < np.mean(squares) < 9.0


def test_distance_is_less_certain_than_direction(rng: np.random.Generator) -> None:
    pose = from_corners(seen(facing(0.5, 0.6, rng, spread=0.0)))
    assert pose is not None
    in_camera = pose.rotation_matrix @ covariance(pose)[:3, :3] @ pose.rotation_matrix.T
    assert in_camera[2, 2] > 100 * max(in_camera[0, 0], in_camera[1, 1])


def test_where_two_poses_fit_the_covariance_spans_both(rng: np.random.Generator) -> None:
    """From 1 m a slight tilt looks like its mirror image: some answers flip, and none is sure of itself."""
    tilt = 0.3
    truths = [facing(1.0, tilt, rng) for _ in range(100)]
    poses = [from_corners(seen(truth, STD, rng)) for truth in truths]
    found = [(pose, truth) for pose, truth in zip(poses, truths, strict=True) if pose is not None]
    flipped = [pose for pose, truth in found if pose.distance(truth)[1] > tilt]
    assert 5 < len(flipped) < 50
    assert min(np.sqrt(np.trace(covariance(pose)[3:, 3:])) for pose in flipped) > 0.5 * tilt


@pytest.mark.parametrize(
    "corners", [np.full((4, 2), 50.0), np.array([[0.0, 0], [10, 0], [20, 0], [30, 0]]), np.full((4, 2), np.nan)]
)
def test_corners_of_no_square_are_no_pose(corners: np.ndarray) -> None:
    pose = from_corners(Tag(1, corners, STD))
    assert pose is None or np.isfinite(covariance(pose)).all()


def test_both_poses_are_those_of_opencv(rng: np.random.Generator) -> None:
    truths = [facing(0.6, rng.uniform(0.0, 1.3), rng) for _ in range(200)]
    rays = LENS.rays(np.array([seen(truth, 0.5, rng).corners for truth in truths]))
    found = square_poses(rays, np.full(len(rays), SIDE))
    for four, (one, other) in zip(rays, found, strict=True):
        flat = np.ascontiguousarray(four[:, :2])
        solved = cv2.solvePnPGeneric(tag_corners(SIDE), flat, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
        peers = [np.hstack([cv2.Rodrigues(turn)[0], shift]) for turn, shift in zip(*solved[1:3], strict=True)]
        apart = [[np.abs(own[:3] - peer).max() for peer in peers] for own in (one, other)]
        assert min(max(apart[0][0], apart[1][1]), max(apart[0][1], apart[1][0])) < 1e-5


def test_what_is_no_square_before_the_camera_has_no_pose(rng: np.random.Generator) -> None:
    """And hinders no other."""
    rays = LENS.rays(np.array([seen(facing(0.3, 0.5, rng)).corners, *np.zeros((2, 4, 2))]))
    rays[1, :, :2] = np.outer(range(4), (0.1, 0.2))
    with np.errstate(all="raise"):
        found = square_poses(rays, np.full(3, SIDE))
    assert np.isfinite(found[0]).all()
    assert np.isnan(found[1:]).all()
