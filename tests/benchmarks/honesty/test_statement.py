"""Scores of places are proper, regions hold the truth as often as they say, and nothing costs endlessly much."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.honesty.statement import (
    DOUBT,
    GONE,
    RESOLUTION,
    TURNS,
    VOLUME,
    Likely,
    Statement,
    log_score,
    region_of,
    sideways_region_of,
    stated,
)
from dsr.math3d.transforms import Pose, exp

SIGMAS = np.array([0.02, 0.05, 0.01, 0.1, 0.2, 0.05])  # m, rad
_ROOT = np.linalg.qr(np.random.default_rng(7).standard_normal((6, 6)))[0] * 0.3 + np.eye(6)
FACTOR = np.diag(SIGMAS) @ _ROOT
COVARIANCE = FACTOR @ FACTOR.T
COVARIANCE = 0.5 * (COVARIANCE + COVARIANCE.T)
GRAIN = np.diag([RESOLUTION[0] ** 2] * 3 + [RESOLUTION[1] ** 2] * 3)
MEAN = Pose.from_rotvec((0.3, -0.2, 0.8), (0.4, -0.9, 1.1), covariance=COVARIANCE)
LEVELS = (0.5, 0.9, 0.99)


def truths(mean: Pose, covariance: np.ndarray, count: int, seed: int = 0) -> list[Pose]:
    """Poses of a Gaussian in the tangent at `mean`."""
    factor = np.linalg.cholesky(covariance)
    twists = np.random.default_rng(seed).standard_normal((count, 6)) @ factor.T
    return [mean.with_covariance(None) @ exp(twist) for twist in twists]


def is_near(share: float, level: float, count: int) -> bool:
    """Whether a share is within four standard deviations of a binomial one."""
    return abs(share - level) < 4 * math.sqrt(level * (1 - level) / count)


@pytest.mark.parametrize("turned", [False, True])
def test_regions_of_an_honest_gaussian_hold_the_truth_as_often_as_they_say(turned: bool) -> None:
    covariance = COVARIANCE * (0.01 if not turned else 1.0)  # positions go with rotations to first order
    mean, drawn = MEAN.with_covariance(covariance), truths(MEAN, covariance, 1500)
    found = np.array([region_of(stated(mean), truth, turned=turned) for truth in drawn])
    for level in LEVELS:
        assert is_near(float(np.mean(found <= level)), level, len(found)), level


def test_the_region_counts_the_dimensions() -> None:
    mean = Pose(covariance=np.diag([0.01**2] * 3 + [0.1**2] * 3))
    truth = Pose((0.01, 0.0, 0.0))
    assert region_of(stated(mean), truth) == pytest.approx(chi2.cdf(1.0, 3), abs=1e-3)
    assert region_of(stated(mean), truth, turned=True) == pytest.approx(chi2.cdf(1.0, 6), abs=1e-3)


def test_a_covariance_is_in_the_frame_of_the_thing() -> None:
    turned = Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, math.pi / 2), covariance=np.diag([0.1**2] + [0.01**2] * 5))
    along, across = Pose((0.0, 0.1, 0.0)), Pose((0.1, 0.0, 0.0))  # its x axis is along world y
    assert region_of(stated(turned), along) == pytest.approx(chi2.cdf(1.0, 3), abs=1e-3)
    assert region_of(stated(turned), across) == pytest.approx(1.0)


@pytest.mark.parametrize("turned", [False, True])
def test_the_log_score_of_an_honest_gaussian_is_its_entropy(turned: bool) -> None:
    size = 6 if turned else 3
    covariance = COVARIANCE * 0.01
    mean, drawn = MEAN.with_covariance(covariance), truths(MEAN, covariance, 1500)
    scores = [log_score(stated(mean), truth, turned=turned) for truth in drawn]
    entropy = 0.5 * np.linalg.slogdet(2 * math.pi * math.e * (covariance + GRAIN)[:size, :size])[1]
    assert np.mean(scores) == pytest.approx(entropy, abs=4 * math.sqrt(size / 2 / len(scores)) + 0.05)


def test_the_density_of_wide_rotations_is_normalised() -> None:
    """Its integral over all poses, by draws of any rotation and of positions from a slightly wider Gaussian."""
    mean, count, wider = Pose(covariance=np.diag([0.01**2] * 3 + [0.7**2] * 3)), 8000, 0.012
    rng = np.random.default_rng(1)
    places = wider * rng.standard_normal((count, 3))
    drawn = (2 * math.pi * wider**2) ** -1.5 * np.exp(-0.5 * (places**2).sum(axis=1) / wider**2) / TURNS
    turns = rng.standard_normal((count, 4))
    poses = [Pose(place, turn / np.linalg.norm(turn)) for place, turn in zip(places, turns, strict=True)]
    densities = np.array([math.exp(-log_score(stated(mean), pose, turned=True)) for pose in poses])
    floor = DOUBT * (1 - GONE) / VOLUME / TURNS
    mass = float(np.mean((densities - floor) / drawn)) / (1 - DOUBT)
    assert mass == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("scale", [0.25, 0.5, 2.0, 4.0])
def test_to_be_too_sure_or_too_unsure_costs(scale: float, turned: bool) -> None:
    drawn = truths(MEAN, COVARIANCE, 600)
    honest = np.mean([log_score(stated(MEAN), truth, turned=turned) for truth in drawn])
    other = MEAN.with_covariance(scale * COVARIANCE)
    assert np.mean([log_score(stated(other), truth, turned=turned) for truth in drawn]) > honest + 0.1


def test_to_be_beside_the_truth_costs() -> None:
    drawn = truths(MEAN, COVARIANCE, 600)
    honest = np.mean([log_score(stated(MEAN), truth) for truth in drawn])
    beside = Pose((0.33, -0.2, 0.8), MEAN.q, covariance=COVARIANCE)
    assert np.mean([log_score(stated(beside), truth) for truth in drawn]) > honest


def test_honesty_costs_at_most_the_doubt() -> None:
    """Of all probabilities that it is gone, the true one is the best but for less than -log(1 - DOUBT)."""
    place = Pose(covariance=np.eye(6) * 0.01)
    for true in (0.0, 0.001, 0.3, 0.9, 1.0):

        def expected(said: float, true: float = true) -> float:
            statement = Statement((Likely(1.0 - said, place),), said)
            there = log_score(statement, Pose())
            density = log_score(Statement((Likely(1.0, place),)), Pose())
            return true * log_score(statement, None) + (1 - true) * (there - density)

        best = min(expected(said) for said in (*np.linspace(0.0, 1.0, 401), true))
        assert 0.0 <= expected(true) - best <= -math.log(1 - DOUBT) + 1e-9


def test_nobody_pays_endlessly() -> None:
    sure = Pose((0.0, 0.0, 1.0), covariance=np.zeros((6, 6)))
    far, worst = Pose((2.9, 0.0, 1.0)), -math.log(DOUBT * (1 - GONE) / VOLUME)
    assert log_score(stated(sure), far) == pytest.approx(worst)
    assert log_score(Statement((), 1.0), far) == pytest.approx(worst)
    assert log_score(stated(sure), None) == pytest.approx(-math.log(DOUBT * GONE))
    assert log_score(Statement((), 1.0), None) == pytest.approx(0.0, abs=DOUBT)
    assert math.isfinite(log_score(stated(sure), sure))


def test_who_says_nothing_spreads_it_evenly_and_has_no_region() -> None:
    silent = -math.log((1 - GONE) / VOLUME)
    for statement in (Statement(), stated(None), stated(Pose((0.0, 0.0, 1.0)))):
        assert statement.open == 1.0, "without a covariance nothing is said"
        assert log_score(statement, Pose((0.3, 0.0, 1.0))) == pytest.approx(silent)
        assert log_score(statement, None) == pytest.approx(-math.log(GONE))
        assert region_of(statement, Pose()) is region_of(statement, None) is None


def test_regions_of_what_may_be_gone() -> None:
    place = Pose(covariance=np.eye(6) * 0.01)
    assert region_of(Statement((), 1.0), None) == 0.0
    assert region_of(Statement((), 1.0), Pose()) == 1.0
    assert region_of(stated(place), None) == 1.0
    likely_gone = Statement((Likely(0.2, place),), 0.8)
    assert region_of(likely_gone, None) == 0.0
    assert region_of(likely_gone, Pose()) == pytest.approx(0.8, abs=0.01)
    assert region_of(Statement((Likely(0.9, place),), 0.1), Pose()) == pytest.approx(0.0, abs=0.01)


def test_regions_of_several_poses_hold_the_truth_as_often_as_they_say() -> None:
    covariance = np.diag([0.02**2] * 3 + [0.1**2] * 3)
    poses = [Pose((0.0, 0.0, 0.0), covariance=covariance), Pose((0.5, 0.0, 0.0), covariance=4 * covariance)]
    statement = Statement((Likely(0.7, poses[0]), Likely(0.3, poses[1])))
    drawn = truths(poses[0], covariance, 140) + truths(poses[1], 4 * covariance, 60, seed=1)
    found = np.array([region_of(statement, truth) for truth in drawn])
    for level in LEVELS:
        assert is_near(float(np.mean(found <= level)), level, len(found)), level


@pytest.mark.parametrize("several", [False, True])
def test_regions_sideways_hold_the_truth_as_often_as_they_say_though_its_height_is_exact(several: bool) -> None:
    turn, covariance = Pose.from_rotvec((0.0, 0.0, 0.0), (0.4, -0.9, 1.1)).q, np.diag([0.02**2] * 3 + [0.1**2] * 3)
    means = [Pose((x, 0.0, 0.3), turn, covariance=covariance) for x in ((0.0, 0.03) if several else (0.0,))]
    statement = Statement(tuple(Likely(1.0 / len(means), mean) for mean in means))
    drawn = [one for k, mean in enumerate(means) for one in truths(mean, covariance, 600 // len(means), seed=k)]
    exact = [Pose((*one.t[:2], 0.3), one.q) for one in drawn]
    found = np.array([sideways_region_of(statement, truth) for truth in exact])
    for level in LEVELS:
        assert is_near(float(np.mean(found <= level)), level, len(found)), level
    whole = np.array([region_of(statement, truth) for truth in exact])
    assert np.mean(whole <= 0.9) > 0.93, "a height that is known exactly counts as right"
    assert sideways_region_of(statement, None) == 1.0 and sideways_region_of(Statement(), exact[0]) is None


def test_a_pose_in_two_halves_is_one_pose() -> None:
    truth = Pose((0.31, -0.22, 0.82), MEAN.q)
    halves = Statement((Likely(0.5, MEAN), Likely(0.5, MEAN)))
    for turned in (False, True):
        assert log_score(halves, truth, turned=turned) == pytest.approx(log_score(stated(MEAN), truth, turned=turned))
        one, two = region_of(stated(MEAN), truth, turned=turned), region_of(halves, truth, turned=turned)
        assert one == pytest.approx(two, abs=0.05)
