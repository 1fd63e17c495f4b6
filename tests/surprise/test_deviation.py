"""One percept against a belief: what is across the viewing ray, what along it, and what noise makes of that."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dsr.math3d.transforms import Pose
from surprise.config import SurpriseConfig
from surprise.deviation import Offset, compare
from surprise.misfit import DepthBias, Misfit, are_alike, describe, disagrees, misfit, offset

CONFIG = SurpriseConfig()
UNKNOWN, KNOWN = DepthBias(0.0, CONFIG.depth_bias), CONFIG.learned_bias
EYE = (0.3, 0.0, 1.0)
SURE = np.diag([1e-6] * 3 + [1e-4] * 3)
BELIEF = Pose((0.3, 0.0, 0.0), covariance=SURE)


def test_the_depth_error_is_along_the_ray_only() -> None:
    deviation = compare(Pose((0.3, 0.0, 0.015), covariance=SURE), EYE, BELIEF, CONFIG)
    assert deviation.beside.length == pytest.approx(0.0, abs=1e-9)
    assert deviation.depth.vector[0] == pytest.approx(-0.015)
    assert not disagrees(deviation, UNKNOWN)
    oblique = compare(Pose((0.3, 0.25, 0.25)), (0.3, 1.0, 1.0), Pose((0.3, 0.25 - 0.01, 0.25 - 0.01)), CONFIG)
    assert oblique.beside.length == pytest.approx(0.0, abs=1e-9)
    assert oblique.depth.vector[0] == pytest.approx(-0.01 * math.sqrt(2))


def test_covariance_is_that_of_both_in_the_world_frame() -> None:
    """A belief that is uncertain along its own x axis, which points along y of the world."""
    uncertain = np.diag([4e-4, 1e-8, 1e-8, 1e-4, 1e-4, 1e-4])
    belief = Pose.from_rotvec((0.3, 0.0, 0.0), (0.0, 0.0, math.pi / 2), covariance=uncertain)
    exact = np.diag([1e-10] * 6)
    along = compare(Pose((0.3, 0.03, 0.0), belief.q, covariance=exact), EYE, belief, CONFIG)
    across = compare(Pose((0.33, 0.0, 0.0), belief.q, covariance=exact), EYE, belief, CONFIG)
    assert along.beside.length / along.beside.common == pytest.approx(0.03 / 0.02, rel=0.01)
    assert across.beside.length / across.beside.common > 25.0


def test_tilt_needs_more_than_yaw() -> None:
    for axis, enough in ((0, 0.24), (1, 0.24), (2, 0.1)):
        for angle, expected in ((enough, True), (0.6 * enough, False)):
            rotvec = [angle * (index == axis) for index in range(3)]
            percept = Pose.from_rotvec((0.3, 0.0, 0.0), rotvec, covariance=SURE)
            assert disagrees(compare(percept, EYE, BELIEF, CONFIG), UNKNOWN) is expected


def test_a_learned_depth_error_makes_smaller_changes_count() -> None:
    deviation = compare(Pose((0.3, 0.0, 0.030), covariance=SURE), EYE, BELIEF, CONFIG)
    assert not disagrees(deviation, UNKNOWN)
    assert not disagrees(deviation, DepthBias(-0.015, KNOWN))
    known = DepthBias(-0.005, KNOWN)
    assert disagrees(deviation, known)
    found = Misfit(0.0, "depth", (offset("depth", deviation, known),))
    assert describe(found, "camera").startswith("seen 25 mm nearer to camera (")


def test_alike_percepts_are_false_or_by_noise_and_those_that_agree_speak_against_them() -> None:
    far = compare(Pose((0.4, 0.0, 0.0), covariance=SURE), EYE, BELIEF, CONFIG)
    here = compare(Pose((0.301, 0.0, 0.0), covariance=SURE), EYE, BELIEF, CONFIG)
    counted = [(misfit([far] * count, UNKNOWN, 3.0).nats, 3.0 * count) for count in (1, 2, 3, 6)]
    for found, expected in counted:
        assert found == pytest.approx(expected)
    assert misfit([far, far, here, here, far], UNKNOWN, 3.0).nats == pytest.approx(3.0)
    assert misfit([far, far, far, here, far], UNKNOWN, 3.0).nats == pytest.approx(9.0)
    assert misfit([far, far, far, here], UNKNOWN, 3.0).nats < 0.5
    assert misfit([], UNKNOWN).nats == 0.0


def test_noise_that_all_percepts_share_is_not_averaged_away() -> None:
    one = compare(Pose((0.304, 0.0, 0.0), covariance=SURE), EYE, BELIEF, CONFIG)
    shared = 0.5 * (0.004 / one.beside.common) ** 2
    assert misfit([one], UNKNOWN).nats < misfit([one] * 6, UNKNOWN).nats < shared


@pytest.mark.parametrize("scale", [1e200, 1e-300])
def test_absurd_covariances_do_no_harm(scale: float) -> None:
    percept = Pose((0.4, 0.0, 0.0), covariance=scale * np.eye(6))
    assert disagrees(compare(percept, EYE, BELIEF, CONFIG), UNKNOWN) is (scale < 1.0)


def test_a_covariance_that_is_none_and_a_percept_in_the_intrinsics() -> None:
    indefinite = np.zeros((6, 6))
    indefinite[0, 1] = indefinite[1, 0] = 1.0
    deviation = compare(Pose(EYE, covariance=indefinite), EYE, BELIEF, CONFIG)
    assert math.isfinite(misfit([deviation], UNKNOWN).nats)


def test_what_is_alike() -> None:
    one = Offset((0.1, 0.0, 0.0), 0.001, 0.001)
    for vector, expected in (((0.08, 0.02, 0.0), True), ((-0.1, 0.0, 0.0), False), ((0.02, 0.0, 0.0), False)):
        assert are_alike(one, Offset(vector, 0.001, 0.001)) is expected
