"""Percepts that tell no turn of an object, or one about some axes only, teach nothing about the other axes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from dsr import Pose
from dsr.math3d import quaternions
from dsr.math3d.quaternions import ANY_TURN
from simulation_handler.config import BeliefConfig
from simulation_handler.perception.estimate import Estimate, fuse, innovations
from simulation_handler.perception.percepts import SeenObject, WeighedPercept, weighed
from simulation_handler.perception.tracking import Given, PerceptTrack
from simulation_handler.perception.turns import told_axes
from simulation_handler.worlds.parameters import learned_parameters
from simulation_handler.worlds.spread import rotation_covariance

CONFIG = BeliefConfig()
TOLD, UNTOLD, LEAN = 0.02, math.pi, 0.15
HERE = (0.4, 0.1, 0.3)


def percept(turn: Sequence[float], *sigmas: float, at: Sequence[float] = HERE, stamp: float = 0.0) -> WeighedPercept:
    """One with these standard deviations (rad) of its rotation about its own axes."""
    x, y, z = at
    covariance = np.diag((0.002, 0.002, 0.002, *sigmas)) ** 2
    pose = Pose((x, y, z), Pose.from_rotvec((0.0, 0.0, 0.0), turn).q, 0.0, covariance)
    return weighed([SeenObject("box", pose, stamp, (0.0, 0.0, 1.0))], CONFIG)[0]


def take_in(estimate: Estimate, one: WeighedPercept, times: int = 1) -> None:
    for _ in range(times):
        fuse([estimate], [one], innovations([estimate], [one]))


def turned(estimate: Estimate) -> np.ndarray:
    return np.array(quaternions.to_rotvec(estimate.rotation))


def test_a_rotation_that_is_any_one_has_that_variance_about_each_axis() -> None:
    drawn = np.random.default_rng(0).standard_normal((100_000, 4))
    drawn *= np.sign(drawn[:, 3:]) / np.linalg.norm(drawn, axis=1, keepdims=True)  # evenly on half of the sphere
    half = np.arccos(drawn[:, 3:])
    turns = 2.0 * half * drawn[:, :3] / np.sin(half)
    np.testing.assert_allclose(np.cov(turns.T), ANY_TURN * np.eye(3), atol=0.03)


def test_many_percepts_that_tell_no_turn_tell_none_together() -> None:
    estimate = Estimate(percept((0.0, 0.0, 0.0), UNTOLD, UNTOLD, UNTOLD), CONFIG)
    before = estimate.position_covariance
    take_in(estimate, percept((0.0, 0.0, 0.8), UNTOLD, UNTOLD, UNTOLD), 300)
    np.testing.assert_allclose(estimate.rotation_covariance, ANY_TURN * np.eye(3))
    assert turned(estimate).tolist() == [0.0, 0.0, 0.0] and estimate.noise_shares[1] == 1.0
    assert np.trace(estimate.position_covariance) < 0.1 * np.trace(before), "of the place they tell all the same"


def test_a_turn_that_was_told_before_is_not_forgotten_by_percepts_that_tell_none() -> None:
    estimate = Estimate(percept((0.0, 0.0, 0.8), TOLD, TOLD, TOLD), CONFIG)
    take_in(estimate, percept((0.0, 0.0, 0.8), TOLD, TOLD, TOLD), 20)
    before, share = estimate.rotation_covariance.copy(), estimate.noise_shares[1]
    take_in(estimate, percept((0.0, 0.0, 0.0), UNTOLD, UNTOLD, UNTOLD), 2 * CONFIG.window)
    np.testing.assert_allclose(estimate.rotation_covariance, before, rtol=1e-9)
    np.testing.assert_allclose(turned(estimate), (0.0, 0.0, 0.8), atol=1e-6)
    assert estimate.noise_shares[1] == share


@pytest.mark.parametrize("count", [80, 300])
def test_an_average_of_tilts_is_as_far_off_as_its_covariance_tells(count: int) -> None:
    """Of percepts that tell no yaw: also of more than a window's, of which the older ones count less."""
    rng, squares = np.random.default_rng(5), []
    noise = math.sqrt(percept((0.0, 0.0, 0.0), TOLD, TOLD, UNTOLD).rotation_covariance[0, 0])
    for _ in range(40):
        turns = [(*(noise * rng.normal(size=2)).tolist(), 0.0) for _ in range(count)]
        estimate = Estimate(percept(turns[0], TOLD, TOLD, UNTOLD), CONFIG)
        for turn in turns[1:]:
            take_in(estimate, percept(turn, TOLD, TOLD, UNTOLD))
        off, told = turned(estimate)[:2], estimate.rotation_covariance[:2, :2]
        squares.append(off @ np.linalg.inv(told) @ off)
    assert np.mean(squares) == pytest.approx(2.0, rel=0.3)


def test_a_turn_that_is_told_at_last_is_known() -> None:
    estimate = Estimate(percept((0.0, 0.0, 0.0), UNTOLD, UNTOLD, UNTOLD), CONFIG)
    one = percept((0.0, 0.0, 2.5), TOLD, TOLD, TOLD)
    take_in(estimate, one)
    np.testing.assert_allclose(turned(estimate), (0.0, 0.0, 2.5), atol=0.005)
    assert np.trace(estimate.rotation_covariance) == pytest.approx(np.trace(one.rotation_covariance), rel=0.01)


def test_a_tilt_without_yaw_corrects_the_tilt_alone() -> None:
    estimate = Estimate(percept((0.0, 0.0, 2.0), LEAN, LEAN, UNTOLD), CONFIG)
    assert np.diag(estimate.rotation_covariance)[:2].max() < 0.05
    assert estimate.rotation_covariance[2, 2] == pytest.approx(ANY_TURN)
    take_in(estimate, percept((0.1, 0.0, 0.0), LEAN, LEAN, UNTOLD), 50)
    _, _, z, w = estimate.rotation
    upright, yaw = quaternions.rotate(estimate.rotation, (0.0, 0.0, 1.0)), 2.0 * math.atan2(z, w)
    np.testing.assert_allclose(upright, (0.0, -math.sin(0.1), math.cos(0.1)), atol=0.005)
    assert yaw == pytest.approx(2.0, abs=0.02), "nobody has seen that"
    assert (variances := np.linalg.eigvalsh(estimate.rotation_covariance))[1] < 0.002
    assert variances[2] == pytest.approx(ANY_TURN, rel=0.02)


def test_noise_of_the_tilt_tells_no_yaw() -> None:
    estimate, rng = Estimate(percept((0.0, 0.0, 0.0), LEAN, LEAN, UNTOLD), CONFIG), np.random.default_rng(0)
    for x, y in rng.normal(0.0, LEAN, (200, 2)).tolist():
        take_in(estimate, percept((x, y, 0.0), LEAN, LEAN, UNTOLD))
    x, y, _ = quaternions.rotate(estimate.rotation, (0.0, 0.0, 1.0))
    assert (x, y) == pytest.approx((0.0, 0.0), abs=0.05)
    assert estimate.rotation_covariance[2, 2] == pytest.approx(ANY_TURN, rel=0.02)


def test_a_yaw_without_tilt_corrects_the_yaw_alone() -> None:
    estimate = Estimate(percept((0.0, 0.3, 0.0), TOLD, TOLD, TOLD), CONFIG)
    tilt, before = np.trace(estimate.rotation_covariance[:2, :2]), estimate.rotation_covariance[2, 2]
    take_in(estimate, percept((0.0, 0.0, 0.0), UNTOLD, UNTOLD, TOLD), 5)
    assert np.trace(estimate.rotation_covariance[:2, :2]) == pytest.approx(tilt, rel=0.01)
    assert estimate.rotation_covariance[2, 2] < 0.5 * before
    np.testing.assert_allclose(turned(estimate), (0.0, 0.3, 0.0), atol=0.01)


def test_what_has_moved_may_be_turned() -> None:
    track, stamps = PerceptTrack(CONFIG), iter(np.arange(0.1, 100.0, 0.1).tolist())

    def seen(at: Sequence[float], *sigmas: float) -> None:
        for _ in range(20):
            track.add([Given(track, percept((0.0, 0.0, 0.0), *sigmas, at=at, stamp=next(stamps)))])

    seen(HERE, TOLD, TOLD, TOLD)
    seen(HERE, UNTOLD, UNTOLD, UNTOLD)
    assert track.estimate is not None and np.trace(track.estimate.rotation_covariance) < 0.01, "it has stayed"
    seen((0.6, 0.1, 0.3), UNTOLD, UNTOLD, UNTOLD)
    assert track.estimate is not None
    np.testing.assert_allclose(track.estimate.rotation_covariance, ANY_TURN * np.eye(3))


def test_no_circumstance_makes_known_what_nobody_has_seen() -> None:
    for noise in learned_parameters().noise.values():
        found = rotation_covariance(noise, ANY_TURN * np.eye(3), np.zeros(()))
        np.testing.assert_allclose(found, (ANY_TURN + noise.turn**2) * np.eye(3))
        told = np.diag((TOLD**2, TOLD**2, ANY_TURN))
        assert rotation_covariance(noise, told, np.zeros(()))[2, 2] >= ANY_TURN


def test_rounding_makes_no_information() -> None:
    told = told_axes(np.diag((-1e-16, 0.01, math.pi**2))[None])
    assert np.isfinite(told.information).all() and told.told.tolist() == [[True, True, False]]
