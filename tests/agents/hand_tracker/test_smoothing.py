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


def test_the_weight_of_a_sample() -> None:
    assert weight(1.0, 1.0 / (2.0 * math.pi)) == pytest.approx(0.5)
