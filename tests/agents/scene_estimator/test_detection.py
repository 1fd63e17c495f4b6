"""Tags in images: ids, corners without bias, nothing where there is nothing."""

from __future__ import annotations

import numpy as np
import pytest

from agents.scene_estimator.detection import SUBPIX_STD, TagDetector, tag_corners
from agents.scene_estimator.reading import READ_STD
from benchmarks.tag_camera import Camera, facing
from dsr import Pose

FACING = (1.0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def detector() -> TagDetector:
    return TagDetector()


def test_corners_are_those_of_the_tag(detector: TagDetector, camera: Camera, rng: np.random.Generator) -> None:
    """In the printed order, without bias, as exact as they claim."""
    errors = []
    for distance in (0.3, 0.45, 0.6) * 3:
        camera_from_cube = facing(distance, rng.uniform(0.0, 0.8), rng)
        square = (camera_from_cube @ Pose((0.0, 0.0, 0.02))).apply(tag_corners(0.032))
        (tag,) = detector.detect(camera.frame({7: camera_from_cube}, rng).arrays["color"])
        assert tag.marker_id == 7
        assert tag.corner_std == READ_STD
        errors.append(tag.corners - camera.intrinsics.project(square))
    assert np.mean(errors, axis=(0, 1)) == pytest.approx([0.0, 0.0], abs=0.03)
    assert READ_STD / 2.0 < np.std(errors) < 1.5 * READ_STD


def test_tags_of_12_px_are_found(detector: TagDetector, camera: Camera, rng: np.random.Generator) -> None:
    for _ in range(10):
        camera_from_cube = facing(1.6, rng.uniform(0.0, 0.8), rng)
        square = (camera_from_cube @ Pose((0.0, 0.0, 0.02))).apply(tag_corners(0.032))
        (tag,) = detector.detect(camera.frame({7: camera_from_cube}, rng).arrays["color"])
        assert np.abs(tag.corners - camera.intrinsics.project(square)).max() < 3.5 * SUBPIX_STD


def test_tags_come_by_id(detector: TagDetector, camera: Camera, rng: np.random.Generator) -> None:
    cubes = {marker: Pose((0.1 * index - 0.1, 0.0, 0.5), FACING) for index, marker in enumerate((586, 3, 40))}
    tags = detector.detect(camera.frame(cubes, rng).arrays["color"])
    assert [tag.marker_id for tag in tags] == [3, 40, 586]


def test_an_id_that_shows_twice_is_left_out(detector: TagDetector, camera: Camera, rng: np.random.Generator) -> None:
    left, right = (camera.frame({3: Pose((x, 0.0, 0.5), FACING)}, rng).arrays["color"] for x in (-0.1, 0.1))
    both = np.hstack([left[:, :320], right[:, 320:]])
    both[:120, :200] = camera.frame({4: Pose((-0.2, -0.15, 0.5), FACING)}, rng).arrays["color"][:120, :200]
    assert [tag.marker_id for tag in detector.detect(both)] == [4]


def test_a_small_second_copy_makes_an_id_ambiguous_too(
    detector: TagDetector, camera: Camera, rng: np.random.Generator
) -> None:
    """Though only one of the two detectors finds it."""
    near, far = (
        camera.frame({3: Pose((x, 0.0, z), FACING)}, rng).arrays["color"] for x, z in ((-0.1, 0.4), (0.1, 1.5))
    )
    assert [(tag.marker_id, tag.corner_std) for tag in detector.detect(far)] == [(3, SUBPIX_STD)], "no edges are read"
    assert detector.detect(np.hstack([near[:, :320], far[:, 320:]])) == []


@pytest.mark.parametrize("shape", [(1, 1, 3), (3, 200, 3), (200, 3, 3), (240, 320, 3)])
def test_nothing_is_seen_in_noise(detector: TagDetector, rng: np.random.Generator, shape: tuple[int, ...]) -> None:
    assert detector.detect(rng.integers(0, 256, shape, dtype=np.uint8)) == []
    assert detector.detect(np.clip(rng.normal(120, 5, shape), 0, 255).astype(np.uint8)) == []
    assert detector.detect(np.zeros(shape, np.uint8)) == []


def test_a_tag_cut_by_the_border_is_not_seen(detector: TagDetector, camera: Camera, rng: np.random.Generator) -> None:
    color = camera.frame({3: Pose((0.0, 0.0, 0.5), FACING)}, rng).arrays["color"]
    assert detector.detect(color[:, :320]) == []


def test_a_tag_seen_in_a_mirror_is_none(detector: TagDetector, camera: Camera, rng: np.random.Generator) -> None:
    color = camera.frame({3: Pose((0.0, 0.0, 0.5), FACING)}, rng).arrays["color"]
    assert detector.detect(np.ascontiguousarray(color[:, ::-1])) == []
