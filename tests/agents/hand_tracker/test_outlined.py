"""Fingertips that the outline of a hand shows, beside those that the model guesses."""

from __future__ import annotations

import numpy as np
import pytest

from agents.hand_tracker import HandTrackerConfig
from agents.hand_tracker.landmarker import ModelFinder
from agents.hand_tracker.sighting import TIPS, OutlinedTip, SeenHand, hand_of_landmarks
from agents.hand_tracker.tracks import HandTrack
from dsr.vocabulary.intrinsics import Intrinsics

from .conftest import FLAT_HAND, RECORDED, RecordedLandmarker, picture, tips_of

INDEX, MIDDLE = 1, 2
GUESS = np.array([0.0, 0.0, 0.06])
"""m, that the model has a hidden fingertip too near to the camera"""
PERIOD = 0.1
ROOM = np.full(5, 0.04)
"""m across the view, from an outlined fingertip to each of the model's"""


def seen(stamp: float, *outlined: OutlinedTip, x: float = 0.0) -> SeenHand:
    """The hand, moved by x m, whose index fingertip the model has elsewhere."""
    points = FLAT_HAND + np.array([x, 0.0, 0.0])
    points[TIPS[INDEX]] -= GUESS
    hand = hand_of_landmarks(points, np.ones(21, bool), "right", 0.005)
    assert hand is not None
    return hand._replace(palm=hand.palm.with_stamp(stamp), outlined=outlined)


def outlined(finger: int, near: int, x: float = 0.0) -> OutlinedTip:
    """The true fingertip of a finger, which the model takes to be near another one."""
    across = ROOM.copy()
    across[near] = 0.01
    return OutlinedTip(tips_of(FLAT_HAND)[finger] + (x, 0.0, 0.0), across)


def track_of(*hands: SeenHand) -> HandTrack:
    track = HandTrack(0, HandTrackerConfig(), hands[0].palm, "right", "mediapipe")
    for hand in hands:
        track.update(hand, "mediapipe")
    return track


def off(track: HandTrack, finger: int, x: float = 0.0) -> float:
    """m, from the true place."""
    return float(np.linalg.norm(track.tips[finger].filter.point - tips_of(FLAT_HAND)[finger] - (x, 0.0, 0.0)))


def test_a_fingertip_is_where_the_outline_shows_it_and_not_where_the_model_guesses() -> None:
    assert off(track_of(seen(1.0)), INDEX) == pytest.approx(0.06)
    assert off(track_of(seen(1.0, outlined(INDEX, near=INDEX))), INDEX) < 1e-9


def test_a_finger_keeps_its_name_when_the_model_is_nearer_with_another_and_stays_while_no_outline_is_seen() -> None:
    first = seen(1.0, outlined(INDEX, near=INDEX))
    confused = seen(1.0 + PERIOD, outlined(INDEX, near=MIDDLE, x=0.01), x=0.01)
    track = track_of(first, confused, seen(1.0 + 2 * PERIOD, x=0.01))
    assert off(track, INDEX, x=0.01) < 0.005 and MIDDLE not in track.tips
    assert track.tips[INDEX].last_seen == 1.0 + PERIOD


def test_after_a_while_without_an_outline_the_guess_counts_again() -> None:
    age = HandTrackerConfig().max_age
    track = track_of(seen(1.0, outlined(INDEX, near=INDEX)), *(seen(1.0 + k * PERIOD) for k in range(1, 9)))
    assert age + PERIOD < 8 * PERIOD and track.tips[INDEX].last_seen == 1.0 + 8 * PERIOD
    assert off(track, INDEX) > 0.04


def test_what_is_far_from_all_that_the_model_has_is_no_fingertip_of_the_hand() -> None:
    far = OutlinedTip(tips_of(FLAT_HAND)[INDEX] + (0.0, 0.2, 0.0), np.full(5, 0.2))
    assert off(track_of(seen(1.0, far)), INDEX) == pytest.approx(0.06)


def test_the_finder_tells_the_outlines_fingertips_that_are_near_the_models(monkeypatch: pytest.MonkeyPatch) -> None:
    frame = RECORDED["frames"][0]
    image, truth = picture(frame), tips_of(FLAT_HAND)
    finder = ModelFinder(HandTrackerConfig(), RecordedLandmarker([frame]))
    (plain,) = finder.find(image, None)
    tips = {0: truth[INDEX] + (0.0, 0.002, 0.0), 1: truth[INDEX] + (0.3, 0.0, 0.0)}
    monkeypatch.setattr(finder._skin, "find", lambda *_: [plain._replace(tips=tips)])
    (hand,) = finder.find(image, None)
    (tip,) = hand.outlined
    assert tip.point.tolist() == tips[0].tolist() and int(tip.across.argmin()) == INDEX
    lens = Intrinsics.from_meta(image.meta, image.arrays["color"].shape)
    metres = np.linalg.norm(lens.project(truth) - lens.project(tips[0]), axis=1) * tips[0][2] / lens.fx
    np.testing.assert_allclose(tip.across, metres, atol=0.006)
