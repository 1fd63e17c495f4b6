"""Percepts over time: noise averaged, wrong frames ignored, moves followed."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from simulation_handler.config import BeliefConfig
from simulation_handler.perception.estimate import Estimate, fuse, innovations
from simulation_handler.perception.percepts import SeenObject, WeighedPercept, flaws, weighed
from simulation_handler.perception.tracking import Given, PerceptTrack
from tests.simulation_handler.worlds import CAMERA, SyntheticCamera, cube_at

CONFIG = BeliefConfig()
HERE = cube_at(0.4, 0.1)


def see(track: PerceptTrack, pose: Pose, now: float, eye: Vector3 = CAMERA, *, is_expected: bool = False) -> None:
    """Let a track take in where a camera sees its object."""
    track.add([Given(track, weighed([SeenObject("cube", pose, now, eye)], CONFIG)[0], is_expected)])


class Watcher:
    """Feeds a track with percepts of a true pose, ten a second."""

    def __init__(self, seed: int = 0, *, believed: bool = False) -> None:
        self.camera = SyntheticCamera(seed, bias=(0.0, 0.0))
        self.camera.tilt_outliers = 0.0
        self.track = PerceptTrack(CONFIG)
        self.now = 100.0
        if believed:
            self.track.forget()

    def see(self, truth: Pose, times: int = 1) -> None:
        for _ in range(times):
            self.now += 0.1
            percept = self.camera.percept("cube", truth, self.now)
            see(self.track, percept, self.now)

    def error(self, truth: Pose) -> float:
        estimate = self.track.estimate
        assert estimate is not None
        return float(np.linalg.norm(estimate.position - truth.t))


def test_averaging_brings_the_estimate_closer() -> None:
    errors = []
    for seed in range(10):
        watcher = Watcher(seed)
        watcher.see(HERE, 1)
        first = watcher.error(HERE)
        watcher.see(HERE, 99)
        errors.append((first, watcher.error(HERE)))
    before, after = np.mean(errors, axis=0)
    assert after < before / 5
    assert after < 0.0006


@pytest.mark.parametrize(("scatter", "noise"), [(0.0, 1 / 3), (0.3, 1 / 3), (0.8, 0.64), (1.0, 1.0)])
def test_scatter_tells_what_is_noise_and_what_is_constant(scatter: float, noise: float) -> None:
    """Percepts with stated deviations of 2 mm and 0.02 rad scatter by a multiple of these, in all directions."""
    rng, track = np.random.default_rng(3), PerceptTrack(CONFIG)
    covariance = np.diag([0.002**2] * 3 + [0.02**2] * 3)
    (stated,) = weighed([SeenObject("cube", HERE.with_covariance(covariance), 0.0, CAMERA)], CONFIG)
    roots = [np.linalg.cholesky(block) for block in stated.covariances]
    for k in range(100):
        shift, turn = (scatter * root @ rng.normal(size=3) for root in roots)
        there = Pose(tuple(np.add(HERE.t, shift)), Pose.from_rotvec((0.0, 0.0, 0.0), tuple(turn)).q, 0.0, covariance)
        see(track, there, 0.1 * (k + 1))
    assert track.estimate is not None
    assert track.estimate.noise_shares == pytest.approx((noise, noise), rel=0.4)


def test_noise_across_the_viewing_ray_is_not_less_because_there_is_none_along_it() -> None:
    """Depth is stated to be noisy, and is constant. A known height takes depth away, and leaves what is across."""
    rng, track = np.random.default_rng(3), PerceptTrack(CONFIG)
    covariance = np.diag([0.002**2] * 3 + [0.02**2] * 3)
    (stated,) = weighed([SeenObject("cube", HERE.with_covariance(covariance), 0.0, CAMERA)], CONFIG)
    across, root = np.eye(3) - np.outer(stated.ray, stated.ray), np.linalg.cholesky(stated.position_covariance)
    shares = []
    for k in range(400):
        shift = across @ root @ rng.normal(size=3)
        see(track, Pose(tuple(np.add(HERE.t, shift)), HERE.q, 0.0, covariance), 0.1 * (k + 1))
        assert track.estimate is not None
        shares.append(track.estimate.noise_shares[0])
    assert np.mean(shares) == pytest.approx(1.0, abs=0.1)


def test_until_percepts_scatter_their_noise_is_as_stated() -> None:
    watcher = Watcher()
    watcher.see(HERE, 1)
    assert watcher.track.estimate is not None
    assert watcher.track.estimate.noise_shares == (1.0, 1.0)


def test_a_way_that_has_ended_does_not_count_as_noise() -> None:
    """A thing is doubted when it is seen elsewhere; where it rests then, its percepts do not scatter."""
    track, covariance = PerceptTrack(CONFIG), np.diag([0.004**2] * 3 + [0.02**2] * 3)
    for k, x in enumerate((0.4, 0.412, *[0.424] * 45)):
        see(track, cube_at(x, 0.1).with_covariance(covariance), 0.1 * (k + 1))
    assert track.estimate is not None
    assert track.estimate.noise_shares[0] < 0.5


def test_the_covariance_shrinks_with_the_noise_but_not_with_the_bias() -> None:
    watcher = Watcher()
    watcher.see(HERE, 1)
    once = watcher.track.estimate
    watcher.see(HERE, 50)
    often = watcher.track.estimate
    assert once is often is not None
    noise, total = often.position_covariance, often.total_covariance(CONFIG.depth_bias)
    assert np.sqrt(np.linalg.eigvalsh(noise)[-1]) < 0.001
    assert np.sqrt(often.ray @ total @ often.ray) == pytest.approx(CONFIG.depth_bias, rel=0.01)


@pytest.mark.parametrize("count", [30, 100, 150, 400])
def test_an_average_is_as_far_off_as_its_covariance_tells(count: int) -> None:
    """Of percepts whose noise is as stated: also of more than a window's, of which the older ones count less."""
    rng, covariance = np.random.default_rng(7), np.diag([0.002**2, 0.001**2, 0.002**2, 0.02**2, 0.02**2, 0.03**2])
    (stated,) = weighed([SeenObject("cube", HERE.with_covariance(covariance), 0.0, CAMERA)], CONFIG)
    drawn = [np.linalg.cholesky(block) @ rng.normal(size=(count, 3, 60)) for block in stated.covariances]
    estimates: list[Estimate] = []
    places, turns = (np.moveaxis(block, -1, 1) for block in drawn)
    for shifts, turned in zip(places, turns, strict=True):
        percepts = [
            dataclasses.replace(stated, position=HERE.t + shift, rotation=quaternions.from_rotvec(tuple(turn)))
            for shift, turn in zip(shifts, turned, strict=True)
        ]
        if not estimates:
            estimates = [Estimate(percept, CONFIG) for percept in percepts]
        else:
            fuse(estimates, percepts, innovations(estimates, percepts))
    off = np.array([(one.position - HERE.t, quaternions.to_rotvec(one.rotation)) for one in estimates])
    told = np.array([one.covariances for one in estimates])
    squares = np.einsum("nki,nkij,nkj->nk", off, np.linalg.inv(told), off)
    assert squares.mean(axis=0) == pytest.approx(3.0, rel=0.25)


@pytest.mark.parametrize("slope", [0.05, 0.3, 0.6, 1.0])
def test_heights_tell_of_the_error_of_depth_as_much_as_the_ray_is_steep(slope: float) -> None:
    """The covariance of the posterior, by the information of a height that is known to 2 mm, and by the prior."""
    eye = (0.4 - math.sqrt(1.0 - slope**2), 0.1, 0.02 + slope)
    track, off = PerceptTrack(CONFIG), 0.003
    see(track, cube_at(0.4, 0.1), 1.0, eye)
    assert track.estimate is not None
    error = track.estimate.error_given(0.02 - off)
    assert error is not None
    assert error.std == pytest.approx((1.0 / CONFIG.depth_bias**2 + (slope / 0.002) ** 2) ** -0.5)
    assert error.mean == pytest.approx(-slope * off * (error.std / 0.002) ** 2)
    assert track.estimate.error_given(0.02 - 4.0 * CONFIG.depth_bias * slope - 0.008) is None, "more must be wrong"


@pytest.mark.parametrize("wrong", [cube_at(0.3, 0.2), cube_at(0.4, 0.1, 0.2), cube_at(0.4, 0.1, yaw=0.5)])
def test_one_or_two_wrong_frames_change_nothing(wrong: Pose) -> None:
    watcher = Watcher()
    watcher.see(HERE, 20)
    for times in (1, 2):
        watcher.track.take_change()
        watcher.see(wrong, times)
        assert not watcher.track.take_change()
        watcher.see(HERE, 1)
    assert watcher.track.restarts == 1
    assert watcher.error(HERE) < 0.002


@pytest.mark.parametrize("there", [cube_at(0.415, 0.1), cube_at(0.2, -0.1), cube_at(0.4, 0.1, 0.06)])
def test_a_move_is_followed_after_three_frames(there: Pose) -> None:
    watcher = Watcher()
    watcher.see(HERE, 50)
    watcher.see(there, CONFIG.confirm_frames)
    assert watcher.error(there) < 0.004
    assert not watcher.track.moving


def test_a_turn_in_place_keeps_the_position_that_was_averaged() -> None:
    watcher = Watcher()
    watcher.see(HERE, 50)
    assert watcher.track.estimate is not None
    position = watcher.track.estimate.position
    watcher.see(cube_at(0.4, 0.1, yaw=0.785), 3)
    turned = watcher.track.estimate
    assert turned.position == pytest.approx(position, abs=1e-9)
    assert Pose(rotation=turned.rotation).distance(cube_at(0, 0, yaw=0.785))[1] < 0.03


def test_a_move_of_three_millimetres_is_followed_within_a_second() -> None:
    watcher = Watcher()
    watcher.see(HERE, 100)
    watcher.see(cube_at(0.403, 0.1), 10)
    assert watcher.track.estimate is not None
    assert watcher.track.estimate.position[0] == pytest.approx(0.403, abs=0.001)


class Coloured:
    """Feeds a track with percepts that tell no rotation, as those by colour, ten a second: 2.5 mm off or as told."""

    def __init__(self, seed: int) -> None:
        self.rng, self.track, self.now = np.random.default_rng(seed), PerceptTrack(CONFIG), 100.0

    def see(self, x: float, off: float = 0.0, std: float = 0.0025) -> None:
        self.now += 0.1
        covariance = np.diag([std**2] * 3 + [math.pi**2] * 3)
        position = np.array((x + off, 0.1, 0.02)) + self.rng.normal(0.0, std, 3)
        see(self.track, Pose(position, covariance=covariance), self.now)

    def error(self, x: float) -> float:
        assert self.track.estimate is not None
        return float(np.linalg.norm(self.track.estimate.position - (x, 0.1, 0.02)))


def test_a_move_of_four_standard_deviations_is_followed_by_as_few_percepts_as_tell_it() -> None:
    """Percepts of a colour are 2.5 mm off: single ones seldom tell of 10 mm, and of the last ten too few are newer."""
    assert np.median([_percepts_until_followed(seed, 0.01) for seed in range(20)]) <= 5


def test_a_false_percept_among_the_newest_hides_no_small_move() -> None:
    """Each fifth is false: of as many percepts as disagree most, one is then no percept of the same pose."""
    assert max(_percepts_until_followed(seed, 0.008, false=5) for seed in range(20)) < 30


def _percepts_until_followed(seed: int, move: float, false: int = 1000) -> int:
    """How many percepts tell a move to 4 mm, at most 100, if each `false`-th is a decimetre off."""
    seen = Coloured(seed)
    for _ in range(40):
        seen.see(0.4)
    for k in range(1, 100):
        seen.see(0.4 + move, 0.1 if k % false == 0 else 0.0)
        if seen.error(0.4 + move) < 0.004:
            return k
    return 100


def test_each_percept_counts_by_its_own_noise() -> None:
    """An object at rest, seen well and badly by turns: bad percepts seem to be a move to who takes them for good."""
    errors = []
    for seed in range(5):
        seen = Coloured(seed)
        for k in range(100):
            seen.see(0.4, std=0.001 if k % 2 else 0.01)
            if k >= 30:
                errors.append(seen.error(0.4))
    assert np.sqrt(np.mean(np.square(errors))) < 0.0005, "half of what a good one is off"


def test_a_small_move_is_known_no_better_than_its_percepts_tell_it() -> None:
    """Six percepts after a move of 10 mm: one of a hundred squared errors is over 11.3 times what is told of them."""
    found = []
    for seed in range(40):
        seen = Coloured(seed)
        for k in range(66):
            seen.see(0.4 if k < 60 else 0.41)
        estimate = seen.track.estimate
        assert estimate is not None
        off = estimate.position - (0.41, 0.1, 0.02)
        found.append(off @ np.linalg.solve(estimate.position_covariance, off))
    assert np.mean(np.array(found) > 11.3) < 0.05


@pytest.mark.parametrize("at_rest", [3, 6])
def test_what_has_come_to_rest_is_where_all_percepts_have_it_that_agree(at_rest: int) -> None:
    watcher = Watcher()
    for step in range(6 - at_rest):
        watcher.see(cube_at(0.3 + 0.03 * step, 0.1))
    watcher.see(HERE, at_rest)
    watcher.track.begin_anew(watcher.now - 0.55)
    estimate = watcher.track.estimate
    assert estimate is not None and estimate.count == at_rest and not watcher.track.moving
    assert watcher.error(HERE) < 0.003


def test_an_estimate_from_before_a_gap_is_not_what_is_seen_after_it() -> None:
    watcher = Watcher()
    watcher.see(HERE, 20)
    assert watcher.track.estimate_at(watcher.now) is watcher.track.estimate
    watcher.now += 3.0
    watcher.see(cube_at(0.2, -0.1))
    assert watcher.track.estimate_at(watcher.now) is None
    glance = watcher.track.glance_at(watcher.now)
    assert glance is not None and glance.position == pytest.approx((0.2, -0.1, 0.02), abs=0.02)
    watcher.see(HERE)
    assert watcher.track.estimate_at(watcher.now) is not None and watcher.track.glance_at(watcher.now) is None


def errors_after_a_gap(nudge: float, percepts: int) -> list[float]:
    """m, of many estimates of 30 percepts with 3 mm of noise, then a gap, a `nudge` (m), and some percepts more."""
    covariance, errors = np.diag([0.003**2] * 3 + [0.02**2] * 3), []
    for seed in range(20):
        rng, track, truth, now = np.random.default_rng(seed), PerceptTrack(CONFIG), np.array(HERE.t), 100.0
        for k in range(30 + percepts):
            now += 5.0 if k == 30 else 0.1
            truth = np.add(truth, (nudge, 0.0, 0.0)) if k == 30 else truth
            x, y, z = truth + rng.normal(scale=0.003, size=3)
            see(track, Pose((x, y, z), HERE.q, 0.0, covariance), now)
        assert track.estimate is not None
        errors.append(float(np.linalg.norm(track.estimate.position - truth)))
    return errors


def test_what_was_moved_unseen_by_little_is_where_all_percepts_since_then_have_it() -> None:
    assert np.median(errors_after_a_gap(0.004, 25)) < 0.0015


def test_what_stayed_unseen_is_known_as_well_as_before() -> None:
    assert np.median(errors_after_a_gap(0.0, 5)) < 0.001


def test_percepts_of_a_slow_camera_that_are_set_aside_are_no_gap() -> None:
    watcher = Watcher()
    for truth in [HERE] * 20 + [cube_at(0.2, -0.1)] * (CONFIG.confirm_frames - 1):
        watcher.now += 0.3
        watcher.see(truth)
        assert watcher.track.estimate_at(watcher.now) is not None


def test_an_object_on_its_way_is_followed_frame_by_frame() -> None:
    watcher = Watcher()
    watcher.see(HERE, 20)
    for step in range(1, 11):
        there = cube_at(0.4 - 0.03 * step, 0.1)
        watcher.see(there)
        if step >= CONFIG.confirm_frames:
            assert watcher.track.moving
            assert watcher.error(there) < 0.015
    watcher.see(there, 3)
    assert not watcher.track.moving


def test_a_belief_is_not_replaced_by_a_single_frame() -> None:
    watcher = Watcher(believed=True)
    watcher.see(HERE, CONFIG.confirm_frames - 1)
    assert watcher.track.estimate is None
    watcher.see(HERE)
    assert watcher.track.estimate is not None


def test_a_belief_that_was_right_needs_no_second_frame() -> None:
    watcher = Watcher(believed=True)
    see(watcher.track, HERE, watcher.now, is_expected=True)
    assert watcher.track.estimate is not None and watcher.error(HERE) == 0.0
    watcher.see(HERE, 20)
    see(watcher.track, cube_at(0.3, 0.2), watcher.now + 0.1, is_expected=True)
    assert watcher.error(HERE) < 0.002, "what is seen steadily is not believed by guessing"


def test_a_percept_that_is_not_newer_is_ignored() -> None:
    watcher = Watcher()
    watcher.see(HERE)
    watcher.track.take_change()
    watcher.now -= 0.1
    watcher.see(HERE)
    assert not watcher.track.take_change()


def test_freshness_ages_out() -> None:
    watcher = Watcher()
    assert not watcher.track.is_fresh(watcher.now)
    watcher.see(HERE)
    assert watcher.track.is_fresh(watcher.now + 0.6)
    assert not watcher.track.is_fresh(watcher.now + 0.8)


def percept_of(pose: Pose) -> WeighedPercept:
    return weighed([SeenObject("cube", pose, 1.0, CAMERA)], CONFIG)[0]


def added(percept: WeighedPercept) -> np.ndarray:
    """What the configuration adds to a percept's covariance."""
    along = np.outer(percept.ray, percept.ray)
    return CONFIG.position_noise**2 * np.eye(3) + CONFIG.depth_noise**2 * along


def test_the_bias_that_a_covariance_includes_is_no_noise() -> None:
    position, tag = np.array((0.5, 0.1, 0.02)), np.array((0.5, 0.1, 0.04))
    ray = (tag - CAMERA) / np.linalg.norm(tag - CAMERA)
    along = np.outer(ray, ray)
    covariance = np.diag([1e-8] * 6)
    covariance[:3, :3] += (CONFIG.depth_bias**2 + 4e-6) * along
    percept = percept_of(Pose(position, covariance=covariance))
    assert percept.ray == pytest.approx(ray, abs=1e-9)
    assert percept.position_covariance - added(percept) == pytest.approx(4e-6 * along, abs=2e-8)


def test_covariance_is_turned_from_the_object_into_the_world() -> None:
    covariance = np.diag([2.5e-5, 1e-6, 1e-6, 1e-2, 1e-4, 1e-4])
    percept = percept_of(Pose.from_rotvec((0.4, 0.1, 0.02), (0.0, 0.0, np.pi / 2), covariance=covariance))
    assert percept.position_covariance - added(percept) == pytest.approx(np.diag([1e-6, 2.5e-5, 1e-6]), abs=1e-12)
    assert np.argmax(np.diag(percept.rotation_covariance)) == 1


def test_without_covariance_the_default_is_longest_along_the_ray() -> None:
    percept = percept_of(Pose((0.4, 0.1, 0.02)))
    values, vectors = np.linalg.eigh(percept.position_covariance)
    assert abs(vectors[:, -1] @ percept.ray) == pytest.approx(1.0)
    assert values[-1] > 2 * values[0]


def test_an_indefinite_covariance_is_refused() -> None:
    covariance = np.diag([1e-6] * 6)
    covariance[0, 1] = covariance[1, 0] = 1e-4
    wrong, right = SeenObject("a", Pose((0.4, 0.1, 0.02), covariance=covariance), 1.0), SeenObject("b", HERE, 1.0)
    assert [flaw[:26] for flaw in flaws([right, wrong, right])] == ["", "covariance with eigenvalue", ""]
