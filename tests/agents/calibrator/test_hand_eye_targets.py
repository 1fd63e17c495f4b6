"""Targets of a calibration are found in pictures, to a fraction of a pixel, or not at all."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from agents.calibrator.hand_eye.circles import find_circles
from agents.calibrator.hand_eye.square import find_square
from agents.calibrator.hand_eye.targets import FORMS, TagPlace, Target, read_target, tags_target
from dsr.errors import ConfigError
from dsr.math3d.transforms import Array
from tests.agents.calibrator.hand_eye_pictures import PINHOLE, picture
from tests.agents.calibrator.hand_eye_views import looks

NAMES = ("circles:7x5:0.03", "circles:6x6:0.03", "chessboard:8x6:0.025", "tag36h11:7:0.1", "square:0.2")


def true_pixels(target: Target, camera_from_target: Array) -> Array:
    return PINHOLE.project(target.points @ camera_from_target[:3, :3].T + camera_from_target[:3, 3])


@pytest.mark.parametrize("name", NAMES)
def test_points_are_where_they_are_in_the_picture(name: str) -> None:
    target = read_target(name)
    for seed, pose in enumerate(looks(4, 2, target)):
        found = target.find(picture(target, pose, seed))
        assert found is not None
        off = [np.linalg.norm(found - true_pixels(target, pose)[order], axis=1) for order in target.symmetries]
        best = min(off, key=lambda each: float(each.mean()))
        assert best.mean() < 0.3 and best.max() < 0.8, (name, seed)


@pytest.mark.parametrize("name", [*NAMES, "tag36h11:7:0.1"])
def test_nothing_is_found_where_nothing_is(name: str) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (240, 320)).astype(np.uint8)
    plain = np.full((240, 320), 128, np.uint8)
    assert read_target(name).find(noise) is None and read_target(name).find(plain) is None


def test_a_larger_dot_a_hidden_one_and_dots_beside_the_grid_do_no_harm() -> None:
    target = read_target("circles:7x6:0.03")
    pose = looks(1, 4, target)[0]
    image, truth = picture(target, pose), true_pixels(target, pose)
    first, hidden = truth[0], truth[17]
    cv2.circle(image, np.round(first).astype(int).tolist(), 13, 20, -1, cv2.LINE_AA)
    cv2.circle(image, np.round(hidden).astype(int).tolist(), 14, 235, -1)
    for place in ((15, 15), (620, 30), (30, 400)):
        cv2.circle(image, place, 7, 20, -1, cv2.LINE_AA)
    found = find_circles(image, 7, 6)
    assert found is not None and np.isnan(found[:, 0]).sum() == 1
    off = min(np.nanmax(np.linalg.norm(found - truth[order], axis=1)) for order in target.symmetries)
    assert off < 1.0


def test_a_grid_of_another_size_is_not_found() -> None:
    target = read_target("circles:7x5:0.03")
    assert find_circles(picture(target, looks(1, 4, target)[0]), 9, 7) is None


def test_a_frame_with_gaps_is_found() -> None:
    target = read_target("square:0.2")
    pose = looks(1, 5, target)[0]
    image, truth = picture(target, pose), true_pixels(target, pose)
    middle = 0.6 * truth[0] + 0.4 * truth[1]
    cv2.circle(image, np.round(middle).astype(int).tolist(), 9, 235, -1)
    found = find_square(image)
    assert found is not None
    assert min(np.linalg.norm(np.roll(found, turn, axis=0) - truth, axis=1).max() for turn in range(4)) < 1.0


def test_of_a_layout_the_tags_in_view_are_enough() -> None:
    places = [TagPlace(7, 0.1, (0.0, 0.0, 0.0)), TagPlace(9, 0.1, (5.0, 0.0, 0.0))]
    layout, one = tags_target("tags", places), read_target("tag36h11:7:0.1")
    found = layout.find(picture(one, looks(1, 2, one)[0]))
    assert found is not None and np.isfinite(found[:4]).all() and np.isnan(found[4:]).all()


@pytest.mark.parametrize(
    "name",
    [
        "", "circles", "rings:4x4:0.1", "circles:4x4", "circles:4x4:mm", "circles:4x4:25", "circles:2x9:0.02",
        "chessboard:8:0.02", "chessboard:99x99:0.01", "tag36h11:x:0.05", "tag36h11:9999:0.05",
        "tag36h11:3:-1", "square:",
    ],
)  # fmt: skip
def test_what_is_no_target_is_refused(name: str) -> None:
    with pytest.raises(ConfigError, match="target"):
        read_target(name)


def test_a_layout_is_checked(tmp_path: Path) -> None:
    file = tmp_path / "layout.toml"
    for text, said in (
        ("tag = []", "different ids"),
        ("tag = [{ id = 1, size = 0.1, translation = [0, 0, 0], rotation = [0, 0, 0, 0] }]", "tag 1"),
        ("tag = [{ id = 1, sise = 0.1 }]", "sise"),
    ):
        file.write_text(text, encoding="utf-8")
        with pytest.raises(ConfigError, match=said):
            read_target(f"tags:{file}")
    assert len(FORMS) == 5
