"""Tags from picture to picture: found anew where something changed, kept where nothing did."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from agents.scene_estimator import search
from agents.scene_estimator.detection import APRILTAG_STD, Tag, TagDetector
from agents.scene_estimator.reading import Grey
from agents.scene_estimator.search import BLOCK, PERIOD, TagSearch, changed_blocks
from benchmarks.tag_camera import Camera
from dsr import Pose

FACING = (1.0, 0.0, 0.0, 0.0)
LEFT, RIGHT = (Pose((x, 0.0, 0.5), FACING) for x in (-0.12, 0.12))
FRAME = 0.1
"""s between two pictures"""
Shown = Callable[[dict[int, Pose]], np.ndarray]


@pytest.fixture
def shown(camera: Camera, rng: np.random.Generator) -> Shown:
    """Pictures of cubes, each with noise of its own."""
    return lambda cubes: camera.frame(cubes, rng).arrays["color"]


@pytest.fixture
def searched(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many pixels each search looked at."""
    sizes: list[int] = []

    class Counting(TagDetector):
        def search(self, grey: Grey, longest: int, times: int = 1) -> list[Tag]:
            sizes.append(grey.size)
            return super().search(grey, longest, times)

    monkeypatch.setattr(search, "TagDetector", Counting)
    return sizes


def ids(tags: list[Tag]) -> list[int]:
    return [tag.marker_id for tag in tags]


def test_what_looks_as_before_is_not_searched(shown: Shown, searched: list[int]) -> None:
    finder = TagSearch()
    first = finder.find(shown({3: LEFT, 4: RIGHT}), 0.0)
    assert searched == [480 * 640]
    again = finder.find(shown({3: LEFT, 4: RIGHT}), FRAME)
    assert searched == [480 * 640]
    assert all(one is other for one, other in zip(again, first, strict=True))
    assert ids(finder.find(shown({3: LEFT, 4: RIGHT}), PERIOD)) == [3, 4]
    assert searched == [480 * 640] * 2


def test_what_comes_goes_and_moves_is_seen_in_the_next_picture(shown: Shown, searched: list[int]) -> None:
    """And little else is searched for it."""
    finder = TagSearch()
    finder.find(shown({3: LEFT}), 0.0)
    assert ids(finder.find(shown({3: LEFT, 4: RIGHT}), 1 * FRAME)) == [3, 4]
    moved = Pose((0.121, 0.0, 0.5), FACING)
    color = shown({3: LEFT, 4: moved})
    kept, found = finder.find(color, 2 * FRAME)
    alone = TagDetector().detect(color)
    assert np.abs(found.corners - alone[1].corners).max() < 0.02
    assert ids(finder.find(shown({3: LEFT}), 3 * FRAME)) == [3]
    assert max(searched[1:]) < 480 * 640 / 4
    assert kept.marker_id == 3


def test_small_tags_are_found_and_followed(shown: Shown) -> None:
    """12 px wide, at 1.6 m."""
    finder = TagSearch()
    for step in range(12):
        far = Pose((-0.15 + 0.006 * step, 0.1, 1.6), FACING)
        assert ids(finder.find(shown({3: far}), step * FRAME)) == [3]


def test_a_tag_that_was_half_covered_is_found_as_soon_as_it_is_not(shown: Shown) -> None:
    """Only half of it changes then."""
    finder = TagSearch()
    finder.find(shown({3: LEFT}), 0.0)
    covered = shown({3: LEFT, 4: RIGHT})
    middle = int(TagDetector().detect(covered)[1].corners[:, 0].mean())
    covered[:, middle:] = 120
    assert ids(finder.find(covered, FRAME)) == [3]
    assert ids(finder.find(shown({3: LEFT, 4: RIGHT}), 2 * FRAME)) == [3, 4]


@pytest.mark.parametrize("others", [{}, {4: Pose((0.2, 0.1, 0.9), FACING)}, {4: Pose((0.09, 0.0, 0.5), FACING)}])
def test_a_tag_larger_than_all_that_are_known_is_found_as_well(shown: Shown, others: dict[int, Pose]) -> None:
    """Whatever part of it is uncovered last."""
    whole = shown({3: Pose((-0.05, 0.0, 0.3), FACING), **others})
    corners = next(tag.corners for tag in TagDetector().detect(whole) if tag.marker_id == 3)
    (left, _), (right, lower) = corners.min(axis=0).astype(int), corners.max(axis=0).astype(int)
    for rows, columns in ((slice(lower - 20, lower + 10), slice(left, right)), (slice(None), slice(right - 20, right))):
        covered = whole.copy()
        covered[rows, columns] = 120
        finder = TagSearch()
        for number in range(2):
            assert ids(finder.find(covered, FRAME * number)) == list(others)
        assert ids(finder.find(whole, 2 * FRAME)) == [3, *others]


def test_a_tag_that_creeps_is_not_left_behind(shown: Shown) -> None:
    """However slowly: its corners are never off by more than they are anyway."""
    finder, detector = TagSearch(), TagDetector()
    for number in range(30):
        color = shown({3: Pose((2e-5 * number, 0.0, 0.5), FACING)})  # 0.024 px a picture
        (tag,), (fresh,) = finder.find(color, FRAME * number), detector.detect(color)
        assert np.abs(tag.corners - fresh.corners).mean() < 2 * APRILTAG_STD


def test_all_are_found_where_all_move(shown: Shown) -> None:
    finder = TagSearch()
    places = [(0.1 * column - 0.2, 0.1 * row - 0.1, 0.6) for row in range(3) for column in range(5)]
    for number in range(3):
        cubes = {marker: Pose((x + 0.01 * number, y, z), FACING) for marker, (x, y, z) in enumerate(places)}
        color = shown(cubes)
        found, alone = finder.find(color, FRAME * number), TagDetector().detect(color)
        assert ids(found) == ids(alone) == list(cubes)
        assert np.abs([one.corners - other.corners for one, other in zip(found, alone, strict=True)]).max() < 0.05


def test_an_id_that_comes_a_second_time_is_left_out_from_then_on(shown: Shown) -> None:
    finder = TagSearch()
    one = shown({3: LEFT})
    both = np.hstack([one[:, :320], shown({3: RIGHT})[:, 320:]])
    assert ids(finder.find(one, 0.0)) == [3]
    assert ids(finder.find(both, FRAME)) == []
    assert ids(finder.find(one, 2 * FRAME)) == [3]


def test_a_copy_that_comes_and_goes_while_all_moves_leaves_nothing_behind(shown: Shown) -> None:
    finder = TagSearch()
    for number in range(16):
        left, right = (Pose((x + 5e-4 * number, 0.0, 0.5), FACING) for x in (-0.12, 0.12))
        color, has_copy = shown({3: left}), number in (1, 2)
        if has_copy:
            color = np.hstack([color[:, :320], shown({3: right})[:, 320:]])
        assert ids(finder.find(color, FRAME * number)) == ([] if has_copy else [3])


def test_known_tags_that_move_a_little_are_read_without_a_search(shown: Shown, searched: list[int]) -> None:
    finder = TagSearch()
    for number in range(9):
        color = shown({3: Pose((3e-4 * number, 0.0, 0.5), FACING)})
        found, alone = finder.find(color, FRAME * number), TagDetector().detect(color)
        assert ids(found) == [3]
        assert np.abs(found[0].corners - alone[0].corners).max() < 0.1
    assert searched == [480 * 640]


def test_known_tags_that_move_far_are_read_where_their_speeds_bring_them(
    shown: Shown, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And where they were once they stop. Only where they were before is searched: others may be there."""
    finder, ways = TagSearch(), (0.0, 0.01, 0.02, 0.03, 0.03, 0.03)
    for number, way in enumerate(ways):
        if number == 2:
            monkeypatch.setattr(TagDetector, "search", lambda *_: [])
        assert ids(finder.find(shown({3: LEFT @ Pose((way, 0.0, 0.0))}), FRAME * number)) == [3]


def test_tags_that_swap_their_places_or_are_replaced_are_told_by_their_bits(shown: Shown) -> None:
    finder = TagSearch()
    first = finder.find(shown({3: LEFT, 4: RIGHT}), 0.0)
    swapped = finder.find(shown({4: LEFT, 3: RIGHT}), FRAME)
    assert ids(swapped) == [3, 4]
    for now, before in zip(swapped, reversed(first), strict=True):
        assert np.abs(now.corners - before.corners).max() < 0.1
    assert ids(finder.find(shown({4: LEFT, 9: RIGHT}), 2 * FRAME)) == [4, 9]
    assert ids(finder.find(shown({9: RIGHT}), 3 * FRAME)) == [9]


def test_a_new_tag_beside_one_that_moves_is_found_at_once(shown: Shown) -> None:
    """Also one that stands so near that it reaches into the surroundings of the known one."""
    finder = TagSearch()
    finder.find(shown({3: LEFT}), 0.0)
    beside = LEFT @ Pose((0.042, 0.0, 0.0))
    assert ids(finder.find(shown({3: LEFT @ Pose((0.0, 0.0005, 0.0)), 4: beside}), FRAME)) == [3, 4]


def test_a_hand_over_a_tag_hides_it_at_once_and_another_picture_size_begins_anew(shown: Shown) -> None:
    finder = TagSearch()
    whole = shown({3: LEFT, 4: RIGHT})
    finder.find(whole, 0.0)
    hidden = whole.copy()
    corners = TagDetector().detect(whole)[1].corners
    (left, upper), (right, lower) = corners.min(axis=0).astype(int), corners.max(axis=0).astype(int)
    hidden[(upper + lower) // 2 : lower + 20, left:right] = (200, 150, 130)
    assert ids(finder.find(hidden, FRAME)) == [3]
    assert ids(finder.find(whole, 2 * FRAME)) == [3, 4]
    assert ids(finder.find(whole[:, :320].copy(), 3 * FRAME)) == [3]


@pytest.mark.parametrize("stamp", [-1.0, 0.0])
def test_after_a_step_back_in_time_all_is_searched(shown: Shown, searched: list[int], stamp: float) -> None:
    finder = TagSearch()
    for at in (0.0, stamp):
        finder.find(shown({3: LEFT}), at)
    assert searched == [480 * 640] * 2


@pytest.mark.parametrize(("std", "share"), [(5.0, 0.0), (7.0, 0.2), (9.0, 0.9)])
def test_noise_of_more_than_seven_grey_levels_is_change(rng: np.random.Generator, std: float, share: float) -> None:
    one, other = (np.rint(120.0 + rng.normal(0.0, std, (480, 640))).astype(np.uint8) for _ in range(2))
    assert changed_blocks(one, other).mean() == pytest.approx(share, abs=0.15)


@pytest.mark.parametrize("shape", [(1, 1), (3, 201), (203, 3), (120, 160)])
def test_noise_alone_is_no_change_and_one_edge_is(rng: np.random.Generator, shape: tuple[int, int]) -> None:
    plain = np.full(shape, 120.0)
    one, other = (np.rint(plain + rng.normal(0.0, 2.0, shape)).astype(np.uint8) for _ in range(2))
    changed = changed_blocks(one, other)
    assert changed.shape == tuple(-(-side // BLOCK) for side in shape)
    assert changed.mean() < 0.01 or min(shape) < BLOCK
    assert not changed_blocks(one, one).any()
    if min(shape) > 4 * BLOCK:
        other[3 * BLOCK : 4 * BLOCK, 3 * BLOCK] = 200
        assert np.argwhere(changed_blocks(one, other)).tolist() == [[3, 3]]


def test_boxes_that_blocks_reach_into_are_told_at_once(rng: np.random.Generator) -> None:
    """Boxes partly or wholly outside as well."""
    blocks = rng.random((12, 16)) < 0.05
    low = rng.integers(-6, 18, (300, 2))
    boxes = np.hstack([low, low + rng.integers(0, 6, (300, 2))])
    assert search._reach(blocks, boxes).tolist() == [bool(search._part(blocks, box).any()) for box in boxes]
