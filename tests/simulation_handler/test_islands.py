"""Islands of weighted worlds: what they refuse, what they say of relations, and that the best agrees with the pose."""

from __future__ import annotations

import pytest

from dsr.math3d.transforms import Pose
from simulation_handler.worlds.model import Island, ObjectState, WeightedWorld, joined, probability
from tests.simulation_handler.worlds import World, cube_at

HERE, THERE = Pose((0.0, 0.0, 0.0)), Pose((1.0, 0.0, 0.0))


def world(weight: float, **objects: ObjectState) -> WeightedWorld:
    return WeightedWorld(weight, objects)


@pytest.mark.parametrize("weights", [(), (0.5,), (0.4, 0.6), (0.7, 0.7)])
def test_weights_must_sum_to_1_and_be_in_order(weights: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="weights"):
        Island(("cup",), tuple(world(weight, cup=ObjectState(HERE)) for weight in weights))


def test_relations_have_the_weight_of_the_worlds_in_which_they_hold() -> None:
    cup, tray = ObjectState(HERE, containers=("tray",)), ObjectState(HERE, supports=("box",))
    island = Island(
        ("ball", "cup", "tray"),
        (
            world(0.6, ball=ObjectState(HERE, containers=("cup",)), cup=cup, tray=tray),
            world(0.3, ball=ObjectState(THERE, hand="hand_0"), cup=cup, tray=tray),
            world(0.1, ball=ObjectState(None), cup=cup, tray=tray),
        ),
    )
    asked = {("in", ("ball", "cup")): 0.6, ("in", ("ball", "tray")): 0.6, ("in", ("cup", "tray")): 1.0,
             ("grasping", ("hand_0", "ball")): 0.3, ("on", ("tray", "box")): 1.0, ("on", ("ball", "tray")): 0.0,
             ("in", ("nobody", "cup")): 0.0}  # fmt: skip
    found = {question: probability([island], *question) for question in asked}
    assert found == pytest.approx(asked)
    with pytest.raises(ValueError, match="beside"):
        island.probability("beside", ("ball", "cup"))


def test_groups_are_what_pairs_connect() -> None:
    assert joined([("a", "c"), ("c", "d"), ("x", "a")], ["d", "c", "b", "a"]) == [("a", "c", "d"), ("b",)]


def test_the_best_world_is_what_the_belief_says() -> None:
    tried = World({"cube_1": cube_at(0.3, 0.0), "cube_2": cube_at(0.3, 0.0, 0.06), "cube_3": cube_at(0.5, 0.0)})
    tried.run(2.0)
    islands = tried.belief.islands()
    assert [island.names for island in islands] == [("cube_1",), ("cube_2",), ("cube_3",)]
    for island in islands:
        assert sum(one.weight for one in island.worlds) == pytest.approx(1.0)
        for name, state in island.best.objects.items():
            assert state.pose == tried.belief.pose(name)
    assert tried.belief.probability("on", ("cube_2", "cube_1")) > 0.9
    tried.belief.close()
