"""Did the camera move, or the objects? In one view, and in several."""

from __future__ import annotations

import numpy as np
import pytest

from agents.calibrator.solve.calibrate import calibrate
from agents.calibrator.solve.problem import ObjectSighting
from agents.calibrator.watch.decision import Decision, alike, bumped, decide, decide_elsewhere
from dsr.math3d.transforms import Pose
from tests.agents.calibrator.scenes import BUMP, CLUSTER, DOWN, FLIP, cubes, sightings

MOVED = Pose((0.05, 0.03, 0.0))
HERE = Pose.identity()


def found(seen: list[ObjectSighting], believed: Pose = DOWN) -> Decision:
    return decide(seen, believed, calibrate(seen, believed), HERE)


def moved_alike(world_from_world: Pose, names: list[str]) -> dict[str, Pose]:
    """Offsets in the objects' frames that move them so in the world."""
    return {name: pose.inverse() @ world_from_world @ pose for name, pose in cubes().items() if name in names}


def noisy(**options: object) -> list[ObjectSighting]:
    return sightings(cubes(), rng=np.random.default_rng(0), **options)  # type: ignore[arg-type]


def test_all_displaced_by_one_motion_is_a_moved_camera() -> None:
    decision = found(noisy(), DOWN @ BUMP)
    assert decision.moved and not decision.is_ambiguous and "left the table" in decision.why


@pytest.mark.parametrize("wrong", [FLIP, MOVED])
def test_beside_it_one_of_four_may_have_moved_or_be_seen_falsely(wrong: Pose) -> None:
    assert found(noisy(wrong={"cube_2": wrong}), DOWN @ BUMP).moved


@pytest.mark.parametrize("names", [["cube_1"], ["cube_1", "cube_3"], ["cube_1", "cube_2", "cube_3"]])
def test_as_long_as_one_is_seen_where_it_is_believed_the_others_moved(names: list[str]) -> None:
    decision = found(noisy(wrong=moved_alike(MOVED, names)))
    assert decision.moved is False and f"{4 - len(names)} of 4 objects are seen where" in decision.why


@pytest.mark.parametrize("count", [7, 9, 12])
def test_one_in_its_place_counts_for_as_many_as_were_moved_alike(count: int) -> None:
    objects = cubes([(0.08 * (k % 4) - 0.12, 0.1 * (k // 4) - 0.1) for k in range(count)])
    moved = {name: pose.inverse() @ MOVED @ pose for name, pose in objects.items() if name != "cube_2"}
    decision = found(sightings(objects, rng=np.random.default_rng(0), wrong=moved))
    assert decision.moved is False and f"1 of {count} objects" in decision.why


def test_there_is_nothing_to_explain_if_all_is_in_its_place() -> None:
    decision = found(noisy())
    assert decision.moved is False and decision.is_idle
    assert not found(noisy(wrong=moved_alike(MOVED, ["cube_1"]))).is_idle


def test_a_single_flipped_percept_moves_no_camera() -> None:
    assert found(noisy(wrong={"cube_2": FLIP})).moved is False


@pytest.mark.parametrize("motion", [MOVED, Pose.from_rotvec((0.01, 0.0, 0.0), (0.0, 0.0, 0.3))])
def test_all_moved_alike_on_the_table_looks_like_a_moved_camera(motion: Pose) -> None:
    decision = found(noisy(wrong=moved_alike(motion, list(cubes()))))
    assert decision.moved and decision.is_ambiguous


def test_weak_geometry_leaves_it_open() -> None:
    seen = sightings(cubes(CLUSTER), rng=np.random.default_rng(0))
    decision = found(seen, DOWN @ BUMP)
    assert decision.moved is None and "geometry is weak" in decision.why


TURNED = Pose.from_rotvec((0.0, 0.0, 0.0), (0.3, 0.0, 0.9))


@pytest.mark.parametrize("is_camera", [True, False])
def test_a_view_from_elsewhere_tells(is_camera: bool) -> None:
    parents = {0: HERE, 1: TURNED}
    wrong = {} if is_camera else moved_alike(MOVED, list(cubes()))
    truth = (DOWN if not is_camera else MOVED.inverse() @ DOWN)  # fmt: skip
    seen = sightings(
        cubes(), truth, rng=np.random.default_rng(0), wrong=wrong, parents=list(parents.values())
    )  # fmt: skip
    first = [one for one in seen if one.view == 0]
    assert found(first).is_ambiguous
    common = alike(DOWN, calibrate(first, DOWN).pose, HERE)
    assert common.distance(MOVED)[0] < 0.003
    after = calibrate(seen, DOWN).pose
    decision = decide_elsewhere(seen, DOWN, after, common, parents, last=False)
    assert decision.moved is is_camera and not decision.is_ambiguous and "2 views tell" in decision.why


def test_the_same_view_again_tells_nothing_unless_it_must() -> None:
    parents = {0: HERE, 1: Pose((0.1, 0.0, 0.0))}
    wrong = moved_alike(MOVED, list(cubes()))
    seen = sightings(cubes(), rng=np.random.default_rng(0), wrong=wrong, parents=list(parents.values()))
    common, after = alike(DOWN, calibrate(seen, DOWN).pose, HERE), calibrate(seen, DOWN).pose
    assert decide_elsewhere(seen, DOWN, after, common, parents, last=False).moved is None
    assert decide_elsewhere(seen, DOWN, after, common, parents, last=True).moved is not None


def after_bump(seen: list[ObjectSighting], believed: Pose) -> Decision:
    """The decision about a camera on a stand."""
    return decide(seen, believed, calibrate(seen, believed, prior=bumped(believed)), HERE)


@pytest.mark.parametrize("bare", [(), ("cube_1",)])
def test_two_objects_of_which_one_shows_how_it_is_turned_tell_of_a_bumped_camera(bare: tuple[str, ...]) -> None:
    places = dict(list(cubes().items())[:2])
    decision = after_bump(sightings(places, rng=np.random.default_rng(0), bare=bare), DOWN @ BUMP)
    assert decision.moved and not decision.is_ambiguous
    moved = moved_alike(MOVED, list(places))
    on_table = after_bump(sightings(places, rng=np.random.default_rng(0), bare=bare, wrong=moved), DOWN)
    assert on_table.moved is False, "two objects may be moved alike on the table"


def test_places_of_two_objects_fit_a_moved_camera_anyway() -> None:
    places = dict(list(cubes().items())[:2])
    seen = sightings(places, rng=np.random.default_rng(0), bare=tuple(places))
    decision = after_bump(seen, DOWN @ BUMP)
    assert decision.moved is None and "only 2 object(s) tell" in decision.why


def test_one_object_tells_of_no_camera() -> None:
    (name, pose), *_ = cubes().items()
    decision = after_bump(sightings({name: pose}, rng=np.random.default_rng(0)), DOWN @ BUMP)
    assert decision.moved is None and "only 1 object(s) tell" in decision.why


def test_what_hovers_was_hardly_moved_by_somebody() -> None:
    places = dict(list(cubes().items())[:2])
    for rise, is_camera in ((0.0, False), (0.03, True)):
        wrong = moved_alike(Pose((0.03, 0.02, rise)), list(places))
        decision = after_bump(sightings(places, rng=np.random.default_rng(0), wrong=wrong), DOWN)
        assert bool(decision.moved) is is_camera
