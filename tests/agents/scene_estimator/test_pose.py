"""Poses of tags in frames: as good as measured before, never flipped, with covariances that hold."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from msgspec.structs import replace

from agents.drivers import TagCorners, TagReadings
from agents.scene_estimator import pose as fitting
from agents.scene_estimator.detection import Tag, tag_corners
from agents.scene_estimator.pose import NoiseModel, TagFit, estimate_tag_pose, most_likely, possible_tag_poses
from agents.scene_estimator.sighting import FrameSource
from benchmarks.tag_camera import Camera, facing
from dsr import Pose
from dsr.math3d.batches import Array
from dsr.vocabulary.intrinsics import Intrinsics

from .conftest import SIZE, Trial, covariance, nees, trials

EXACT = NoiseModel(corner_std=0.0, depth_bias_std=0.0, depth_ripple_std=0.0, size_std=1e-3)
"""Of the ray tracer: no lens, no systematic errors, tags of the right size."""
DISTANCES = (0.3, 0.6, 1.0)


def reader(noise: NoiseModel) -> FrameSource:
    return FrameSource(lambda _: (SIZE, SIZE, SIZE), 0.8, noise)


@cache
def seen_from(distance: float) -> list[Trial]:
    """With depth errors that differ from pixel to pixel, as in the table below."""
    return trials(Camera(patch=1), distance, 48, seed=1)


@cache
def seen_by_stereo(distance: float) -> list[Trial]:
    """With depth errors that are alike over patches."""
    return trials(Camera(), distance, 16, seed=2)


@pytest.mark.parametrize(
    ("distance", "millimetres", "degrees"),
    [(0.3, (0.75, 1.7), (0.05, 0.11)), (0.6, (1.1, 2.3), (0.34, 0.63)), (1.0, (2.5, 4.2), (1.7, 3.1))],
)
def test_errors_are_those_measured_for_the_method(
    distance: float, millimetres: tuple[float, float], degrees: tuple[float, float]
) -> None:
    """Median and 95 % of the inverse-depth plane cut with the corners' rays; half as much again for 48 trials."""
    look = reader(replace(EXACT, depth_correlation=1.0))
    errors = np.array([trial.estimate(look).distance(trial.pose) for trial in seen_from(distance)])
    for error, limits in ((errors[:, 0] * 1e3, millimetres), (np.degrees(errors[:, 1]), degrees)):
        assert np.median(error) < 1.5 * limits[0]
        assert np.quantile(error, 0.95) < 1.5 * limits[1]


@pytest.mark.parametrize("distance", DISTANCES)
def test_with_depth_nothing_flips(distance: float) -> None:
    look = reader(NoiseModel())
    turns = [trial.estimate(look).distance(trial.pose)[1] for trial in seen_from(distance) + seen_by_stereo(distance)]
    assert np.degrees(max(turns)) < 15


@pytest.mark.parametrize("distance", DISTANCES)
def test_covariance_tells_the_error(distance: float) -> None:
    look = reader(EXACT)
    squares = [nees(trial.estimate(look), trial.pose) for trial in seen_by_stereo(distance)]
    assert 2.0 < np.mean(squares) < 10.0  # six on average
    assert max(squares) < 40.0


@pytest.mark.parametrize("distance", [0.35, 0.6])
def test_covariance_tells_the_error_of_a_biased_camera(distance: float) -> None:
    """The bias moves a tag along the ray, and tilts it further if it is tilted already."""
    look = reader(replace(EXACT, depth_bias_std=0.01))
    biased = trials(Camera(), distance, 12, seed=3, bias_std=0.01)
    squares = [nees(trial.estimate(look), trial.pose) for trial in biased]
    assert 2.0 < np.mean(squares) < 10.0


def spread(pose: Pose) -> tuple[float, float]:
    """Standard deviations of the centre along the viewing ray and across it, m."""
    in_camera = pose.rotation_matrix @ covariance(pose)[:3, :3] @ pose.rotation_matrix.T
    ray = pose.translation / np.linalg.norm(pose.translation)
    along = ray @ in_camera @ ray
    return float(np.sqrt(along)), float(np.sqrt((np.trace(in_camera) - along) / 2))


def test_a_bias_of_depth_makes_percepts_uncertain_along_the_ray() -> None:
    for trial in seen_by_stereo(0.6)[:5]:
        along, across = spread(trial.estimate(reader(replace(EXACT, depth_bias_std=0.01, size_std=0.2))))
        assert along == pytest.approx(0.01, rel=0.1)
        assert across < 0.001
        assert max(spread(trial.estimate(reader(EXACT)))) < 0.001


@pytest.mark.parametrize(
    "corners",
    [
        [(100.0, 100.0)] * 4,
        [(100.0, 100.0), (200.0, 100.0), (300.0, 100.0), (400.0, 100.0)],
        [(0.0, 0.0), (320.0, 320.0), (100.0, 2147483648.0), (496.5360959743777, 354.34342279924044)],
    ],
)
def test_corners_that_no_square_has_are_no_percept(corners: list[tuple[float, float]]) -> None:
    """A detector elsewhere may tell any: the others that it sees still count."""
    intrinsics = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)
    square = [(300.0, 200.0), (340.0, 200.0), (340.0, 240.0), (300.0, 240.0)]
    tags = [TagCorners(number, (a, b, c, d), 0.2) for number, (a, b, c, d) in enumerate((corners, square))]
    found = reader(NoiseModel()).read_corners(TagReadings(1.0, [], intrinsics, corners=tags))
    assert [one.marker_id for one in found] == [1]


def test_near_the_camera_the_size_tells_the_distance() -> None:
    """So that a biased depth moves nothing."""
    biased = trials(Camera(), 0.3, 5, seed=4, bias_std=0.01)
    for trial in biased:
        pose = trial.estimate(reader(NoiseModel()))
        assert pose.distance(trial.pose)[0] < 0.006
        assert spread(pose)[0] == pytest.approx(1.0 / math.hypot(1.0 / 0.01, 1.0 / (0.01 * 0.3)), rel=0.15)


def test_without_depth_the_corners_must_do() -> None:
    look = reader(NoiseModel())
    for trial in seen_from(0.3)[:5]:
        pose = trial.estimate(look, depth=False)
        assert pose != trial.estimate(look)
        assert pose.distance(trial.pose)[0] < 0.005


@pytest.mark.parametrize("wrong", [0.0, np.nan, 0.2, 2.0])
def test_depth_that_is_missing_or_of_something_else_is_not_used(wrong: float, rng: np.random.Generator) -> None:
    intrinsics = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)
    tag = Tag(3, intrinsics.project(facing(0.4, 0.5, rng).apply(tag_corners(0.032))), 0.1)
    depth = np.full((480, 640), wrong, np.float32)
    assert estimate_tag_pose(tag, depth, intrinsics, 0.032, NoiseModel()) == estimate_tag_pose(
        tag, None, intrinsics, 0.032, NoiseModel()
    )


@pytest.mark.parametrize("with_depth", [True, False])
def test_tags_of_an_image_are_fitted_at_once_as_each_alone(with_depth: bool, rng: np.random.Generator) -> None:
    """Corners that no square has, and sizes that are wrong, are the matter of their own tags only."""
    intrinsics = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)
    truths = [facing(rng.uniform(0.3, 1.0), rng.uniform(0.0, 1.0), rng) for _ in range(20)]
    corners = [intrinsics.project(pose.apply(tag_corners(0.032))) + rng.normal(0.0, 0.1, (4, 2)) for pose in truths]
    corners[3], corners[7], corners[9] = np.full((4, 2), 50.0), np.full((4, 2), np.nan), corners[9] * (1.0, 1.4)
    tags = [Tag(number, four, float(rng.uniform(0.1, 0.4))) for number, four in enumerate(corners)]
    depth = rng.normal(0.6, 1e-3, (480, 640)).astype(np.float32) if with_depth else None
    sizes = [0.032 * float(rng.choice([0.6, 1.0, 1.3])) for _ in tags]
    together = possible_tag_poses(tags, depth, intrinsics, sizes, NoiseModel())
    assert not together[7]
    assert max(map(len, together)) == 2
    for tag, size, fits in zip(tags, sizes, together, strict=True):
        alone = estimate_tag_pose(tag, depth, intrinsics, size, NoiseModel())
        pose = most_likely(fits)
        assert (pose is None) == (alone is None)
        if pose is not None and alone is not None:
            assert max(pose.distance(alone)) < 1e-9
            assert covariance(pose) == pytest.approx(covariance(alone), rel=1e-6, abs=1e-15)


@pytest.mark.parametrize("near", [0.1, 0.15, 0.4, 1.0])
def test_a_start_that_leads_nowhere_hinders_no_other(
    near: float, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Depth of something else puts starts behind the camera, and makes the ones that seem best no square."""
    intrinsics = Intrinsics(615.0, 615.0, 319.5, 239.5, 640, 480)
    truths = [facing(near * rng.uniform(0.7, 1.3), rng.uniform(0.0, 1.4), rng) for _ in range(100)]
    tags = [
        Tag(number, intrinsics.project(pose.apply(tag_corners(0.04))) + rng.normal(0.0, 0.3, (4, 2)), 0.1)
        for number, pose in enumerate(truths)
    ]
    depth = (near + 0.003 * (np.arange(640) - 320) + rng.normal(0.0, 0.02, (480, 640))).clip(0.0).astype(np.float32)

    def fits() -> list[list[TagFit]]:
        return possible_tag_poses(tags, depth, intrinsics, [0.04] * len(tags), NoiseModel())

    every, solve = fits(), fitting._TagProblem.solve
    for kept in range(3):
        others = [number for number in range(3) if number != kept]

        def from_one(
            problem: fitting._TagProblem, starts: Array, scales: Array, others: list[int] = others
        ) -> fitting._Fits:
            starts[:, others] = np.nan
            return solve(problem, starts, scales)

        monkeypatch.setattr(fitting._TagProblem, "solve", from_one)
        for some, alone in zip(every, fits(), strict=True):
            assert not alone or min(fit.cost for fit in some) < min(fit.cost for fit in alone) + 1e-6
