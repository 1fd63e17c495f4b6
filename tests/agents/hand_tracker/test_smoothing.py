"""Filters smooth at rest and follow in motion."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agents.hand_tracker.config import Smoothing
from agents.hand_tracker.sighting import hand_of_landmarks
from agents.hand_tracker.tracks import PointFilter, TurnFilter, weight
from dsr.math3d import quaternions

PERIOD = 0.1


def test_noise_is_less_at_rest() -> None:
    rng = np.random.default_rng(0)
    filter_ = PointFilter(Smoothing(), np.zeros(3), 0.0)
    smooth = [filter_.update(rng.normal(0.0, 0.003, 3), k * PERIOD) for k in range(1, 400)]
    assert np.std(smooth[20:]) < 0.8 * 0.003


@pytest.mark.parametrize("speed", [0.1, 0.4])
def test_motion_is_followed_with_little_lag(speed: float) -> None:
    filter_ = PointFilter(Smoothing(), np.zeros(3), 0.0)
    for k in range(1, 30):
        filter_.update(np.array([speed * k * PERIOD, 0.0, 0.0]), k * PERIOD)
    lag = speed * 29 * PERIOD - filter_.point[0]
    assert 0.0 <= lag < 0.005


def test_samples_that_are_not_newer_change_nothing() -> None:
    filter_ = PointFilter(Smoothing(), np.zeros(3), 1.0)
    assert filter_.update(np.ones(3), 1.0).tolist() == [0.0, 0.0, 0.0]
    turn = TurnFilter(Smoothing(), (0.0, 0.0, 0.0, 1.0), 1.0)
    assert turn.update(quaternions.from_rotvec((0.0, 0.0, 1.0)), 0.5) == (0.0, 0.0, 0.0, 1.0)


def test_turns_are_followed() -> None:
    turn = TurnFilter(Smoothing(), (0.0, 0.0, 0.0, 1.0), 0.0)
    for k in range(1, 40):
        turn.update(quaternions.from_rotvec((0.0, 0.0, min(0.1 * k, 1.0))), k * PERIOD)
    assert quaternions.to_rotvec(turn.rotation)[2] == pytest.approx(1.0, abs=0.01)


def test_little_is_taken_of_a_turn_that_a_sample_tells_badly() -> None:
    turn = TurnFilter(Smoothing(), (0.0, 0.0, 0.0, 1.0), 0.0)
    badly_about_x = np.diag([0.7**2, 0.01**2, 0.01**2])
    for k in range(1, 4):
        turn.update(quaternions.from_rotvec((0.5, 0.0, 0.5)), k * PERIOD, badly_about_x)
    x, _, z = quaternions.to_rotvec(turn.rotation)
    assert x < 0.05
    assert z > 0.3


def test_landmarks_on_a_line_tell_no_turn_about_it() -> None:
    points, seen = np.zeros((21, 3)), np.zeros(21, dtype=bool)
    points[[5, 9, 13]] = [[0.0, 0.02, 0.5], [0.001, 0.0, 0.5], [0.0, -0.02, 0.5]]
    seen[[5, 9, 13]] = True
    hand = hand_of_landmarks(points, seen, "right", 0.003)
    assert hand is not None
    assert hand.turn_covariance is not None
    deviations = np.sqrt(np.diag(hand.turn_covariance))
    assert deviations[1] > 0.7
    assert deviations[[0, 2]].max() < 0.15


def test_a_shape_turns_landmarks_on_a_line_about_it() -> None:
    """A palm that is inclined by 0.6 rad about its knuckles, of which a network tells 0.3."""
    palm = np.array([[-0.068, 0.004, 0.0], [0.02, 0.028, 0.0], [0.022, 0.008, 0.0], [0.016, -0.013, 0.0]])
    seen, points, shape = np.zeros(21, dtype=bool), np.zeros((21, 3)), np.zeros((21, 3))
    landmarks = [0, 5, 9, 13]
    for angle, into in ((0.6, points), (0.3, shape)):
        into[landmarks] = palm @ np.array(quaternions.to_matrix(quaternions.from_rotvec((0.0, angle, 0.0)))).T
        into[17] = into[13] + (into[13] - into[9])
    points[:, 2] += 0.5
    truth = quaternions.from_rotvec((0.0, 0.6, 0.0))
    seen[[5, 9, 13]] = True
    without, line = (hand_of_landmarks(points, seen, "right", 0.005, told) for told in (None, shape))
    seen[0] = True
    whole = hand_of_landmarks(points, seen, "right", 0.005, shape)
    assert without is not None and line is not None and whole is not None
    off = [
        math.hypot(*quaternions.to_rotvec(quaternions.product(hand.palm.q, quaternions.conjugate(truth))))
        for hand in (line, whole)
    ]
    assert off[0] < 0.4
    assert off[1] < 0.1
    sigmas = [math.sqrt(np.linalg.norm(np.array(hand.turn_covariance), 2)) for hand in (without, line, whole)]
    assert sigmas[2] < 0.2
    assert 0.3 < sigmas[1] < 0.5
    assert sigmas[0] > 0.6


def test_guesses_do_not_become_sure_by_repetition() -> None:
    turn = TurnFilter(Smoothing(), (0.0, 0.0, 0.0, 1.0), 0.0, 0.5**2 * np.eye(3))
    for k in range(1, 40):
        turn.update((0.0, 0.0, 0.0, 1.0), k * PERIOD, 0.5**2 * np.eye(3))
    turn.update(quaternions.from_rotvec((0.0, 0.0, 1.0)), 40 * PERIOD, 0.05**2 * np.eye(3))
    assert quaternions.to_rotvec(turn.rotation)[2] > 0.9


def test_a_rotation_that_is_known_stays_while_it_is_guessed_otherwise() -> None:
    turn = TurnFilter(Smoothing(), (0.0, 0.0, 0.0, 1.0), 0.0, 0.05**2 * np.eye(3))
    for k in range(1, 20):
        turn.update(quaternions.from_rotvec((0.0, 0.0, 1.8)), k * PERIOD, 0.9**2 * np.eye(3))
    assert abs(quaternions.to_rotvec(turn.rotation)[2]) < 0.05


def test_the_weight_of_a_sample() -> None:
    assert weight(1.0, 1.0 / (2.0 * math.pi)) == pytest.approx(0.5)
