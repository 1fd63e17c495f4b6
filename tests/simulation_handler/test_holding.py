"""Grasped objects: they go where the gripper goes, and obey physics again when it lets go."""

from __future__ import annotations

import pytest

from dsr.math3d.transforms import Pose
from simulation_handler.motion.holding import GripperGrasp
from tests.simulation_handler.worlds import World, cube_at

GRIPPER = Pose.from_rotvec((0.4, 0.1, 0.14), (3.14159, 0.0, 0.0))


@pytest.fixture
def world() -> World:
    world = World({"a": cube_at(0.4, 0.1), "b": cube_at(0.3, -0.1)})
    world.run(2.0)
    world.seen = {"b"}
    return world


def carry(world: World, pose: Pose, seconds: float = 0.1) -> None:
    for _ in range(round(seconds / 0.05)):
        world.belief.hold({"a": GripperGrasp("gripper", pose)})
        world.tick()


def test_a_grasped_object_moves_with_the_gripper_and_is_no_surprise(world: World) -> None:
    carry(world, GRIPPER)
    carry(world, Pose((0.0, -0.05, 0.2)) @ GRIPPER, 2.0)
    assert world.pose("a").t == pytest.approx((0.4, 0.05, 0.22), abs=1e-3)
    assert world.belief.plausible("a")
    assert world.belief.supports().keys() == {("b", "table")}
    assert world.belief.explanations() == []


def test_what_is_let_go_falls(world: World) -> None:
    carry(world, GRIPPER)
    carry(world, Pose((0.0, 0.0, 0.05)) @ GRIPPER)
    world.belief.hold({})
    world.run(1.0)
    assert world.pose("a").t == pytest.approx((0.4, 0.1, 0.02), abs=2e-3)
    assert ("a", "table") in world.belief.supports()


def test_percepts_of_what_is_held_are_ignored(world: World) -> None:
    carry(world, GRIPPER)
    world.seen = {"a", "b"}
    world.truths["a"] = cube_at(0.5, 0.1)
    carry(world, GRIPPER, 1.0)
    assert world.pose("a").t == pytest.approx((0.4, 0.1, 0.02), abs=1e-3)
    world.belief.hold({})
    world.run(1.0)
    assert world.error("a") < 0.003


def test_a_held_object_that_is_no_more_is_forgotten(world: World) -> None:
    carry(world, GRIPPER)
    world.belief.remove("a")
    world.belief.hold({"a": GripperGrasp("gripper", GRIPPER)})
    world.seen = {"b"}
    world.tick()
    assert "a" not in world.belief


def test_where_the_gripper_says_that_it_holds_it_counts_not_where_it_was_believed(world: World) -> None:
    gripper_from_object = Pose((0.0, 0.0, 0.12))
    world.belief.hold({"a": GripperGrasp("gripper", Pose((0.1, -0.05, 0.1)) @ GRIPPER, gripper_from_object)})
    world.tick()
    assert world.pose("a").t == pytest.approx((0.5, 0.05, 0.12), abs=1e-4)
