"""Trajectories: at rest at both ends, within the limits, on the path."""

from __future__ import annotations

import numpy as np
import pytest

from agents.arm_controller.motion.trajectory import PERIOD, SPACING, MotionLimits, Trajectory, resampled, rounded, timed

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


@pytest.mark.parametrize("seed", range(20))
def test_limits_hold_and_both_ends_are_at_rest(seed: int) -> None:
    rng = np.random.default_rng(seed)
    path = rounded(resampled(rng.uniform(-1.0, 1.0, (4, 3))), 8, 0, 0)
    limits = MotionLimits(rng.uniform(0.1, 1.0), 3.0, rng.uniform(20.0, 200.0))
    trajectory = timed(path, LIMITS, limits)
    assert trajectory.times[0] == 0.0 and np.diff(trajectory.times) == pytest.approx(PERIOD)
    velocities, accelerations, jerks = derivatives(trajectory)
    assert (np.abs(velocities) <= LIMITS * limits.speed * (1 + 1e-9)).all()
    assert np.abs(accelerations).max() <= limits.acceleration * (1 + 1e-9)
    assert np.abs(jerks).max() <= limits.jerk * (1 + 1e-9)
    assert trajectory.positions[0] == pytest.approx(path[0]) and trajectory.positions[-1] == pytest.approx(path[-1])


@pytest.mark.parametrize("seed", range(5))
def test_a_trajectory_hardly_leaves_its_path(seed: int) -> None:
    path = rounded(resampled(np.random.default_rng(seed).uniform(-1.0, 1.0, (4, 3))), 8, 0, 0)
    trajectory = timed(path, LIMITS, MotionLimits(1.0, 5.0, 100.0))
    away = [np.abs(_nearest(row, path)).max() for row in trajectory.positions]
    assert max(away) < 0.003  # rad: 3 mm at 1 m


def _nearest(row: np.ndarray, path: np.ndarray) -> np.ndarray:
    """From a row to the nearest point of a polyline."""
    starts, ways = path[:-1], np.diff(path, axis=0)
    share = np.clip(((row - starts) * ways).sum(axis=1) / (ways**2).sum(axis=1), 0.0, 1.0)
    away = starts + share[:, None] * ways - row
    return away[np.abs(away).max(axis=1).argmin()]


def derivatives(trajectory: Trajectory) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Velocities, accelerations and jerks, from rest to rest."""
    rows = trajectory.positions
    velocities = np.diff(rows, axis=0, prepend=rows[:1], append=rows[-1:]) / PERIOD
    accelerations = np.diff(velocities, axis=0) / PERIOD
    return velocities, accelerations, np.diff(accelerations, axis=0) / PERIOD


def test_a_straight_way_takes_as_long_as_a_trapezoid_and_the_window() -> None:
    path = resampled(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    trajectory = timed(path, LIMITS, MotionLimits(1.0, 2.0, 40.0))
    wanted = 1.0 / 0.7 + 0.7 / 2.0 + 2 * 2.0 / 40.0
    assert trajectory.duration == pytest.approx(wanted, abs=3 * PERIOD)  # each part is rounded up


@pytest.mark.parametrize("length", [0.0, 1e-9, 1e-4])
def test_no_way_at_all_takes_next_to_no_time(length: float) -> None:
    path = resampled(np.array([[0.3, 0.0, 0.0], [0.3 + length, 0.0, 0.0]]))
    trajectory = timed(path, LIMITS, MotionLimits(1.0, 2.0, 40.0))
    assert 0.0 < trajectory.duration < 0.2
    assert trajectory.positions[-1].tolist() == [0.3 + length, 0.0, 0.0]
