"""Joint motion: within limits, smooth, and exactly to its goal."""

from __future__ import annotations

import numpy as np
import pytest

from agents.joint_ramp import ACCELERATION, CATCH_UP, JERK, Ramp

STEP = 1 / 240
LIMITS = (1.4, 0.5)


def run(ramp: Ramp, steps: int) -> np.ndarray:
    positions = []
    for _ in range(steps):
        ramp.step()
        positions.append(ramp.positions.copy())
    return np.array(positions)


@pytest.mark.parametrize("speed", [1.0, 0.3])
def test_stays_within_limits_and_arrives_exactly(speed: float) -> None:
    ramp = Ramp((0.0, 1.0), LIMITS, STEP)
    ramp.aim((1.0, 0.7), speed)
    positions = np.vstack([[0.0, 1.0], run(ramp, 1200)])
    velocities = np.diff(positions, axis=0) / STEP
    assert (np.abs(velocities) <= np.array(LIMITS) * speed + 1e-9).all()
    assert (np.abs(np.diff(velocities, axis=0)) <= ACCELERATION * STEP + 1e-9).all()
    assert positions[-1].tolist() == [1.0, 0.7]


def test_from_rest_the_way_is_straight() -> None:
    ramp = Ramp((0.0, 0.0), LIMITS, STEP)
    ramp.aim((1.0, 0.25))
    positions = run(ramp, 480)
    assert positions[:, 1] == pytest.approx(positions[:, 0] / 4, abs=2e-3)
    assert positions[-1].tolist() == [1.0, 0.25]


@pytest.mark.parametrize("seed", range(10))
def test_arrives_wherever_it_is_sent_on_its_way(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ramp = Ramp((0.0, 0.0), LIMITS, STEP)
    for _ in range(5):
        target = rng.uniform(-1, 1, 2) if rng.random() < 0.7 else ramp.positions.copy()
        ramp.aim(target, speed=rng.uniform(0.2, 1.0))
        run(ramp, int(rng.integers(1, 200)))
    run(ramp, 240 * 20)
    assert ramp.positions == pytest.approx(target, abs=1e-9)
    assert ramp.velocities == pytest.approx(0.0, abs=1e-9)


def test_turns_round_without_a_jump() -> None:
    ramp = Ramp((0.0, 0.0), LIMITS, STEP)
    ramp.aim((1.0, 0.0))
    run(ramp, 100)
    ramp.aim((0.0, 0.0))
    velocities = np.diff(run(ramp, 600), axis=0) / STEP
    assert (np.abs(np.diff(velocities, axis=0)) <= ACCELERATION * STEP + 1e-9).all()
    assert ramp.positions == pytest.approx((0.0, 0.0), abs=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_stops_within_the_limits_of_acceleration_and_jerk(seed: int) -> None:
    ramp = Ramp((0.0, 0.0), LIMITS, STEP)
    ramp.aim((1.0, 0.1))
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
    ramp.aim((1.0, 0.1))
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


def test_a_trajectory_that_begins_elsewhere_is_caught_up_with_within_the_limits() -> None:
    ramp = Ramp((0.0, 0.0), LIMITS, STEP)
    ramp.follow((0.0, 0.1), [(1.0, 0.0), (1.0, 0.1)])
    positions = np.vstack([[0.0, 0.0], run(ramp, 480)])
    assert (np.abs(np.diff(positions, axis=0)) / STEP <= np.array(LIMITS) * CATCH_UP + 1e-9).all()
    assert positions[-1] == pytest.approx((1.0, 0.1))


@pytest.mark.parametrize("command", ["aim", "stop"])
def test_another_command_ends_a_trajectory(command: str) -> None:
    ramp = Ramp((0.0, 0.0), LIMITS, STEP)
    ramp.follow((0.0, 1.0), [(0.0, 0.0), (0.5, 0.0)])
    run(ramp, 60)
    here = ramp.positions.copy()
    if command == "aim":
        ramp.aim(here)
        assert run(ramp, 240)[-1] == pytest.approx(here, abs=1e-6)
    else:
        ramp.stop()
        braking = 0.5 * 0.5 * (0.5 / ACCELERATION + ACCELERATION / JERK)  # rad of the way from 0.5 rad/s to rest
        assert run(ramp, 240)[-1] == pytest.approx(here + np.array((braking, 0.0)), abs=1e-3)
