"""Trajectories: at rest at both ends, within the limits, on the path."""

from __future__ import annotations

import numpy as np
import pytest

from agents.arm_controller.trajectory import PERIOD, SPACING, resampled, rounded, timed

LIMITS = np.array([0.7, 0.5, 1.2])
CORNER = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.0], [1.0, 0.5, 0.5], [0.2, 0.9, 0.5]])


def test_resampling_keeps_ends_and_corners_and_spaces_evenly() -> None:
    rows = resampled(CORNER)
    assert rows[0].tolist() == CORNER[0].tolist() and rows[-1].tolist() == CORNER[-1].tolist()
    steps = np.abs(np.diff(rows, axis=0)).max(axis=1)
    assert steps.max() <= SPACING + 1e-12
    assert np.median(steps) == pytest.approx(steps.max(), rel=0.01)
    assert np.abs(rows - CORNER[1]).max(axis=1).min() < SPACING


def test_rounding_moves_corners_only() -> None:
    rows = resampled(CORNER)
    smooth = rounded(rows, 6, 0, 20)
    moved = np.abs(smooth - rows).max(axis=1)
    assert moved[-20:].max() < 1e-12 and moved[0] < 1e-12
    assert 0.0 < moved.max() < 6 * SPACING
    bend = [np.abs(np.diff(path, n=2, axis=0)).max() for path in (rows, smooth)]
    assert bend[1] < 0.3 * bend[0]


@pytest.mark.parametrize("seed", range(5))
def test_limits_hold_and_both_ends_are_at_rest(seed: int) -> None:
    rng = np.random.default_rng(seed)
    path = rounded(resampled(rng.uniform(-1.0, 1.0, (4, 3))), 8, 0, 0)
    trajectory = timed(path, LIMITS, 3.0)
    velocity = np.diff(trajectory.positions, axis=0) / np.diff(trajectory.times)[:, None]
    assert trajectory.times[0] == 0.0 and (np.diff(trajectory.times) > 0.0).all()
    assert np.diff(trajectory.times).max() <= PERIOD + 1e-12
    assert (np.abs(velocity) <= LIMITS * 1.02).all()
    assert np.abs(velocity[[0, -1]]).max() < 3.0 * PERIOD
    assert np.abs(np.diff(velocity, axis=0)).max() / PERIOD < 3.0 * 1.8
    assert trajectory.positions[0] == pytest.approx(path[0]) and trajectory.positions[-1] == pytest.approx(path[-1])


def test_a_straight_way_takes_as_long_as_a_trapezoid() -> None:
    trajectory = timed(resampled(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])), LIMITS, 2.0)
    assert trajectory.duration == pytest.approx(1.0 / 0.7 + 0.7 / 2.0, rel=0.02)


@pytest.mark.parametrize("length", [0.0, 1e-9, 1e-4])
def test_no_way_at_all_takes_no_time(length: float) -> None:
    trajectory = timed(resampled(np.array([[0.3, 0.0, 0.0], [0.3 + length, 0.0, 0.0]])), LIMITS, 2.0)
    assert 0.0 < trajectory.duration < 0.1
    assert trajectory.positions[-1].tolist() == [0.3 + length, 0.0, 0.0]
