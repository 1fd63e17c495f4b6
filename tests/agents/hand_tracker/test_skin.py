"""The degraded mode on pixels: where palms and fingertips are seen, and what is no hand."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import numpy as np
import pytest

from agents.hand_tracker import HandTrackerConfig
from agents.hand_tracker.config import SkinModel
from agents.hand_tracker.depth import images_with_depth
from agents.hand_tracker.sighting import SeenHand
from agents.hand_tracker.skin import SkinFinder, jumps, skin
from agents.plant.reality import Reality
from agents.scenario.format.scenario import HandEnter, HandGraspEvent, ObjectSpec

from .conftest import palm_of, table_plane, tips_of

MakeReality = Callable[..., Reality]
CUBES = [
    ObjectSpec(name=f"cube_{k}", marker_id=k, position=(0.2 + 0.06 * (k % 3), 0.25 * (k // 3) - 0.25, 0.02))
    for k in range(9)
]


def see(reality: Reality) -> tuple[list[SeenHand], list[np.ndarray]]:
    """Hands seen, and true landmarks, in the camera's frame."""
    pose = reality.camera.pose
    hands = SkinFinder(HandTrackerConfig()).find(reality.frame(0.0), table_plane(pose))
    truth = [pose.inverse().apply(np.array(points)) for points in reality.truth(0.0).hands.values()]
    return hands, truth


def test_open_hands_are_seen_to_millimetres(make_reality: MakeReality) -> None:
    """At six places: 95 % of the fingertips within 10 mm, four of five of them seen."""
    errors, palms, count = [], [], 0
    for x in (0.36, 0.42):
        for height in (0.09, 0.14, 0.2):
            reality = make_reality(1.6, events=[HandEnter(at=0.0, position=(x, 0.02, height), side=(1.0, 0.3))])
            (hand,), (truth,) = see(reality)
            palms.append(np.linalg.norm(hand.palm.translation - palm_of(truth)))
            errors += [np.linalg.norm(tips_of(truth) - tip, axis=1).min() for tip in hand.tips.values()]
            count += len(hand.tips)
            reality.close()
    assert count >= 24
    assert np.median(errors) < 0.005 and np.quantile(errors, 0.95) < 0.010
    assert np.median(palms) < 0.008 and max(palms) < 0.02


def test_thumb_and_index_finger_are_seen_at_what_they_hold(make_reality: MakeReality) -> None:
    cube = ObjectSpec(name="cube_3", marker_id=3, position=(0.33, 0.0, 0.02))
    reality = make_reality(3.0, events=[HandGraspEvent(at=0.0, object="cube_3")], objects=[cube])
    assert reality.truth(0.0).grasped
    (hand,), (truth,) = see(reality)
    for finger in (0, 1):
        assert min(np.linalg.norm(tip - tips_of(truth)[finger]) for tip in hand.tips.values()) < 0.010


@pytest.mark.parametrize("finger", [1, 2, 3])
def test_a_finger_that_something_in_front_cuts_off_has_no_tip_there(make_reality: MakeReality, finger: int) -> None:
    reality = make_reality(1.6, events=[HandEnter(at=0.0, position=(0.38, 0.02, 0.14), side=(1.0, 0.3))])
    frame, table, pose = reality.frame(0.0), table_plane(reality.camera.pose), reality.camera.pose
    (landmarks,) = reality.truth(0.0).hands.values()
    lens = images_with_depth(frame)[2]
    joints = pose.inverse().apply(np.array(landmarks)[[4 * finger + 3, 4 * finger + 4]])
    before, tip = joints[:, :2] / joints[:, 2:] * (lens.fx, lens.fy) + (lens.cx, lens.cy)
    along = (tip - before) / np.linalg.norm(tip - before)
    v, u = np.indices(frame.arrays["depth"].shape)
    beyond = (np.stack([u, v], axis=-1) - before) @ along

    def ends(color: np.ndarray, depth: np.ndarray) -> np.ndarray:
        cut = msgspec.structs.replace(frame, arrays={**frame.arrays, "color": color, "depth": depth})
        (hand,) = SkinFinder(HandTrackerConfig()).find(cut, table)
        points = np.array(list(hand.tips.values())).reshape(-1, 3)
        return (points[:, :2] / points[:, 2:] * (lens.fx, lens.fy) + (lens.cx, lens.cy) - before) @ along

    color, depth = frame.arrays["color"].copy(), frame.arrays["depth"].copy()
    assert (ends(color, depth) > 0.0).any()
    color[beyond > 0.0] = 90
    depth[beyond > 0.0] = 0.25
    radius = 0.008 * lens.fx / joints[0, 2]
    assert not (np.abs(ends(color, depth)) < 2.0 * radius).any()


@pytest.mark.parametrize("unknown", [np.nan, np.inf, -np.inf, -1.0])
def test_what_a_camera_says_for_a_depth_that_it_does_not_know_says_nothing(
    make_reality: MakeReality, unknown: float
) -> None:
    reality = make_reality(1.6, events=[HandEnter(at=0.0, position=(0.38, 0.02, 0.14), side=(1.0, 0.3))])
    frame, table = reality.frame(0.0), table_plane(reality.camera.pose)
    holes = np.random.default_rng(0).random(frame.arrays["depth"].shape) < 0.2

    def seen(value: float) -> SeenHand:
        depth = np.where(holes, np.float32(value), frame.arrays["depth"])
        holed = msgspec.structs.replace(frame, arrays={**frame.arrays, "depth": depth})
        (hand,) = SkinFinder(HandTrackerConfig()).find(holed, table)
        return hand

    assert seen(unknown).palm.distance(seen(0.0).palm) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_cubes_and_the_table_are_no_hands(make_reality: MakeReality) -> None:
    reality = make_reality(0.1, objects=CUBES, events=[HandEnter(at=50.0, position=(0.4, 0.0, 0.1))])
    assert see(reality) == ([], [])


def test_the_colour_of_skin_does_not_depend_on_the_light() -> None:
    bright, dark, grey = (224, 166, 138), (134, 99, 82), (150, 150, 150)
    table, red, yellow = (158, 133, 102), (204, 82, 71), (217, 168, 61)
    row = np.array([[colour] * 7 for colour in (bright, dark, grey, table, red, yellow)], np.uint8).reshape(1, -1, 3)
    image = np.repeat(row, 9, axis=0)
    assert skin(image, SkinModel())[4, 3::7].tolist() == [True, True, False, False, False, False]


def test_a_band_of_hues_may_pass_through_red() -> None:
    pink = np.full((9, 9, 3), (220, 150, 160), np.uint8)
    assert not skin(pink, SkinModel())[4, 4]
    assert skin(pink, SkinModel(hue=(340.0, 20.0)))[4, 4]


@pytest.mark.parametrize(("step", "split"), [(0.05, True), (0.01, False)])
def test_hands_in_front_of_each_other_are_two(step: float, split: bool) -> None:
    depth = np.full((20, 20), 0.5, np.float32)
    depth[:, 10:] += np.float32(step)
    mask = np.ones(depth.shape, bool)
    assert jumps(depth, mask).any() == split
    depth[:, 10:] = 0.0
    assert not jumps(depth, mask).any()
