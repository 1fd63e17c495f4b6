"""What hovers and moves along with a palm is in that hand, even if the fingertips that hold it are hidden."""

from __future__ import annotations

import pytest

from dsr.math3d.transforms import Pose
from simulation_handler.hands.relation import TOUCHING
from tests.simulation_handler.occluded import SMALL, Occlusion, standing

HELD = ("hand", "cup")
ALOOF = {f"hand_finger_{k}": (0.03 * k, 0.12, 0.05) for k in (2, 3, 4)}
"""Fingertips, in the frame of the cup, that do not touch it."""


def hand_beside(seed: int) -> Occlusion:
    """A hand at a cup on the table; of its fingertips only three are seen, which do not touch the cup."""
    world = Occlusion({"cup": standing(0.3, 0.0, SMALL)}, seed)
    world.run(2.0)
    world.hand("cup")
    world.tips_from_object = dict(ALOOF)
    world.run(0.8)
    assert world.belief.grasps() == {}
    return world


@pytest.mark.parametrize("seed", range(3))
def test_what_a_palm_lifts_is_held(seed: int) -> None:
    world = hand_beside(seed)
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.15))
    world.run(0.4)
    assert {relation: grasp.state for relation, grasp in world.belief.grasps().items()} == {HELD: TOUCHING}
    world.move("cup", standing(0.3, 0.2, SMALL, on=0.15))
    world.run(3.0)
    assert world.belief.grasps().keys() == {HELD}
    world.move("cup", standing(0.3, 0.2, SMALL))
    world.run(1.0)
    assert world.belief.grasps() == {}
    assert ("cup", "table") in world.belief.supports()


@pytest.mark.parametrize("seed", range(3))
def test_what_somebody_else_lifts_past_a_hand_at_rest_is_not_held_by_it(seed: int) -> None:
    world = hand_beside(seed)
    palm = world.palm
    assert palm is not None
    for step in range(1, 21):
        world.truths["cup"] = standing(0.3, 0.0, SMALL, on=0.01 * step)
        world.palm = palm
        world.run(0.1)
        assert world.belief.grasps() == {}


def test_a_hand_that_shows_all_fingertips_holds_what_those_touch_and_nothing_else() -> None:
    world = hand_beside(0)
    world.tips_from_object |= {"hand_finger_0": (0.1, 0.12, 0.05), "hand_finger_1": (-0.03, 0.12, 0.05)}
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.15))
    world.run(0.4)
    assert world.belief.grasps() == {}


def test_what_slides_with_a_hand_on_the_table_is_carried_by_the_table() -> None:
    world = hand_beside(1)
    world.move("cup", standing(0.3, 0.15, SMALL))
    world.run(0.4)
    assert world.belief.grasps() == {}
    assert world.pose("cup").distance(standing(0.3, 0.15, SMALL))[0] < 0.02


def test_what_is_seen_in_a_hand_though_believed_gone_is_held_by_nobody_until_it_is_back() -> None:
    world = hand_beside(0)
    world.belief._bodies.sim.remove("cup")
    item = world.belief._bodies.objects["cup"]
    item.hovering_since = item.track.last_stamp
    hands = world.belief._touching._hands
    assert world.belief._touching._carrying.update(hands, (), item.track.last_stamp) == {}


def hidden_behind(name: str, gap: float) -> Occlusion:
    """A hand beside an object, by that much (m) more than if it held that; then it is out of sight."""
    world = Occlusion({name: standing(0.3, 0.0, SMALL), "cup_other": standing(0.3, 0.4, SMALL)})
    world.run(2.0)
    world.hand(name)
    assert world.palm is not None
    world.palm = Pose((-gap, 0.0, 0.0)) @ world.palm
    world.tips_from_object = {}
    world.run(0.5)
    world.hand_seen, world.held = False, ""
    world.run(0.3)
    assert world.belief.grasps() == {}
    return world


def test_what_moves_beside_a_hand_that_nobody_sees_is_moved_by_that() -> None:
    world = hidden_behind("cup", 0.0)
    world.move("cup", standing(0.45, 0.0, SMALL))
    assert world.belief.grasps().keys() == {HELD}
    world.hand("cup", opened=0.1)
    world.hand_seen = True
    world.run(1.0)
    assert world.belief.grasps() == {}


def test_what_moves_far_from_a_hand_that_nobody_sees_is_not_moved_by_that() -> None:
    world = hidden_behind("cup", 0.2)
    world.move("cup", standing(0.45, 0.0, SMALL))
    world.move("cup_other", standing(0.45, 0.4, SMALL))
    assert world.belief.grasps() == {}
