"""One percept against a belief: what is across the viewing ray, what along it, and what noise makes of that."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dsr.math3d.transforms import Pose
from surprise.config import SurpriseConfig
from surprise.deviation import compare
from surprise.limits import are_alike, describe, disagrees, exceeds

CONFIG = SurpriseConfig()
EYE = (0.3, 0.0, 1.0)
SURE = np.diag([1e-6] * 3 + [1e-4] * 3)
BELIEF = Pose((0.3, 0.0, 0.0), covariance=SURE)


def test_the_depth_error_is_along_the_ray_only() -> None:
    deviation = compare(Pose((0.3, 0.0, 0.015), covariance=SURE), EYE, BELIEF, CONFIG)
    assert math.hypot(*deviation.beside) == pytest.approx(0.0, abs=1e-9)
    assert deviation.depth == pytest.approx(-0.015)
    assert not disagrees(deviation, None, CONFIG)
    oblique = compare(Pose((0.3, 0.25, 0.25)), (0.3, 1.0, 1.0), Pose((0.3, 0.25 - 0.01, 0.25 - 0.01)), CONFIG)
    assert math.hypot(*oblique.beside) == pytest.approx(0.0, abs=1e-9)
    assert oblique.depth == pytest.approx(-0.01 * math.sqrt(2))


def test_covariance_is_that_of_both_in_the_world_frame() -> None:
    """A belief that is uncertain along its own x axis, which points along y of the world."""
    uncertain = np.diag([4e-4, 1e-8, 1e-8, 1e-4, 1e-4, 1e-4])
    belief = Pose.from_rotvec((0.3, 0.0, 0.0), (0.0, 0.0, math.pi / 2), covariance=uncertain)
    exact = np.diag([1e-10] * 6)
    along = compare(Pose((0.3, 0.03, 0.0), belief.q, covariance=exact), EYE, belief, CONFIG)
    across = compare(Pose((0.33, 0.0, 0.0), belief.q, covariance=exact), EYE, belief, CONFIG)
    assert along.beside_sigmas == pytest.approx(0.03 / 0.02, rel=0.01)
    assert across.beside_sigmas > 25.0


def test_tilt_needs_more_than_yaw() -> None:
    for axis, enough in ((0, 0.35), (1, 0.35), (2, 0.2)):
        for angle, expected in ((enough, True), (0.6 * enough, False)):
            rotvec = [angle * (index == axis) for index in range(3)]
            percept = Pose.from_rotvec((0.3, 0.0, 0.0), rotvec, covariance=SURE)
            assert exceeds("turn", compare(percept, EYE, BELIEF, CONFIG), None, CONFIG) is expected


def test_a_learned_depth_error_makes_smaller_changes_count() -> None:
    deviation = compare(Pose((0.3, 0.0, 0.030), covariance=SURE), EYE, BELIEF, CONFIG)
    assert not exceeds("depth", deviation, None, CONFIG)
    assert not exceeds("depth", deviation, -0.015, CONFIG)
    assert exceeds("depth", deviation, -0.005, CONFIG)
    assert describe("depth", [deviation], -0.005, "camera").startswith("seen 25 mm nearer to camera (")


@pytest.mark.parametrize("scale", [1e200, 1e-300])
def test_absurd_covariances_do_no_harm(scale: float) -> None:
    percept = Pose((0.4, 0.0, 0.0), covariance=scale * np.eye(6))
    assert disagrees(compare(percept, EYE, BELIEF, CONFIG), None, CONFIG) is (scale < 1.0)


def test_a_covariance_that_is_none_and_a_percept_in_the_intrinsics() -> None:
    indefinite = np.zeros((6, 6))
    indefinite[0, 1] = indefinite[1, 0] = 1.0
    deviation = compare(Pose(EYE, covariance=indefinite), EYE, BELIEF, CONFIG)
    assert math.isfinite(deviation.beside_sigmas + deviation.depth_std)


def test_what_is_alike() -> None:
    assert are_alike((0.1, 0.0, 0.0), (0.08, 0.02, 0.0), CONFIG)
    assert not are_alike((0.1, 0.0, 0.0), (-0.1, 0.0, 0.0), CONFIG)
    assert not are_alike((0.1, 0.0, 0.0), (0.02, 0.0, 0.0), CONFIG)
