"""Hand-eye calibration on synthetic views with known truth: accuracy, honesty of the covariance, and refusals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from agents.calibrator.hand_eye.advice import advise
from agents.calibrator.hand_eye.calibrate import Setting, Solution, observed, solve
from agents.calibrator.hand_eye.fit import Fitter, Noise, Weights
from agents.calibrator.hand_eye.model import Parameters, ViewModel
from agents.calibrator.hand_eye.observations import Observations
from agents.calibrator.hand_eye.priors import prior_of
from agents.calibrator.hand_eye.reading import ToldHands, joint_poses, read_chain
from agents.calibrator.hand_eye.report import HandEyeReport, make_report
from dsr.errors import ConfigError
from dsr.math3d.transforms import Array, Pose, exp
from tests.agents.calibrator.hand_eye_views import HELD, LENS, MOUNT, SIZE, looks, off, simulated, solved
from tests.agents.calibrator.hand_eye_views import read_target as target_of

GEN3 = Path(__file__).parents[3] / "etc/robots/gen3.urdf"
LAYOUT = """
tag = [
    { id = 1, size = 0.06, translation = [0.0, 0.0, 0.0] },
    { id = 2, size = 0.06, translation = [0.12, 0.0, 0.0] },
    { id = 5, size = 0.06, translation = [0.0, -0.12, 0.02], rotation = [0.1305262, 0.0, 0.0, 0.9914449] },
]
"""


def report_of(solution: Solution) -> HandEyeReport:
    return make_report("target", solution.model, solution.fitted, not_found=(), joint_names=(), advice="")


@pytest.mark.parametrize("is_in_hand", [True, False])
@pytest.mark.parametrize(
    "name", ["circles:7x5:0.03", "circles:6x6:0.03", "chessboard:8x6:0.025", "tag36h11:7:0.1", "square:0.2", "tags"]
)
def test_the_mount_is_found_by_any_target(name: str, is_in_hand: bool, tmp_path: Path) -> None:
    if name == "tags":
        (tmp_path / "layout.toml").write_text(LAYOUT, encoding="utf-8")
        name = f"tags:{tmp_path / 'layout.toml'}"
    observations, truth = simulated(name, is_in_hand=is_in_hand, seed=3)
    twist = off(solved(observations), truth)
    assert np.linalg.norm(twist[:3]) < 0.003 and np.linalg.norm(twist[3:]) < 0.006


def test_intrinsics_are_found_from_nothing() -> None:
    setting = Setting(lens="plumb_bob")
    observations, truth = simulated("circles:9x7:0.025", count=16, setting=setting)
    solution = solved(observations, setting, None)
    found = solution.fitted.parameters.intrinsics
    assert found.fx == pytest.approx(LENS.fx, rel=0.01) and found.cx == pytest.approx(LENS.cx, abs=6.0)
    assert found.distortion is not None and found.distortion.coefficients[0] == pytest.approx(-0.12, abs=0.03)
    assert np.linalg.norm(off(solution, truth)[:3]) < 0.005
    report = report_of(solution)
    assert len(report.intrinsics_std) == 9 and report.intrinsics["distortion_model"] == "plumb_bob"


def test_the_covariance_is_honest() -> None:
    """Squared Mahalanobis distances of the error, 6 degrees of freedom, over runs with hands good and bad."""
    distances = []
    for seed in range(12):
        for std in (2e-4, 1.5e-3):
            observations, truth = simulated(
                "circles:5x4:0.04", count=9, seed=seed, position_std=std, rotation_std=std, pixel_std=0.15
            )
            solution = solved(observations)
            twist = off(solution, truth)
            distances.append(float(twist @ np.linalg.solve(solution.fitted.covariance[:6, :6], twist)))
    # the mean of 24 has a standard deviation of 0.7; what is stated may be a bit too careful, hardly too bold
    assert 3.0 < float(np.mean(distances)) < 8.0
    assert np.mean(np.array(distances) < 12.6) > 0.85


def test_what_a_hand_is_stated_to_err_is_believed() -> None:
    good = Setting(position_std=1e-5, rotation_std=1e-5)
    bad = Setting(position_std=5e-3, rotation_std=5e-3)
    spreads = []
    for setting in (good, bad):
        observations, _ = simulated("circles:5x4:0.04", position_std=0.0, rotation_std=0.0, setting=setting)
        spreads.append(np.sqrt(np.trace(solved(observations, setting).fitted.covariance[:3, :3])))
    assert spreads[1] > 10.0 * spreads[0]


def test_a_view_with_a_wrong_pose_is_named_and_does_no_harm() -> None:
    observations, truth = simulated("circles:7x5:0.03", seed=5)
    hands = observations.hands.copy()
    hands[4] = hands[4] @ exp((0.03, -0.02, 0.0, 0.0, 0.05, 0.0)).matrix
    solution = solved(replace(observations, hands=hands))
    report = report_of(solution)
    assert [view.image for view in report.views if view.drop] == ["4.png"]
    assert "did the robot still move" in report.views[4].drop and report.views[4].weight < 0.2
    assert np.linalg.norm(off(solution, truth)[:3]) < 0.003


def test_a_view_with_wrong_points_is_named() -> None:
    observations, truth = simulated("circles:7x5:0.03", seed=6)
    pixels = observations.pixels.copy()
    pixels[2] += np.random.default_rng(0).normal(0.0, 12.0, pixels[2].shape)
    solution = solved(replace(observations, pixels=pixels))
    view = report_of(solution).views[2]
    assert view.own_px > 5.0
    assert np.linalg.norm(off(solution, truth)[:3]) < 0.004
    assert solution.fitted.weights.points[2].mean() < 0.2


def test_hidden_points_do_not_count() -> None:
    observations, truth = simulated("circles:7x5:0.03", seed=7)
    pixels = observations.pixels.copy()
    pixels[::2, :10] = np.nan
    assert np.linalg.norm(off(solved(replace(observations, pixels=pixels)), truth)[:3]) < 0.003


def test_targets_that_look_alike_when_turned_may_be_found_in_any_order() -> None:
    observations, truth = simulated("circles:6x6:0.03", seed=8)
    turned = observations.reordered([0, *np.random.default_rng(1).integers(0, 4, len(observations) - 1).tolist()])
    assert np.linalg.norm(off(solved(turned), truth)[:3]) < 0.003


def test_the_size_of_a_print_is_measured_by_the_moves_of_the_robot() -> None:
    observations, truth = simulated("circles:7x5:0.03", seed=9)
    solution = solved(replace(observations, points=observations.points / 1.02))
    report = report_of(solution)
    assert report.target_scale == pytest.approx(1.02, abs=0.004)
    assert np.linalg.norm(off(solution, truth)[:3]) < 0.003


def test_derivatives_are_those_of_the_residuals() -> None:
    for is_in_hand in (True, False):
        observations, truth = simulated("tag36h11:3:0.1", count=4, is_in_hand=is_in_hand)
        model = ViewModel(observations, fits_lens=True)
        slips = np.array([exp(1e-2 * np.random.default_rng(row).normal(size=6)).matrix for row in range(4)])
        now = Parameters(truth.mount, truth.held, 0.01, LENS, slips, np.zeros(0))
        linear = model.linearised(now)
        count = linear.by_common.shape[-1]
        for column in range(count):
            step = 1e-6 * np.eye(count)[column]
            by_step = (
                model.residuals(model.moved(now, -step, np.zeros((4, 6))))
                - model.residuals(model.moved(now, step, np.zeros((4, 6))))
            ) / 2e-6
            np.testing.assert_allclose(linear.by_common[..., column], by_step, rtol=1e-4, atol=1e-3)
        for column in range(6):
            slip = np.tile(1e-6 * np.eye(6)[column], (4, 1))
            by_step = (
                model.residuals(model.moved(now, np.zeros(count), -slip))
                - model.residuals(model.moved(now, np.zeros(count), slip))
            ) / 2e-6
            np.testing.assert_allclose(linear.by_slip[..., column], by_step, rtol=1e-4, atol=1e-3)


def test_least_squares_of_scipy_end_at_the_same_pose() -> None:
    """Without errors of the hand and with equal weights, the problem is an ordinary one."""
    setting = Setting(position_std=1e-6, rotation_std=1e-6)
    observations, truth = simulated("tag36h11:3:0.1", count=6, setting=setting)
    model = ViewModel(observations)
    start = Parameters(truth.mount, truth.held, 0.0, LENS, np.tile(np.eye(4), (6, 1, 1)), np.zeros(0))
    fitter = Fitter(model, prior_of(model, start, 0.01, 0.02))
    ours = fitter.settled(start, Weights(model.seen.astype(float), np.ones(6)), Noise(0.2, 1e-9, (1e-6, 1e-6)))

    def residuals(step: Array) -> Array:
        moved = model.moved(start, np.asarray(step), np.zeros((6, 6)))
        return np.append(model.residuals(moved).ravel() / 0.2, moved.scale / 0.01)

    theirs = model.moved(start, least_squares(residuals, np.zeros(13), x_scale="jac", xtol=1e-12).x, np.zeros((6, 6)))
    apart = Pose.from_matrix(ours.mount).distance(Pose.from_matrix(theirs.mount))
    assert apart[0] < 2e-5 and apart[1] < 2e-5


def joint_views(count: int, offsets: Array, joint_std: float, setting: Setting) -> Observations:
    """Views from a Gen3 whose joints are told wrongly, by offsets and noise."""
    chain = read_chain(GEN3, "", "end_effector_link")
    rng = np.random.default_rng(4)
    target = target_of("circles:7x5:0.04")
    usual = np.array([0.0, 0.3, 3.14, -1.6, 0.0, -1.2, 1.57])
    told, pixels = [], []
    held = None
    while len(told) < count:
        joints = usual + rng.normal(0.0, 0.3, 7) * np.array([0.5, 0.7, 1.0, 0.7, 1.5, 1.0, 2.0])
        hand = chain.forward(joints).matrix
        if held is None:  # the target is where the first view has it in its middle
            held = hand @ MOUNT @ looks(1, 3, target)[0]
        seen = np.linalg.inv(hand @ MOUNT) @ held
        points = target.points @ seen[:3, :3].T + seen[:3, 3]
        shown = LENS.project(points) if points[:, 2].min() > 0.1 else np.full((len(points), 2), np.nan)
        if np.isfinite(shown).all() and ((shown > 0) & (shown < np.array(SIZE) - 1)).all():
            told.append(joints - offsets + rng.normal(0.0, joint_std, 7))
            pixels.append(shown + rng.normal(0.0, 0.1, shown.shape))
    hands = ToldHands((), *joint_poses(chain, np.array(told)), chain.names)
    names = [f"{row}" for row in range(count)]
    return observed(names, hands, np.array(pixels), target, SIZE, setting)


def test_errors_of_joints_are_found() -> None:
    offsets = np.array([0.0, 0.01, -0.015, 0.008, 0.012, -0.01, 0.0])
    setting = Setting(fits_joints=True, joint_std=2e-4)
    observations = joint_views(20, offsets, 2e-4, setting)
    solution = solve(observations, LENS, setting)
    stds = np.sqrt(np.diag(solution.fitted.covariance))[-7:]
    found = solution.fitted.parameters.offsets
    assert (np.abs(found - offsets)[1:-1] < 3.5 * stds[1:-1] + 1e-4).all() and stds[1:-1].max() < 5e-3
    without = solve(observations, LENS, setting._replace(fits_joints=False))
    assert solution.fitted.noise.hand[0] < 0.3 * without.fitted.noise.hand[0]
    report = make_report("t", solution.model, solution.fitted, not_found=(), joint_names=tuple("abcdefg"), advice="")
    assert list(report.joint_offsets) == list("bcdef")


def test_a_view_that_would_tell_more_is_named() -> None:
    narrow, _ = simulated("circles:7x5:0.03", count=5, spread=0.08)
    solution = solved(narrow)
    assert advise(solution.model, solution.fitted).startswith("add a view ")
    report = report_of(solution)
    assert "do not determine the mount well" in report.problem


@pytest.mark.parametrize(
    ("count", "moved", "said"),
    [
        (2, lambda hands: hands, "at least 3 are needed"),
        (8, lambda hands: np.tile(hands[0], (8, 1, 1)), "moves without a turn"),
        (8, lambda hands: np.array([turned(0.1 * row) for row in range(8)]), "one axis only"),
    ],
)  # fmt: skip
def test_views_that_cannot_tell_are_refused(count: int, moved: object, said: str) -> None:
    observations, _ = simulated("circles:7x5:0.03", count=count)
    assert callable(moved)
    with pytest.raises(ConfigError, match=said):
        solved(replace(observations, hands=moved(observations.hands)))


def test_poses_of_other_images_are_told() -> None:
    observations, _ = simulated("circles:7x5:0.03", count=8)
    for order in ([3, 0, 6, 1, 7, 2, 5, 4], [1, 2, 3, 4, 5, 6, 7, 0]):
        report = report_of(solved(replace(observations, hands=observations.hands[order])))
        assert "disagree with the others" in report.problem or "do not determine the mount" in report.problem


@pytest.mark.parametrize(
    ("factor", "said"), [(1e3, "poses seem to be in mm"), (1e-3, "size seems to be in mm"), (2.0, "size right")]
)
def test_wrong_units_are_named(factor: float, said: str) -> None:
    observations, _ = simulated("circles:7x5:0.03")
    hands = observations.hands.copy()
    hands[:, :3, 3] *= factor
    with pytest.raises(ConfigError, match=said):
        solved(replace(observations, hands=hands))


def test_unknown_intrinsics_are_refused_unless_they_are_to_be_found() -> None:
    observations, _ = simulated("circles:7x5:0.03")
    with pytest.raises(ConfigError, match="intrinsics are not known"):
        solve(observations, None, Setting())
    with pytest.raises(ConfigError, match="errors of joints are fitted from joint positions"):
        solve(observations, LENS, Setting(fits_joints=True))


def turned(angle: float) -> Array:
    return Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, angle)).matrix


def test_the_truth_of_these_tests_is_consistent() -> None:
    observations, truth = simulated("circles:7x5:0.03", count=3, pixel_std=0.0)
    model = ViewModel(replace(observations, hands=truth.hands))
    exact = Parameters(MOUNT, HELD, 0.0, LENS, np.tile(np.eye(4), (3, 1, 1)), np.zeros(0))
    np.testing.assert_allclose(model.residuals(exact), 0.0, atol=1e-9)
