"""What moves a thing decides whether its way is followed or explained: a seen mover, or its inertia; not its type."""

from __future__ import annotations

import pytest

from dsr.math3d.transforms import Pose
from tests.simulation_handler.occluded import BOX, KINDS, PERIOD, Occlusion, standing
from tests.simulation_handler.worlds import BALL, CUBE

FOLLOWED = 0.045
"""m that a body may be behind what goes 0.15 m/s: it sets out with the third percept that is off."""


def alone(name: str, seed: int = 0) -> Occlusion:
    """An object at rest that is seen."""
    world = Occlusion({name: standing(0.3, 0.0, KINDS[name].size)}, seed)
    world.run(1.5)
    return world


def with_hand(name: str, seed: int = 0) -> Occlusion:
    """The same with a hand beside it, which is not seen to touch it."""
    world = alone(name, seed)
    world.hand(name)
    aside = 0.5 * KINDS[name].size[1] + 0.07
    world.tips_from_object = {f"hand_finger_{k}": (0.03 * k, aside, 0.05) for k in (2, 3, 4)}
    world.run(0.5)
    assert world.belief.grasps() == {}
    return world


def slide(world: Occlusion, name: str) -> float:
    """Slide an object by 0.2 m; the farthest (m) that its belief was off on its way."""
    farthest, (x, y, z) = 0.0, world.truths[name].t
    for step in range(1, 11):
        world.move(name, Pose((x, y + 0.02 * step, z)))
        farthest = max(farthest, world.error(name))
    world.run(1.5)
    return farthest


@pytest.mark.parametrize("name", ["cube", "block"])
def test_a_solid_thing_that_nothing_is_known_to_move_is_explained(name: str) -> None:
    world = alone(name)
    slide(world, name)
    assert world.texts() == [f"moved_alone({name})"]
    assert world.error(name) < 0.005


@pytest.mark.parametrize("name", ["cube", "block"])
@pytest.mark.parametrize("seed", range(3))
def test_a_solid_thing_is_followed_on_the_way_on_which_a_hand_may_move_it(name: str, seed: int) -> None:
    world = with_hand(name, seed)
    assert slide(world, name) < FOLLOWED
    assert world.texts() == []
    assert world.error(name) < 0.005


@pytest.mark.parametrize("name", ["cube", "block", "box"])
def test_what_jumps_is_explained_whatever_is_near(name: str) -> None:
    world = with_hand(name)
    world.truths[name] = standing(0.3, -0.3, KINDS[name].size)
    world.run(1.5)
    assert world.texts() == [f"moved_alone({name})"]
    assert world.error(name) < 0.005


@pytest.mark.parametrize("name", ["ball", "box"])
def test_what_rolls_and_what_is_hollow_is_followed_without_a_hand(name: str) -> None:
    world = alone(name)
    assert slide(world, name) < FOLLOWED
    assert world.texts() == []


def test_a_cube_that_a_box_pushes_is_followed() -> None:
    beside = 0.5 * (BOX[1] + CUBE[1])
    world = Occlusion({"box": standing(0.3, -0.2, BOX), "cube": standing(0.3, -0.2 + beside, CUBE)})
    world.run(1.5)
    for step in range(1, round(1.5 / PERIOD) + 1):
        y = -0.2 + 0.15 * PERIOD * step
        world.truths |= {"box": standing(0.3, y, BOX), "cube": standing(0.3, y + beside, CUBE)}
        world.tick()
        assert world.error("cube") < FOLLOWED
    world.run(1.0)
    assert world.texts() == []
    assert world.error("cube") < 0.005


@pytest.mark.parametrize("name", ["ball", "box"])
def test_one_false_percept_moves_nothing(name: str) -> None:
    size = BALL if name == "ball" else BOX
    world = alone(name)
    before, truth = world.pose(name), world.truths[name]
    if world.ticks % 2:  # the next tick has percepts
        world.tick()
    world.truths[name] = standing(0.2, -0.06, size)
    world.tick()
    world.truths[name] = truth
    for _ in range(10):
        world.tick()
        assert world.pose(name).distance(before)[0] < 0.003
    assert world.texts() == []
