"""Hands that the model loses go on with their outlines while these are whole, and no longer."""

from __future__ import annotations

import numpy as np
import pytest

from agents.hand_tracker.config import HandTrackerConfig
from agents.hand_tracker.fingertips import Patch
from agents.hand_tracker.going_on import GoingOn
from agents.hand_tracker.sighting import Outline, SeenHand
from agents.hand_tracker.skin import is_cut
from agents.hand_tracker.tracks import Tracks
from dsr.math3d.transforms import Pose

AREA = 0.009


def by_model(x: float) -> SeenHand:
    return SeenHand(Pose((x, 0.0, 0.6)), {1: np.array((x, 0.1, 0.6))}, True, "right", 0.005)


def outline(x: float, area: float = AREA) -> SeenHand:
    """Its palm is taken to be 20 mm beside the true one."""
    middle = np.array((x, 0.02, 0.6))
    tip = np.array((x, 0.1, 0.6))
    return SeenHand(Pose(middle), {0: tip}, False, "unknown", 0.004, None, 0.013, True, Outline(middle, area))


def test_a_hand_that_the_model_loses_goes_on_where_its_outline_is() -> None:
    hands = GoingOn()
    assert hands.update([by_model(0.0)], [outline(0.0)], 1.0) == []
    for k in range(1, 30):
        (hand,) = hands.update([], [outline(0.02 * k), outline(2.0)], 1.0 + 0.1 * k)
        assert hand.palm.translation == pytest.approx((0.02 * k, 0.0, 0.6))
        assert not hand.begins
        assert hand.tips == {}
        assert len(hand.outlined) == 1
    assert hands.update([by_model(0.6)], [outline(0.6)], 4.0) == []


@pytest.mark.parametrize("share", [0.6, 1.5])
def test_an_outline_of_another_size_is_not_the_whole_hand(share: float) -> None:
    hands = GoingOn()
    hands.update([by_model(0.0)], [outline(0.0)], 1.0)
    assert hands.update([], [outline(0.0, share * AREA)], 1.1) == []
    assert len(hands.update([], [outline(0.0)], 1.2)) == 1


def test_an_outline_elsewhere_or_long_after_is_another_thing() -> None:
    hands = GoingOn()
    hands.update([by_model(0.0)], [outline(0.0)], 1.0)
    assert hands.update([], [outline(0.4)], 1.1) == []
    assert hands.update([], [], 2.5) == []
    assert not hands.waits
    assert hands.update([], [outline(0.0)], 2.6) == []


def test_the_outline_of_one_hand_is_not_another_hand() -> None:
    hands = GoingOn()
    hands.update([by_model(0.0), by_model(0.3)], [outline(0.0), outline(0.3)], 1.0)
    assert hands.update([by_model(0.05)], [outline(0.05)], 1.1) == []


def test_an_outline_alone_begins_no_track() -> None:
    tracks, hand = Tracks(HandTrackerConfig()), by_model(0.0)
    tracks.update([hand._replace(palm=hand.palm.with_stamp(1.0), begins=False)], "mediapipe", 1.0)
    assert not tracks.by_number
    tracks.update([hand._replace(palm=hand.palm.with_stamp(1.1))], "mediapipe", 1.1)
    moved = Pose((0.03, 0.0, 0.6), stamp=1.2)
    tracks.update([hand._replace(palm=moved, tips={}, begins=False)], "mediapipe", 1.2)
    assert tracks.by_number[0].last_seen == 1.2


@pytest.mark.parametrize(
    ("depth", "columns", "cut"),
    [
        (0.4, slice(330, 400), True),  # in front, over the fingers' side
        (0.8, slice(330, 400), False),  # behind
        (0.4, slice(400, 450), False),  # in front, elsewhere in the image
        (0.0, slice(330, 400), False),  # unknown
    ],
)
def test_a_hand_along_something_in_front_of_it_is_cut(depth: float, columns: slice, cut: bool) -> None:
    image = np.full((480, 640), 0.65, np.float32)
    image[200:260, 250:330] = 0.6
    image[150:300, columns] = depth
    patch = Patch((250, 200), np.ones((60, 80), bool), 0.6)
    assert is_cut(patch, image, 600.0) is cut


def test_a_hand_at_the_edge_of_the_image_is_cut() -> None:
    image = np.full((480, 640), 0.6, np.float32)
    assert is_cut(Patch((560, 200), np.ones((60, 80), bool), 0.6), image, 600.0)
    assert not is_cut(Patch((550, 200), np.ones((60, 80), bool), 0.6), image, 600.0)
