"""A camera that moved is told from objects that did, by how many of them one motion of the camera explains."""

from __future__ import annotations

import pytest

from dsr.math3d.transforms import Pose
from tests.simulation_handler.explaining.scenes import after, errors, shift
from tests.simulation_handler.worlds import World, cube_at

PLACES = {"cube_3": (0.42, 0.08), "cube_4": (0.30, 0.08), "cube_5": (0.30, -0.08), "cube_6": (0.42, -0.08)}
BUMP = Pose.from_rotvec((0.02, 0.015, 0.0), (0.01, -0.02, 0.05))
AWAY = Pose.from_rotvec((0.02, 0.015, 0.06), (0.03, -0.02, 0.05))


def four_cubes(seed: int = 0, **by: str) -> World:
    """Four cubes; by another camera where its name is given."""
    world = World({name: cube_at(x, y) for name, (x, y) in PLACES.items()}, seed, rays=True)
    world.by = by
    world.run(2.0)
    return world


def bump(world: World, motion: Pose = BUMP) -> None:
    perceive = world.camera.percept

    def bumped(name: str, truth: Pose, stamp: float) -> Pose:
        percept = perceive(name, truth, stamp)
        if name in world.by:
            return percept
        moved = motion @ percept
        return Pose(moved.t, moved.q, stamp, percept.cov)

    world.camera.percept = bumped  # type: ignore[method-assign]


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_camera_and_a_cube_that_moved_are_both_told(seed: int) -> None:
    world = four_cubes(seed)
    shift(world, ["cube_3"], -0.05, 0.03)
    result = after(world, bump)
    assert set(result.explanations) == {"camera_moved() & moved_alone(cube_3)"}
    assert all(error < 0.005 for name, error in errors(world).items() if name != "cube_3")


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_what_is_not_seen_any_more_since_the_camera_moved_does_not_speak_against_that(seed: int) -> None:
    world = four_cubes(seed)
    shift(world, ["cube_3"], -0.05, 0.03)

    def bump_away(world: World) -> None:
        bump(world, AWAY)
        world.seen.discard("cube_4")

    result = after(world, bump_away)
    assert set(result.explanations) == {"camera_moved() & moved_alone(cube_3)"}


@pytest.mark.parametrize("moved", [["cube_3"], ["cube_3", "cube_6"], ["cube_3", "cube_4", "cube_6"]])
def test_cubes_that_moved_alike_are_no_camera_as_long_as_one_has_stayed(moved: list[str]) -> None:
    world = four_cubes()
    result = after(world, lambda _: shift(world, moved, -0.05, 0.03))
    assert not any("camera_moved()" in text for text in result.explanations)
    assert result.recovered_after is not None and result.recovered_after <= 0.7


def test_what_is_seen_elsewhere_has_moved_once_the_camera_is_known_to_stand() -> None:
    world = four_cubes()
    world.belief.doubt_cameras((), standing={"camera"})
    result = after(world, lambda _: shift(world, list(PLACES), -0.05, 0.03))
    assert result.explanations == (" & ".join(f"moved_alone({name})" for name in PLACES),)
    assert result.recovered_after is not None


def test_nothing_is_explained_while_a_camera_is_in_doubt() -> None:
    world = four_cubes()
    world.belief.doubt_cameras({"camera"}, standing=())
    assert after(world, lambda _: shift(world, ["cube_3"], -0.05, 0.03), 1.5).explanations == ()
    world.belief.doubt_cameras((), standing=())
    assert after(world, lambda _: None).explanations == ("moved_alone(cube_3)",)


def test_what_another_camera_sees_is_explained_while_one_is_in_doubt() -> None:
    world = four_cubes(cube_3="other")
    world.belief.doubt_cameras({"camera"}, standing=())
    result = after(world, lambda _: shift(world, ["cube_3", "cube_4"], -0.05, 0.03))
    assert set(result.explanations) == {"moved_alone(cube_3)"}
    assert result.errors["cube_3"] < 0.005 < result.errors["cube_4"]


def test_what_only_a_camera_in_doubt_should_see_is_not_missing() -> None:
    world = four_cubes(cube_3="other")
    world.belief.doubt_cameras({"camera"}, standing=())
    result = after(world, lambda _: world.seen.discard("cube_4"))
    assert result.explanations == ()


def test_what_another_camera_sees_is_believed_as_that_sees_it_while_one_is_in_doubt() -> None:
    world = four_cubes()
    world.belief.doubt_cameras({"camera"}, standing=())
    bump(world)
    for _ in range(40):
        world.by = {} if world.by else dict.fromkeys(PLACES, "other")
        world.tick()
        world.tick()
    assert all(error < 0.005 for error in errors(world).values())
    assert world.belief.explanations() == []


def test_a_camera_that_is_known_to_stand_does_not_say_so_of_another_one() -> None:
    world = four_cubes(cube_3="other")
    world.belief.doubt_cameras((), standing={"other"})
    shift(world, ["cube_3"], -0.05, 0.03)
    result = after(world, bump)
    assert set(result.explanations) == {"camera_moved() & moved_alone(cube_3)"}
