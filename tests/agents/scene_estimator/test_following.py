"""Tags followed from frame to frame: motion blur is taken off, and poses that look alike do not flip."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from agents.scene_estimator.detection import Tag, TagDetector, tag_corners
from agents.scene_estimator.following import Sharpener, TagFollower
from agents.scene_estimator.pose import NoiseModel, estimate_tag_pose
from dsr import Pose
from dsr.math3d.transforms import Array
from dsr.vocabulary.intrinsics import Intrinsics

LENS = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)
SIDE = 0.05
HZ = 40.0
NOISE = NoiseModel(blur=0.0, corner_std=0.0)
BLUR = 1e-3


def square(x: float, y: float, half: float = 40.0) -> Array:
    return np.array([(x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half)])


def test_a_moving_square_gets_its_size_back() -> None:
    """Along its motion, which has made it smaller, and not across."""
    sharpener = Sharpener(BLUR)
    seen = square(0.0, 0.0) * (38.0 / 40.0, 1.0)
    (first,) = sharpener.sharpened([Tag(1, seen, 0.1)], 0.0)
    assert np.array_equal(first.corners, seen), "nobody knows yet how fast it is"
    (second,) = sharpener.sharpened([Tag(1, seen + np.array((50.0, 0.0)), 0.1)], 0.025)
    assert second.corners == pytest.approx(square(50.0, 0.0))
    assert second.corner_std == pytest.approx(np.hypot(0.1, 2.0)), "as unsure as it is large"


def test_a_square_that_stands_is_as_it_was() -> None:
    sharpener = Sharpener(BLUR)
    for stamp in (0.0, 0.025):
        (tag,) = sharpener.sharpened([Tag(1, square(3.0, 4.0), 0.1)], stamp)
    assert np.array_equal(tag.corners, square(3.0, 4.0)) and tag.corner_std == 0.1


@pytest.mark.parametrize("seconds", [0.6, 0.0, -0.1])
def test_what_was_not_seen_for_long_or_is_older_has_no_speed(seconds: float) -> None:
    sharpener = Sharpener(BLUR)
    sharpener.sharpened([Tag(1, square(0.0, 0.0), 0.1)], 1.0)
    tag = Tag(1, square(50.0, 0.0), 0.1)
    assert sharpener.sharpened([tag], 1.0 + seconds)[0] is tag


def test_what_moves_further_than_it_is_wide_keeps_its_corners() -> None:
    """The corners cannot be right then, and their standard deviation says so."""
    sharpener = Sharpener(BLUR)
    sharpener.sharpened([Tag(1, square(0.0, 0.0, 2.0), 0.1)], 0.0)
    (tag,) = sharpener.sharpened([Tag(1, square(300.0, 0.0, 2.0), 0.1)], 0.025)
    assert np.array_equal(tag.corners, square(300.0, 0.0, 2.0)) and tag.corner_std > 10.0


def picture(x: float, exposed: float) -> np.ndarray:
    """A tag of 96 px whose left edge is at x px, on a white table, that moves by `exposed` px while it is taken.

    White is twice as bright as the camera can show, so that black is thin where white was for half of the time.
    """
    marker = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), 7, 96)
    sheet = np.full((160, 400), 255, np.uint8)
    sheet[32:128, 32:128] = marker
    moments = [
        cv2.warpAffine(sheet, np.float64([[1, 0, x - 32 + share * exposed], [0, 1, 0]]), (400, 160), borderValue=255.0)
        for share in np.linspace(-0.5, 0.5, 41)
    ]
    bright = np.clip(2.0 * np.mean(moments, axis=0), 0, 255).astype(np.uint8)
    return cv2.cvtColor(cv2.GaussianBlur(bright, (0, 0), 0.7), cv2.COLOR_GRAY2RGB)


def test_the_blur_of_a_picture_is_taken_off() -> None:
    """6 px of blur, in which white outshines black, make a moving tag narrower; most of that is mended."""
    exposed, step = 6.0, 48.0
    sharpener = Sharpener(exposed / 4.0 / (step * HZ))
    for number in range(2):
        (seen,) = TagDetector().detect(picture(60.0 + number * step, exposed))
        (tag,) = sharpener.sharpened([seen], number / HZ)
    widths = [corners[1:3, 0].mean() - corners[[0, 3], 0].mean() for corners in (seen.corners, tag.corners)]
    assert widths[0] < 96.0 - 0.3 * exposed
    assert abs(widths[1] - 96.0) < 0.5 * abs(widths[0] - 96.0)
    assert tag.corners.mean(axis=0) == pytest.approx(seen.corners.mean(axis=0), abs=0.1)


def views(rng: np.random.Generator, frames: int) -> list[tuple[Pose, Tag]]:
    """A small tag at 1.2 m that turns slowly about the viewing ray: corners alone leave two poses."""
    tilted = Pose.from_rotvec((0.05, 0.0, 1.2), (2.6, 0.3, 0.0))
    found = []
    for number in range(frames):
        pose = tilted @ Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, 0.01 * number))
        corners = LENS.project(pose.apply(tag_corners(SIDE))) + rng.normal(0.0, 0.15, (4, 2))
        found.append((pose, Tag(7, corners, 0.15)))
    return found


def flips(found: list[Pose | None], views: list[tuple[Pose, Tag]]) -> int:
    return sum(seen is not None and seen.distance(pose)[1] > 0.3 for seen, (pose, _) in zip(found, views, strict=True))


def test_the_frames_before_tell_which_of_two_poses_is_right() -> None:
    """Single frames flip now and then; followed, hardly ever once some frames were seen."""
    alone, followed = 0, 0
    for seed in range(20):
        frames = views(np.random.default_rng(seed), 60)
        follower = TagFollower(NOISE)
        alone += flips([estimate_tag_pose(tag, None, LENS, SIDE, NOISE) for _, tag in frames][40:], frames[40:])
        found = [follower.poses([tag], None, LENS, [SIDE], number / HZ)[0] for number, (_, tag) in enumerate(frames)]
        followed += flips(found[40:], frames[40:])
    assert alone >= 20
    assert followed <= alone / 5


def test_a_pose_that_was_wrong_is_given_up() -> None:
    """A tag that is exchanged for another pose within a frame is believed where it is after some frames."""
    follower = TagFollower(NOISE)
    first, then = (Pose.from_rotvec((0.0, 0.0, 0.4), (turn, 0.0, 0.0)) for turn in (2.4, 3.9))
    for number in range(40):
        pose = first if number < 20 else then
        tag = Tag(7, LENS.project(pose.apply(tag_corners(SIDE))), 0.1)
        (found,) = follower.poses([tag], None, LENS, [SIDE], number / HZ)
    assert found is not None and found.distance(then)[1] < 0.05


def test_corners_of_no_square_are_no_pose() -> None:
    corners = LENS.project(Pose.from_rotvec((0.0, 0.0, 0.4), (2.6, 0.3, 0.0)).apply(tag_corners(SIDE)))
    assert estimate_tag_pose(Tag(7, corners, 0.2), None, LENS, SIDE, NOISE) is not None
    hidden = corners.copy()
    hidden[2] += np.array((6.0, 9.0))
    assert estimate_tag_pose(Tag(7, hidden, 0.2), None, LENS, SIDE, NOISE) is None
    assert TagFollower(NOISE).poses([Tag(7, hidden, 0.2)], None, LENS, [SIDE], 0.0) == [None]
