"""The three methods: what they find, what misleads them, and what they say about it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.calibrator.solve.calibrate import METHODS, calibrate
from agents.calibrator.solve.estimate import PoseEstimate, equation_1
from agents.calibrator.solve.problem import ObjectSighting, Problem
from agents.calibrator.solve.reporting import make_report
from agents.calibrator.solve.solution import judged
from dsr.errors import ConfigError
from dsr.math3d.transforms import Pose, exp
from dsr.vocabulary import calibration
from tests.agents.calibrator.scenes import BUMP, CLUSTER, DOWN, FLIP, SIGMAS, WIDE, cubes, sightings

GOOD = ("robust", "closed_form")
SUCCESS = (0.003, math.radians(0.3))
ARM_POSES = [
    Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    Pose.from_rotvec((0.1, 0.0, -0.05), (0.0, 0.3, 0.2)),
    Pose.from_rotvec((-0.1, 0.1, -0.1), (0.2, -0.2, -0.5)),
]
twists = st.tuples(*[st.floats(-0.1, 0.1)] * 3, *[st.floats(-0.26, 0.26)] * 3)


def succeeds(found: Pose, truth: Pose) -> bool:
    metres, radians = found.distance(truth)
    return metres < SUCCESS[0] and radians < SUCCESS[1]


def test_the_methods_are_those_that_can_be_asked_for() -> None:
    assert set(METHODS) == set(calibration.METHODS)
    with pytest.raises(ConfigError, match="robust"):
        calibrate(sightings(cubes()), DOWN, "robustt")


@pytest.mark.parametrize("method", GOOD)
@settings(max_examples=15)
@given(bump=twists, mount=twists, count=st.integers(1, 4))
def test_without_noise_the_pose_is_found_whatever_was_believed(
    method: str, bump: tuple[float, ...], mount: tuple[float, ...], count: int
) -> None:
    camera = DOWN @ exp(mount)
    solution = calibrate(sightings(cubes(WIDE[:count]), camera), camera @ exp(bump), method)
    metres, radians = solution.pose.distance(camera)
    assert metres < 1e-5 and radians < 1e-5
    assert solution.outliers == () and solution.agreeing == count


@pytest.mark.parametrize("method", GOOD)
def test_from_a_pose_turned_by_half_a_turn(method: str) -> None:
    before = DOWN @ Pose.from_rotvec((0.5, 0.5, 0.5), (0.0, math.pi, 0.0))
    assert calibrate(sightings(cubes()), before, method).pose.distance(DOWN)[0] < 1e-5


@pytest.mark.parametrize("method", GOOD)
def test_a_camera_at_the_wrist_from_several_arm_poses(method: str) -> None:
    solution = calibrate(sightings(cubes(), parents=ARM_POSES), DOWN @ BUMP, method)
    assert solution.pose.distance(DOWN)[0] < 1e-5
    assert (solution.views, solution.sightings) == (3, 12)


def test_powell_lessens_equation_1_from_a_small_bump() -> None:
    problem = Problem(sightings(cubes()))
    before = DOWN @ Pose.from_rotvec((0.005, 0.0, 0.005), (0.0, 0.0, 0.02))
    solution = calibrate(problem.sightings, before, "powell")
    assert solution.history[-1] < 0.2 * solution.history[0] == pytest.approx(0.2 * equation_1(problem, before.matrix))
    assert list(solution.history) == sorted(solution.history, reverse=True)


def test_equation_1_rewards_agreement() -> None:
    """As printed in the paper it would be greatest there."""
    problem = Problem(sightings(cubes()))
    turned = Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, 0.5))
    assert equation_1(problem, DOWN.matrix) == pytest.approx(0.0, abs=1e-9)
    one = Problem([ObjectSighting("a", 0, Pose().with_covariance(np.eye(6)), Pose((0.1, 0.0, 0.0)) @ turned)])
    assert equation_1(one, np.eye(4)) == pytest.approx(0.1 + math.sin(0.25) ** 2)


@pytest.mark.parametrize("method", GOOD)
def test_with_noise_the_errors_are_small_and_within_the_covariance(method: str) -> None:
    rng, squared, successes = np.random.default_rng(5), [], 0
    for _ in range(20):
        solution = calibrate(sightings(cubes(), rng=rng, parents=[Pose.identity()] * 4), DOWN @ BUMP, method)
        error = np.array(solution.pose.inverse().matrix @ DOWN.matrix)
        twist = np.array([*error[:3, 3], *Pose.from_matrix(error).rotvec])
        squared.append(twist @ np.linalg.solve(np.asarray(solution.pose.covariance), twist))
        successes += succeeds(solution.pose, DOWN)
    assert successes >= 19
    assert 3.0 < np.mean(squared) < 11.0  # 6 if the covariance is right


@pytest.mark.parametrize("method", GOOD)
def test_a_flipped_percept_and_a_moved_cube_do_not_matter_and_are_named(method: str) -> None:
    rng = np.random.default_rng(2)
    places = (*WIDE, (0.0, 0.0), (0.05, -0.02))
    moved = {"cube_5": Pose((0.05, 0.0, 0.0))}
    for wrong in ({"cube_2": FLIP}, moved, {"cube_1": FLIP, "cube_6": Pose((0.1, 0.1, 0.0))}):
        clean = calibrate(sightings(cubes(places)), DOWN @ BUMP, method)
        solution = calibrate(sightings(cubes(places), rng=rng, wrong=wrong), DOWN @ BUMP, method)
        assert solution.outliers == tuple(wrong)
        assert solution.is_adoptable and succeeds(solution.pose, clean.pose)


def test_objects_without_measured_orientation_count_by_their_positions() -> None:
    seen = sightings(cubes(), rng=np.random.default_rng(0))
    covariance = np.diag([*SIGMAS[:3] ** 2, *[math.pi**2] * 3])
    turned = Pose.from_rotvec((0.0, 0.0, 0.0), (1.0, -1.0, 2.0))
    blind = [one._replace(seen=(one.seen @ turned).with_covariance(covariance)) for one in seen]
    for method in GOOD:
        metres, radians = calibrate(blind, DOWN @ BUMP, method).pose.distance(DOWN)
        assert metres < 0.01 and radians < 0.02


def test_most_must_agree() -> None:
    wrong = {"cube_1": Pose((0.05, 0.0, 0.0)), "cube_2": Pose((-0.04, 0.06, 0.0)), "cube_3": Pose((0.0, -0.08, 0.0))}
    solution = calibrate(sightings(cubes(), wrong=wrong), DOWN @ BUMP)
    assert not solution.is_adoptable and "no pose of the camera" in solution.problem


def test_what_stops_halfway_is_not_adopted() -> None:
    problem = Problem(sightings(cubes()))
    near = judged("powell", problem, DOWN @ BUMP, PoseEstimate((DOWN @ Pose((0.001, 0.0, 0.0))).matrix, ()))
    off = judged("powell", problem, DOWN @ BUMP, PoseEstimate((DOWN @ Pose((0.0025, 0.0, 0.0))).matrix, ()))
    assert near.is_adoptable and near.unfinished == pytest.approx(2.0 * 0.001 / SIGMAS[0], rel=0.2)
    assert off.agreeing == 4 and not off.is_adoptable
    assert "method powell has not found the best pose: it stopped 6 standard" in off.problem


@pytest.mark.parametrize(
    ("places", "weak"),
    [(WIDE, False), (WIDE[:1], True), (WIDE[:2], True), (CLUSTER, True), (((-0.1, 0.0), (0.0, 0.0), (0.1, 0.0)), True)],
)
def test_weak_geometry_is_told(places: tuple[tuple[float, float], ...], weak: bool) -> None:
    solution = calibrate(sightings(cubes(places)), DOWN @ BUMP)
    assert solution.geometry.is_weak is weak
    assert ("geometry is weak" in solution.problem) is weak is not solution.is_adoptable


def test_one_cube_from_several_arm_poses_is_not_weak() -> None:
    parents = [Pose.from_rotvec((x, y, 0.0), (0.0, 0.0, 0.0)) for x, y in WIDE]
    assert calibrate(sightings(cubes(((0.0, 0.0),)), parents=parents), DOWN @ BUMP).is_adoptable


def test_what_cannot_be_solved_is_refused() -> None:
    with pytest.raises(ValueError, match="no object"):
        calibrate([], DOWN)
    with pytest.raises(ValueError, match="cube_1: the percept has no covariance"):
        calibrate([one._replace(seen=one.seen.with_covariance(None)) for one in sightings(cubes())], DOWN)


def test_a_prior_says_what_the_sightings_leave_open_and_hardly_more() -> None:
    """A bare place tells three of six numbers; four cubes tell all."""
    believed = DOWN @ BUMP
    prior = believed.with_covariance(0.05**2 * np.eye(6))
    few = sightings(cubes(WIDE[:1]), bare=("cube_1",))
    found = calibrate(few, believed, prior=prior)
    assert found.is_adoptable and found.geometry.is_weak
    assert np.linalg.norm((found.pose @ few[0].seen).translation - few[0].believed.translation) < 0.0005
    assert found.pose.covariance is not None and np.linalg.eigvalsh(found.pose.covariance)[-1] > 0.03**2
    many = calibrate(sightings(cubes()), believed, prior=prior)
    assert many.pose.distance(DOWN)[0] < 0.0005


def test_a_prior_without_covariance_is_refused() -> None:
    with pytest.raises(ValueError, match="says nothing"):
        Problem(sightings(cubes()), DOWN)


def test_a_covariance_that_no_pose_may_have_is_not_reported() -> None:
    """Percepts that somebody made up lead there. Before, the calibrator failed in each tick from then on."""
    solution = calibrate(sightings(cubes()), DOWN)
    assert make_report("camera", "world", solution, adopted=False).covariance
    vague = solution._replace(pose=solution.pose.with_covariance(1e22 * np.eye(6)))
    assert make_report("camera", "world", vague, adopted=False).covariance == ()
