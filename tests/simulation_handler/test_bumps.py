"""A camera that is bumped drives nothing that rests, of any kind, whether a hand is in view or not."""

from __future__ import annotations

import pytest

from dsr.math3d.transforms import Pose, interpolate
from tests.simulation_handler.occluded import BOX, SMALL, Occlusion, standing

PLACES = {"cup_1": (0.2, -0.2), "cup_2": (0.55, -0.1), "cup_3": (0.25, 0.25), "cup_4": (0.5, 0.3)}
BUMPS = [
    Pose.from_rotvec((0.04, -0.02, 0.02), (0.02, -0.03, 0.05)),
    Pose.from_rotvec((-0.01, 0.015, -0.03), (-0.02, 0.01, 0.03)),
    Pose.from_rotvec((0.02, 0.0, 0.0), (0.0, 0.0, -0.1)),
]


def cups(seed: int, noise: float = 0.002) -> Occlusion:
    """Four cups, and a box that a hand lifts."""
    truths = {name: standing(x, y, SMALL) for name, (x, y) in PLACES.items()}
    world = Occlusion(truths | {"box": standing(0.75, 0.05, BOX)}, seed, noise)
    world.run(1.0)
    world.hand("box")
    world.run(1.0)
    world.move("box", standing(0.75, 0.05, BOX, on=0.15))
    return world


def bump(world: Occlusion, motion: Pose) -> None:
    """Let the camera be elsewhere than the belief takes it to be."""
    perceive, noisy = world.percept, world.noisy

    def bumped(name: str) -> Pose:
        pose = motion @ perceive(name)
        return Pose(pose.t, pose.q, world.now)

    def bumped_hand(pose: Pose) -> Pose:
        seen = motion @ noisy(pose)
        return Pose(seen.t, seen.q, world.now)

    world.percept, world.noisy = bumped, bumped_hand  # type: ignore[method-assign]


@pytest.mark.parametrize("motion", BUMPS)
@pytest.mark.parametrize("seed", range(2))
def test_what_rests_stays_where_it_is_believed_when_the_camera_is_bumped(seed: int, motion: Pose) -> None:
    world = cups(seed)
    bump(world, motion)
    before, end = world.truths["box"].with_stamp(0.0), standing(0.75, 0.2, BOX, on=0.15).with_stamp(40.0)
    for tick in range(40):
        world.truths["box"] = interpolate(before, end, float(tick))
        world.place_hand()
        world.tick()
        assert max(map(world.error, PLACES)) < 0.01
    assert world.belief.supports().keys() >= {(name, "table") for name in PLACES}
    assert set(world.texts()) == {"camera_moved()"}


@pytest.mark.parametrize("motion", BUMPS)
def test_the_likeliest_world_has_what_rests_where_it_was_from_the_first_percept_on(motion: Pose) -> None:
    world = cups(0)
    bump(world, motion)
    for _ in range(20):
        world.tick()
        best = {name: state for island in world.belief.islands() for name, state in island.best.objects.items()}
        for name in PLACES:
            pose = best[name].pose
            assert pose is not None and pose.distance(world.truths[name])[0] < 0.01


def test_what_set_out_before_the_others_showed_the_bump_is_put_back() -> None:
    world = cups(0)
    perceive, begin = world.percept, world.now
    bump(world, BUMPS[0])
    bumped = world.percept

    def one_first(name: str) -> Pose:
        return (bumped if name == "cup_1" or world.now > begin + 0.3 else perceive)(name)

    world.percept = one_first  # type: ignore[method-assign]
    errors = []
    for _ in range(20):
        world.tick()
        errors.append(world.error("cup_1"))
    assert max(errors) > 0.01
    assert errors[-1] < 0.005


def test_what_only_a_camera_in_doubt_shows_elsewhere_stays_until_that_is_known_to_stand() -> None:
    world = cups(0)
    world.belief.doubt_cameras({""}, standing=())
    world.move("cup_1", standing(0.2, 0.0, SMALL))
    assert world.error("cup_1") > 0.15
    world.belief.doubt_cameras((), standing={""})
    world.run(3.0)
    assert world.error("cup_1") < 0.01


def test_a_thing_that_moved_is_probably_where_its_first_percept_since_has_it() -> None:
    world = cups(0)
    world.truths["cup_1"] = standing(0.2, 0.0, SMALL)
    world.tick()
    world.tick()
    assert world.error("cup_1") > 0.15
    island = next(island for island in world.belief.islands() if "cup_1" in island.names)
    there = [(one.weight, one.objects["cup_1"].pose) for one in island.worlds]
    assert sum(weight for weight, pose in there if pose and pose.distance(world.truths["cup_1"])[0] < 0.01) > 0.5


@pytest.mark.parametrize("seed", range(2))
def test_what_a_camera_that_is_known_to_stand_shows_on_its_way_is_driven(seed: int) -> None:
    world = cups(seed)
    world.belief.doubt_cameras((), standing={""})
    starts = {name: world.truths[name] for name in PLACES}
    for tick in range(1, 21):
        for name, pose in starts.items():
            world.truths[name] = Pose((0.005 * tick, 0.0, 0.0)) @ pose
        world.tick()
    world.run(0.3)
    assert max(map(world.error, PLACES)) < 0.03
    assert world.texts() == []


@pytest.mark.parametrize("names", [["cup_1"], ["cup_1", "cup_2"]])
def test_some_of_several_that_are_pushed_are_driven_at_once(names: list[str]) -> None:
    world = cups(0)
    starts = {name: world.truths[name] for name in names}
    for tick in range(1, 21):
        for name, pose in starts.items():
            world.truths[name] = Pose((0.0, 0.005 * tick, 0.0)) @ pose
        world.tick()
        assert max(map(world.error, names)) < 0.04
    assert world.texts() == []
