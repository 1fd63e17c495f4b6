"""Joint motion: within limits, smooth, and exactly to its goal."""

from __future__ import annotations

import numpy as np
import pytest

from agents.joint_ramp import ACCELERATION, ASIDE, CATCH_UP, JERK, Ramp

STEP = 1 / 240
LIMITS = (1.4, 0.5)


def run(ramp: Ramp, steps: int) -> np.ndarray:
    positions = []
    for _ in range(steps):
        ramp.step()
        positions.append(ramp.positions.copy())
    return np.array(positions)


AWAY = (0.0, 1.0), [(0.0, 0.0), (1.0, 0.1)]
"""A trajectory at 1.0 and 0.1 rad/s"""


@pytest.mark.parametrize("seed", range(5))
def test_stops_within_the_limits_of_acceleration_and_jerk(seed: int) -> None:
    ramp = Ramp((0.0, 0.0), LIMITS, STEP)
    ramp.follow(*AWAY)
    before = run(ramp, int(np.random.default_rng(seed).integers(20, 150)))[-3:]
    ramp.stop()
    positions = np.vstack([before, run(ramp, 240)])
    velocities = np.diff(positions, axis=0) / STEP
    accelerations = np.diff(velocities, axis=0) / STEP
    assert (np.abs(accelerations) <= ACCELERATION + 1e-6).all()
    assert (np.abs(np.diff(accelerations, axis=0)) <= JERK * STEP + 1e-6).all()
    assert ramp.is_resting and (positions[-100:] == positions[-1]).all()


def test_an_arm_that_is_held_up_stays_where_it_was_measured() -> None:
    ramp = Ramp((0.0, 0.0), LIMITS, STEP)
    ramp.follow(*AWAY)
    run(ramp, 100)
    ramp.stop((0.1, 0.01), (0.0, 0.0))
    assert run(ramp, 100) == pytest.approx(np.tile((0.1, 0.01), (100, 1)))


def test_a_trajectory_is_passed_through_in_time_and_its_end_is_kept() -> None:
    ramp = Ramp((0.0, 0.0), LIMITS, STEP)
    ramp.follow((0.0, 0.5, 1.0), [(0.0, 0.0), (0.5, 0.1), (0.5, 0.3)])
    positions = run(ramp, 360)
    assert positions[59] == pytest.approx((0.25, 0.05), abs=1e-6)
    assert positions[179] == pytest.approx((0.5, 0.2), abs=1e-6)
    assert positions[-1].tolist() == [0.5, 0.3]
    assert ramp.velocities.tolist() == [0.0, 0.0]


def test_a_trajectory_that_begins_beside_the_arm_is_joined_within_the_limits() -> None:
    ramp = Ramp((0.0, 0.0), LIMITS, STEP)
    ramp.follow((0.0, 3.0), [(ASIDE, -ASIDE), (ASIDE, -ASIDE)])
    positions = np.vstack([np.zeros((3, 2)), run(ramp, 1000)])
    velocities = np.diff(positions, axis=0) / STEP
    accelerations = np.diff(velocities, axis=0) / STEP
    assert (np.abs(velocities) <= (CATCH_UP - 1.0) * np.array(LIMITS) + 1e-9).all()
    assert (np.abs(accelerations) <= ACCELERATION + 1e-6).all()
    assert (np.abs(np.diff(accelerations, axis=0)) <= JERK * STEP + 1e-6).all()
    assert ramp.is_resting and positions[-1].tolist() == [ASIDE, -ASIDE]


def test_a_moving_arm_changes_to_another_trajectory_within_the_limits() -> None:
    ramp = Ramp((0.0, 0.0), LIMITS, STEP)
    ramp.follow(*AWAY)
    before = run(ramp, 60)
    here = ramp.positions
    ramp.follow((0.0, 1.0), [here, here - np.array((0.2, 0.0))])
    positions = np.vstack([before[-4:], run(ramp, 480)])
    accelerations = np.diff(positions[:230], n=2, axis=0) / STEP**2  # until the way ends at once, as it is told
    assert (np.abs(accelerations) <= ACCELERATION + 1e-6).all()
    assert positions[-1] == pytest.approx(here - np.array((0.2, 0.0)))


def test_the_joints_take_the_time_until_the_first_positions() -> None:
    ramp = Ramp((0.0, 0.0), LIMITS, STEP)
    ramp.follow((1.0,), [(0.6, -0.4)])
    positions = run(ramp, 300)
    assert positions[119] == pytest.approx((0.3, -0.2))
    assert positions[-1].tolist() == [0.6, -0.4]


def test_joints_rest_where_they_were_measured() -> None:
    ramp = Ramp((0.0, 0.0), LIMITS, STEP)
    ramp.follow(*AWAY)
    run(ramp, 100)
    ramp.rest((0.2, 0.1))
    assert ramp.is_resting and run(ramp, 10)[-1].tolist() == [0.2, 0.1]


def test_a_stop_ends_a_trajectory() -> None:
    ramp = Ramp((0.0, 0.0), LIMITS, STEP)
    ramp.follow((0.0, 1.0), [(0.0, 0.0), (0.5, 0.0)])
    run(ramp, 60)
    here = ramp.positions.copy()
    ramp.stop()
    braking = 0.5 * 0.5 * (0.5 / ACCELERATION + ACCELERATION / JERK)  # rad of the way from 0.5 rad/s to rest
    assert run(ramp, 240)[-1] == pytest.approx(here + np.array((braking, 0.0)), abs=1e-3)


def test_a_stop_under_way_is_not_begun_anew() -> None:
    ramp = Ramp((0.0, 0.0), LIMITS, STEP)
    ramp.follow(*AWAY)
    run(ramp, 100)
    ramp.stop()
    run(ramp, 20)
    here = ramp.positions.copy()
    ramp.stop((0.0, 0.0), (1.4, 0.5))
    assert ramp.is_braking and ramp.positions == pytest.approx(here)


@pytest.mark.parametrize(
    ("times", "begin", "aside"),
    [
        ((0.0, 1.0), (0.05, -0.05), None),
        ((0.0, 1.0), (0.05, -0.3), (1, 0.3)),
        ((1.0, 2.0), (1.3, 0.4), None),  # there is time to get there
        ((1.0, 2.0), (1.3, 0.8), (1, 0.8)),
    ],
)
def test_a_way_that_begins_out_of_reach_is_told(
    times: tuple[float, ...], begin: tuple[float, float], aside: tuple[int, float] | None
) -> None:
    assert Ramp((0.0, 0.0), LIMITS, STEP).aside(times, [begin, (0.0, 0.0)]) == aside
