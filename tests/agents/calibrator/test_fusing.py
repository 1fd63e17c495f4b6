"""Percepts of one view as one."""

from __future__ import annotations

import numpy as np
import pytest

from agents.calibrator.solve.fusing import CORNERS, MOST_INDEPENDENT, fuse
from dsr.math3d.transforms import Pose
from tests.agents.calibrator.scenes import FLIP, SIGMAS

TRUE = Pose.from_rotvec((0.1, 0.05, 0.6), (3.0, 0.2, 0.1))
RAY = TRUE.rotation_matrix.T @ TRUE.translation / np.linalg.norm(TRUE.translation)
BIAS = 0.01


def percepts(count: int, bias: float = 0.0) -> list[Pose]:
    rng, covariance = np.random.default_rng(3), np.diag(SIGMAS**2)
    covariance[:3, :3] += bias**2 * np.outer(RAY, RAY)
    errors = rng.normal(size=(count, 6)) * SIGMAS
    return [(TRUE @ Pose.from_rotvec(e[:3], e[3:])).with_covariance(covariance) for e in errors]


def test_the_mean_is_better_than_each_and_flips_do_not_count() -> None:
    seen = percepts(20)
    seen[3], seen[11] = (seen[i] @ FLIP for i in (3, 11))
    seen = [pose.with_covariance(np.diag(SIGMAS**2)) for pose in seen]
    metres, radians = fuse(seen, 0.0, 0.0).distance(TRUE)
    assert metres < SIGMAS[0] and radians < SIGMAS[3]


def test_errors_average_out_only_so_far() -> None:
    one, many = (np.asarray(fuse(percepts(count), 0.0, 0.0).covariance) for count in (1, 30))
    assert np.diagonal(one) == pytest.approx(SIGMAS**2 + CORNERS**2 * np.concatenate([np.zeros(3), RAY**2]), rel=0.01)
    assert many[:3, :3] == pytest.approx(one[:3, :3] / MOST_INDEPENDENT, rel=0.01, abs=1e-12)
    assert many[3:, 3:] == pytest.approx(one[3:, 3:], rel=0.01, abs=1e-12)


def test_of_the_bias_of_depth_its_scatter_stays() -> None:
    covariance = np.asarray(fuse(percepts(30, BIAS), BIAS, 0.004).covariance)[:3, :3]
    assert RAY @ covariance @ RAY == pytest.approx(0.004**2 + SIGMAS[0] ** 2 / MOST_INDEPENDENT, rel=0.05)
    across = np.linalg.svd(RAY[None])[2][1]
    assert across @ covariance @ across == pytest.approx(SIGMAS[0] ** 2 / MOST_INDEPENDENT, rel=0.05)


def test_a_bias_that_is_not_in_the_covariance_leaves_it_positive() -> None:
    covariance = np.asarray(fuse(percepts(5), BIAS, 0.0).covariance)
    assert np.linalg.eigvalsh(covariance).min() > 0.0


def test_a_single_percept_stays() -> None:
    (seen,) = percepts(1)
    assert fuse([seen], 0.0, 0.0).distance(seen) == pytest.approx((0.0, 0.0), abs=1e-9)
