"""Tags read again from where they are about: corners without a search, and bits that must be theirs."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from agents.scene_estimator.detection import APRILTAG_STD, TagDetector, grey_of, tag_corners
from agents.scene_estimator.reading import Grey, corners_near
from benchmarks.tag_camera import Camera, facing
from dsr import Pose
from dsr.math3d.transforms import Array

FACING = (1.0, 0.0, 0.0, 0.0)
IDS = np.array([7])


def seen(camera: Camera, rng: np.random.Generator, cube: Pose, marker_id: int = 7) -> tuple[Grey, Array]:
    """A picture of a cube, and where the corners of its tag are in it, px."""
    square = (cube @ Pose((0.0, 0.0, 0.02))).apply(tag_corners(0.032))
    return grey_of(camera.frame({marker_id: cube}, rng).arrays["color"]), camera.intrinsics.project(square)


def test_corners_are_exact_wherever_they_were_expected(camera: Camera, rng: np.random.Generator) -> None:
    """Within a pixel, at all sizes."""
    errors, count = [], 0
    for distance in (0.15, 0.3, 0.6, 1.0, 1.3) * 4:
        grey, corners = seen(camera, rng, facing(distance, rng.uniform(0.0, 0.8), rng))
        found, shown = corners_near(grey, IDS, corners[None] + rng.uniform(-0.7, 0.7, (1, 1, 2)))
        count += 1
        if shown[0]:
            errors.append(found[0] - corners)
    assert len(errors) > 0.8 * count
    assert np.mean(errors, axis=(0, 1)) == pytest.approx([0.0, 0.0], abs=0.02)
    assert np.std(errors) < APRILTAG_STD


def test_a_thousand_pictures_do_not_let_it_drift(camera: Camera, rng: np.random.Generator) -> None:
    grey, corners = seen(camera, rng, Pose((0.0, 0.0, 0.6), FACING))
    found, begin = corners[None], corners
    for _ in range(1000):
        noisy = np.clip(grey + rng.normal(0.0, 2.0, grey.shape[:1])[:, None], 0, 255).astype(np.uint8)
        found, shown = corners_near(noisy, IDS, found)
        assert shown[0]
    assert np.abs(found[0] - begin).max() < APRILTAG_STD


def test_another_id_at_the_same_place_is_not_taken_for_it(camera: Camera, rng: np.random.Generator) -> None:
    grey, corners = seen(camera, rng, Pose((0.0, 0.0, 0.5), FACING), marker_id=8)
    both = np.stack([corners, corners])
    assert corners_near(grey, np.array([7, 8]), both)[1].tolist() == [False, True]


def test_a_tag_turned_by_a_quarter_is_not_taken_for_it(camera: Camera, rng: np.random.Generator) -> None:
    grey, corners = seen(camera, rng, Pose((0.0, 0.0, 0.5), FACING))
    assert corners_near(grey, IDS, np.roll(corners, 1, axis=0)[None])[1].tolist() == [False]


@pytest.mark.parametrize("share", [0.1, 0.3])
@pytest.mark.parametrize("level", [0, 110, 180])
def test_a_finger_over_a_part_of_a_tag_does_not_move_its_corners(
    camera: Camera, rng: np.random.Generator, share: float, level: int
) -> None:
    """What it would move is left to a search."""
    grey, corners = seen(camera, rng, Pose((0.0, 0.0, 0.4), FACING))
    clean, _ = corners_near(grey, IDS, corners[None])
    tip = corners[0] + (share + 0.2) * (corners[1] - corners[0])
    cv2.circle(grey, np.rint(tip).astype(int).tolist(), round(share * 50), float(level), -1)
    found, shown = corners_near(grey, IDS, corners[None])
    assert not shown[0] or np.abs(found[0] - clean[0]).max() < 2 * APRILTAG_STD
    assert not shown[0] or (level, share) == (110, 0.1), "only what is as grey as the middle of an edge may go unseen"


def test_what_lacks_contrast_sharpness_or_a_place_is_not_read(camera: Camera, rng: np.random.Generator) -> None:
    grey, corners = seen(camera, rng, Pose((0.0, 0.0, 0.6), FACING))
    assert corners_near(grey, IDS, corners[None])[1][0]
    pale = (128 + (grey.astype(float) - 128) * 0.05).astype(np.uint8)
    blurred = cv2.blur(grey, (12, 1))
    for picture in (pale, blurred, np.full_like(grey, 128)):
        assert not corners_near(np.asarray(picture, np.uint8), IDS, corners[None])[1][0]
    for nowhere in (corners + 1e4, np.zeros((4, 2)), np.full((4, 2), np.nan)):
        assert not corners_near(grey, IDS, nowhere[None])[1][0]
    assert corners_near(grey, np.empty(0, int), np.empty((0, 4, 2)))[1].shape == (0,)


def test_a_tag_at_the_border_is_read_while_its_edges_are_inside(camera: Camera, rng: np.random.Generator) -> None:
    grey, corners = seen(camera, rng, Pose((0.0, 0.0, 0.6), FACING))
    left = int(corners[:, 0].min())
    for rest, is_read in ((3, True), (0, False)):
        part, moved = np.ascontiguousarray(grey[:, left - rest :]), corners - np.array([left - rest, 0])
        assert corners_near(part, IDS, moved[None])[1][0] == is_read


def test_found_tags_have_the_corners_of_their_edges(camera: Camera, rng: np.random.Generator) -> None:
    """Also small ones, whose corners a detector alone misses by more than 0.3 px."""
    errors = []
    for _ in range(8):
        cube = facing(1.3, rng.uniform(0.0, 0.5), rng)
        square = (cube @ Pose((0.0, 0.0, 0.02))).apply(tag_corners(0.032))
        for tag in TagDetector().detect(camera.frame({7: cube}, rng).arrays["color"]):
            errors.append(tag.corners - camera.intrinsics.project(square))
    assert len(errors) > 4
    assert np.std(errors) < APRILTAG_STD
