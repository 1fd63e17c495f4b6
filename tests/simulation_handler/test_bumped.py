"""Whether the camera moved, or things: judged by how all that one camera shows is displaced."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from dsr.math3d import quaternions
from dsr.math3d.transforms import Pose
from simulation_handler.perception import bumped
from simulation_handler.perception.bumped import Displacement, MovedThing, judge

CAMERA = (0.3, -1.0, 0.8)
PLACES = ((0.2, -0.2, 0.0), (0.55, -0.1, 0.02), (0.25, 0.25, 0.0), (0.5, 0.3, 0.05))
BUMP = Pose.from_rotvec((0.01, -0.015, 0.012), (0.02, -0.03, 0.025))
MOVED = MovedThing(sideways=0.1, height=0.0025)
NOISE = 0.003
"""m, standard deviation of percepts"""
SHIFT = Pose((0.04, 0.03, 0.0))
NOTHING = Pose((0.0, 0.0, 0.0))


def displaced(place: tuple[float, float, float], motion: Pose, *, tagged: bool = False) -> Displacement:
    """A thing at a place that is seen where a motion of the world about the camera has it."""
    from_camera = np.subtract(place, CAMERA)
    shift = motion.rotation_matrix @ from_camera + motion.t - from_camera
    x, y, z = from_camera.tolist()
    turn = np.array(quaternions.to_rotvec(motion.q)) if tagged else None
    return Displacement(shift, NOISE**2 * np.eye(3), turn, 0.02**2 * np.eye(3), (x, y, z))


def moved(place: tuple[float, float, float], motion: Pose, *, tagged: bool = False) -> Displacement:
    """A thing at a place that somebody moves by a motion about its own centre."""
    one = displaced(place, NOTHING)
    turn = np.array(quaternions.to_rotvec(motion.q)) if tagged else None
    return one._replace(shift=np.array(motion.t), turn=turn)


def shown(count: int, motion: Pose, *, tagged: bool = False) -> list[Displacement]:
    return [displaced(place, motion, tagged=tagged) for place in PLACES[:count]]


@pytest.mark.parametrize(("count", "tagged"), [(3, False), (4, False), (2, True), (4, True)])
def test_all_displaced_by_one_motion_are_where_they_were(count: int, tagged: bool) -> None:
    verdict = judge(shown(count, BUMP, tagged=tagged), [], MOVED)
    assert verdict.camera_moved > 0.99
    assert verdict.stays.min() > 0.99 and verdict.shown_elsewhere == pytest.approx(verdict.stays, abs=0.01)


@pytest.mark.parametrize("motion", [SHIFT, Pose.from_rotvec((0.02, 0.0, 0.0), (1.6, 0.0, 0.0)), Pose((0.1, 0.1, 0.1))])
@pytest.mark.parametrize("tagged", [False, True])
def test_one_of_several_that_is_displaced_has_moved(motion: Pose, tagged: bool) -> None:
    others = shown(4, NOTHING, tagged=tagged)[1:]
    verdict = judge([moved(PLACES[0], motion, tagged=tagged), *others], [], MOVED)
    assert verdict.camera_moved < 0.01
    assert verdict.stays[0] < 0.01 and verdict.stays[1:].min() > 0.99


@pytest.mark.parametrize("motion", [SHIFT, Pose.from_rotvec((0.02, 0.0, 0.0), (1.6, 0.0, 0.0))])
def test_a_single_thing_that_is_moved_tells_of_no_camera(motion: Pose) -> None:
    verdict = judge([moved(PLACES[0], motion, tagged=True)], [], MOVED)
    assert verdict.camera_moved < 0.1 and verdict.stays[0] < 0.1


def test_beside_a_moved_camera_one_thing_may_have_moved_as_well() -> None:
    things: Sequence[Displacement] = [moved(PLACES[0], Pose((0.15, -0.1, 0.0))), *shown(4, BUMP)[1:]]
    verdict = judge(things, [], MOVED)
    assert verdict.camera_moved > 0.99
    assert verdict.stays[0] < 0.01 and verdict.stays[1:].min() > 0.99


def test_two_bare_places_that_are_displaced_alike_leave_it_open() -> None:
    assert 0.01 < judge([moved(place, SHIFT) for place in PLACES[:2]], [], MOVED).camera_moved < 0.99


@pytest.mark.parametrize("tagged", [False, True])
def test_two_that_are_moved_alike_on_the_level_may_have_moved_together(tagged: bool) -> None:
    verdict = judge([moved(place, SHIFT, tagged=tagged) for place in PLACES[:2]], [], MOVED)
    assert 0.1 < verdict.camera_moved < 0.9
    assert verdict.stays == pytest.approx(verdict.shown_elsewhere, abs=0.01)


def test_what_a_hand_may_have_lifted_has_moved() -> None:
    lifted = moved(PLACES[0], Pose((0.0, 0.0, 0.04)), tagged=True)
    assert judge([lifted], [], MOVED).camera_moved > 0.5
    assert judge([lifted._replace(is_disturbed=True)], [], MOVED).camera_moved < 0.1


@pytest.mark.parametrize("near_hand", [False, True])
def test_a_hand_near_one_thing_does_not_hide_that_the_camera_moved(near_hand: bool) -> None:
    one, *others = shown(4, BUMP)
    verdict = judge([one._replace(is_disturbed=near_hand), *others], [], MOVED)
    assert verdict.camera_moved > 0.99 and verdict.stays.min() > 0.99


@pytest.mark.parametrize("motion", [BUMP, NOTHING])
def test_what_a_load_shows_tells_of_the_load_alone(motion: Pose) -> None:
    with_it = displaced(PLACES[3], motion)
    verdict = judge(shown(3, motion), [with_it, with_it._replace(shift=with_it.shift + np.array(SHIFT.t))], MOVED)
    assert verdict.camera_moved == judge(shown(3, motion), [], MOVED).camera_moved
    assert verdict.stays[3] > 0.99 and verdict.stays[4] < 0.01


def test_of_a_hundred_things_few_sets_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """Adding them one at a time took longer than the time from one step of the belief to the next."""
    rng, looks, scores = np.random.default_rng(1), [0], bumped._OneMotion.scores

    def counted(told: bumped._OneMotion, sets: bumped.Array) -> bumped.Array:
        looks[0] += 1
        return scores(told, sets)

    monkeypatch.setattr(bumped._OneMotion, "scores", counted)
    things = [displaced(tuple(place), NOTHING) for place in rng.uniform(-0.5, 0.5, (100, 3))]
    verdict = judge([one._replace(shift=rng.normal(0.0, NOISE, 3)) for one in things], [], MOVED)
    assert looks[0] < 20
    assert verdict.camera_moved < 0.01 and verdict.stays.min() > 0.99


def test_no_probability_is_beyond_one() -> None:
    for seed in range(100):
        rng = np.random.default_rng(seed)
        things = [
            Displacement(place, 0.001**2 * np.eye(3), turn, 0.02**2 * np.eye(3), CAMERA)
            for place, turn in zip(rng.normal(0.0, 0.0005, (8, 3)) + 0.05, rng.normal(0.0, 0.01, (8, 3)), strict=True)
        ]
        assert judge(things, [], MOVED).stays.max() <= 1.0
