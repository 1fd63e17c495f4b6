"""Scenes are values: changed by copy, equal in any order, and sent around."""

from __future__ import annotations

import pickle

import pytest

from simulation_handler.physics.rollouts.scene import RolloutScene
from simulation_handler.physics.simulator import SimulationError
from simulation_handler.shapes.geometry import Solid
from tests.simulation_handler.rollouts.scenes import CUBE, TABLE, cube, random_scene, scene_of
from tests.simulation_handler.worlds import World, cube_at

UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def test_the_order_of_the_bodies_is_of_no_account():
    a, b = cube("a", 0.0, 0.0), cube("b", 0.1, 0.0)
    assert RolloutScene((b, TABLE, a)) == RolloutScene((a, b, TABLE))
    assert RolloutScene((b, TABLE, a)).names == ("a", "b", "table")


def test_changes_leave_the_original_alone():
    scene = scene_of(cube("a", 0.0, 0.0), cube("b", 0.1, 0.0))
    there = ((0.3, 0.0, 0.02), UPRIGHT)
    changed = scene.moved({"a": there}).held(["b"])
    assert (changed["a"].position, changed["a"].rotation) == there and changed["a"].size == CUBE
    assert changed["b"].fixed and not scene["b"].fixed
    assert changed.released(["b"]) == scene.moved({"a": there})
    assert "a" not in scene.without(["a"]) and "a" in scene
    assert scene["a"].position == (0.0, 0.0, 0.02)


@pytest.mark.parametrize(
    "change",
    [
        lambda scene: scene.moved({"cubee_3": ((0.0, 0.0, 0.0), UPRIGHT)}),
        lambda scene: scene.without(["cubee_3"]),
        lambda scene: scene.held(["cubee_3"]),
        lambda scene: scene.released(["cubee_3"]),
        lambda scene: scene["cubee_3"],
    ],
)
def test_an_unknown_name_is_told_with_the_closest_one(change):
    with pytest.raises(SimulationError, match="no body 'cubee_3' in the scene; did you mean 'cube_3'"):
        change(scene_of(cube("cube_3", 0.0, 0.0)))


def test_no_name_may_be_there_twice():
    with pytest.raises(SimulationError, match="'a' is twice"):
        scene_of(cube("a", 0.0, 0.0), cube("a", 0.1, 0.0))


def test_scenes_can_be_sent():
    scene = random_scene(3)
    assert pickle.loads(pickle.dumps(scene)) == scene


def test_a_body_is_a_solid_too():
    assert TABLE.solid == Solid("table", TABLE.size, TABLE.position, UPRIGHT, fixed=True)


def test_the_belief_gives_its_scene_with_what_it_holds():
    world = World({"cube_3": cube_at(0.3, 0.0), "cube_4": cube_at(0.4, 0.0, 0.2)})
    try:
        world.run(2.0)
        scene = world.belief.scene()
        assert scene.names == ("_floor", "cube_3", "cube_4", "table")
        assert scene["_floor"].fixed and scene["table"].fixed
        assert not scene["cube_3"].fixed and scene["cube_4"].fixed, "cube_4 hovers on nothing known"
        assert scene["cube_3"].position == world.pose("cube_3").t
    finally:
        world.belief.close()
