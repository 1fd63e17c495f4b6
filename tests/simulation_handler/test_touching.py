"""Hands in the belief: what they touch, what they hold, and where that is while nobody sees it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion
from dsr.math3d.transforms import Pose
from simulation_handler.explaining import VisibilityQuery
from simulation_handler.hands.carrying import levelled, without_yaw
from simulation_handler.hands.relation import PINCHING, TOUCHING
from simulation_handler.hands.state import HandPercept
from simulation_handler.perception.visibility import ExpectedVisibility
from simulation_handler.shapes.geometry import Solid
from tests.simulation_handler.occluded import BOX, SMALL, Occlusion, standing
from tests.simulation_handler.worlds import BALL, CUBE, ROUND, WALL, container

HELD = ("hand", "cup")


def cup_in_a_hand(seed: int = 0, grip: str = "pinch") -> Occlusion:
    world = Occlusion({"cup": standing(0.3, 0.0, SMALL), "cube": standing(0.3, 0.2, CUBE)}, seed)
    world.run(2.0)
    world.hand("cup", tips=grip)
    world.run(0.8)
    return world


@pytest.mark.parametrize("seed", range(3))
def test_two_opposite_fingertips_pinch(seed: int) -> None:
    world = cup_in_a_hand(seed)
    assert {relation: grasp.state for relation, grasp in world.belief.grasps().items()} == {HELD: PINCHING}
    assert world.error("cup") < 0.006


@pytest.mark.parametrize("seed", range(3))
def test_two_fingertips_on_one_side_touch_and_lift_nothing(seed: int) -> None:
    world = cup_in_a_hand(seed, "touch")
    assert {relation: grasp.state for relation, grasp in world.belief.grasps().items()} == {HELD: TOUCHING}
    world.seen = set()
    world.palm = Pose((0.0, 0.0, 0.3), (0.0, 0.0, 0.0, 1.0)) @ world.palm
    world.run(2.0)
    assert world.pose("cup").t == pytest.approx((0.3, 0.0, 0.04), abs=0.006)
    assert world.belief.grasps() == {}


@pytest.mark.parametrize("seed", range(3))
def test_what_a_hand_lifts_a_little_is_seen_to_be_off_the_table(seed: int) -> None:
    world = cup_in_a_hand(seed)
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.018))
    world.run(0.4)
    assert world.error("cup") < 0.008
    assert ("cup", "table") not in world.belief.supports()
    world.move("cup", standing(0.3, 0.0, SMALL))
    world.run(1.0)
    assert world.error("cup") < 0.006
    assert ("cup", "table") in world.belief.supports()


def test_a_palm_that_jumps_says_nothing_of_how_what_it_holds_leans() -> None:
    world = cup_in_a_hand()
    cup = world.belief._bodies.objects["cup"]
    world.tick()
    assert cup.hand and cup.turned_by_hand is not None
    world.palm = Pose.from_rotvec((0.0, 0.1, 0.0), (0.0, 0.0, 0.0)) @ world.palm
    for _ in range(4):  # until it is believed
        world.tick()
    assert cup.hand and cup.turned_by_hand is None and cup.place_by_hand is None


@pytest.mark.parametrize("yaw", [-0.5, 0.5])
def test_a_palm_that_seems_to_turn_does_not_open_the_fingertips(yaw: float) -> None:
    world = cup_in_a_hand()
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.25))
    world.seen.discard("cup")
    world.palm_askew = Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, yaw))
    world.move("cup", standing(0.3, 0.1, SMALL, on=0.15))
    world.run(1.0)
    assert {relation: grasp.state for relation, grasp in world.belief.grasps().items()} == {HELD: PINCHING}
    assert world.error("cup") < 0.06


@pytest.mark.parametrize("seed", range(3))
def test_what_seems_to_shift_between_fingertips_that_keep_their_distance_is_pinched(seed: int) -> None:
    world = Occlusion({"cube": standing(0.3, 0.0, CUBE)}, seed)
    world.run(2.0)
    world.hand("cube")
    world.run(2.0)
    palm, tips = world.hand_from_object, world.tips_from_object
    for shift in (0.026, 0.0, 0.026, 0.0):
        world.truths["cube"] = standing(0.3 + shift, 0.0, CUBE)
        world.hand_from_object = palm @ Pose((shift, 0.0, 0.0))
        world.tips_from_object = {tip: (place[0] - shift, *place[1:]) for tip, place in tips.items()}
        world.run(0.5)
        assert [grasp.state for grasp in world.belief.grasps().values()] == [PINCHING]


def test_a_hand_beside_an_object_does_not_touch_it() -> None:
    world = cup_in_a_hand()
    world.hand("cup", opened=0.025)
    world.run(3.0)
    assert world.belief.grasps() == {}
    assert world.error("cup") < 0.006


@pytest.mark.parametrize("seed", range(3))
def test_what_a_hand_lifts_goes_with_it_behind_something_and_is_right_when_it_comes_back(seed: int) -> None:
    world = cup_in_a_hand(seed)
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.2))
    assert world.belief.grasps()[HELD].state is PINCHING
    assert not world.belief.plausible("cup")
    world.seen.discard("cup")
    world.move("cup", standing(0.3, -0.3, SMALL, on=0.2))
    world.run(0.5)
    assert world.error("cup") < 0.02
    world.hand_seen = False
    world.run(3.0)
    assert world.error("cup") < 0.02
    world.truths["cup"] = standing(0.1, -0.3, SMALL, on=0.25)
    world.place_hand()
    world.run(1.0)
    assert world.pose("cup").t[2] == pytest.approx(0.24, abs=0.02)
    assert world.belief.grasps().keys() == {HELD}
    world.hand_seen = True
    world.run(1.0)
    assert world.error("cup") < 0.02
    world.seen.add("cup")
    world.run(1.0)
    assert world.error("cup") < 0.01
    world.move("cup", standing(0.1, -0.3, SMALL))
    world.run(0.5)
    world.hand("cup", opened=0.04)
    world.run(1.5)
    assert world.belief.grasps() == {}
    assert world.belief.plausible("cup")
    assert world.error("cup") < 0.004
    assert world.texts() == []


def test_what_is_in_the_air_with_a_hand_is_in_it_though_its_fingertips_seem_to_be_off() -> None:
    world = cup_in_a_hand()
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.2))
    places = world.tips_from_object
    world.hand("cup", opened=0.04)
    world.move("cup", standing(0.3, -0.3, SMALL, on=0.2))
    assert world.belief.grasps().keys() == {HELD}
    world.tips_from_object = places
    world.move("cup", standing(0.3, -0.3, SMALL))
    world.run(0.3)
    world.hand("cup", opened=0.04)
    world.run(1.0)
    assert world.belief.grasps() == {}


def test_the_hand_opens_while_nobody_sees_the_cup_which_falls() -> None:
    world = cup_in_a_hand()
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.2))
    world.seen.discard("cup")
    world.run(1.0)
    assert world.pose("cup").t[2] > 0.2
    world.hand("cup", opened=0.04)
    world.run(2.0)
    assert world.belief.grasps() == {}
    assert world.pose("cup").t[2] < 0.06


def test_what_was_seen_at_rest_in_a_hand_until_that_opened_falls() -> None:
    world = cup_in_a_hand()
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.2))
    world.run(1.0)
    world.hand("cup", opened=0.04)
    world.run(0.05)
    world.seen.discard("cup")
    world.visibility = hidden_by("wall")
    world.run(2.0)
    assert world.belief.grasps() == {}
    assert world.pose("cup").t[2] < 0.06


def test_what_falls_out_of_a_hand_is_held_no_more_though_neither_is_seen_again() -> None:
    world = cup_in_a_hand()
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.3))
    for height in (0.24, 0.14):
        world.truths["cup"] = standing(0.3, 0.0, SMALL, on=height)
        world.run(0.1)
    world.seen.discard("cup")
    world.hand_seen = False
    world.run(2.0)
    assert world.belief.grasps() == {}
    assert world.pose("cup").t[2] == pytest.approx(0.04, abs=0.01)


@pytest.mark.parametrize(("angle", "expected"), [(0.15, 0.0), (-0.15, 0.0), (0.6, 0.6), (2.4, 2.4)])
def test_a_little_tilt_of_a_hand_is_its_noise(angle: float, expected: float) -> None:
    cup = Solid("cup", SMALL, (0.0, 0.0, 0.0), quaternions.from_rotvec((0.0, angle, 0.0)))
    assert _tilt(levelled(cup)) == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("seen", [True, False])
def test_a_hand_does_not_tilt_what_is_seen_to_be_upright(seen: bool) -> None:
    world = cup_in_a_hand()
    covariance = np.diag([4e-6] * 3 + [0.15**2 if seen else math.pi**2] * 2 + [math.pi**2])

    def percept(name: str) -> Pose:
        return Pose(world.truths[name].t, world.truths[name].q, world.now, covariance)

    world.percept = percept  # type: ignore[method-assign]
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.2))
    world.hand_from_object = Pose.from_rotvec(world.hand_from_object.t, (0.0, 0.6, 0.0))
    world.place_hand()
    world.move("cup", standing(0.3, -0.2, SMALL, on=0.2))
    tilt = _tilt(world.pose("cup").q)
    assert tilt < 0.1 if seen else tilt > 0.4


def test_a_hand_out_of_sight_holds_no_more_what_another_one_is_seen_to_carry() -> None:
    world = cup_in_a_hand()
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.2))
    world.hand_seen, world.seen = False, {"cube"}
    world.run(1.0)
    assert world.belief.grasps().keys() == {HELD}
    assert world.last_hand is not None
    hidden, touch = world.last_hand._replace(perceived=False), world.belief.touch

    def touch_both(hands: Mapping[str, HandPercept]) -> None:
        tips = {tip.replace("hand", "other"): pose for tip, pose in hands["hand"].tips.items()}
        touch({"hand": hidden, "other": hands["hand"]._replace(tips=tips)})

    world.belief.touch = touch_both  # type: ignore[method-assign]
    world.hand_seen, world.seen = True, {"cube", "cup"}
    world.truths["cup"] = standing(0.3, -0.3, SMALL, on=0.2)
    world.place_hand()
    world.move("cup", standing(0.3, -0.4, SMALL, on=0.2))
    assert world.belief.grasps().keys() == {("other", "cup")}
    assert world.error("cup") < 0.02


def test_while_two_hands_pinch_a_thing_nobody_knows_for_sure_which_one_holds_it() -> None:
    world = cup_in_a_hand()
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.2))
    world.run(1.0)
    touch, both = world.belief.touch, ("hand", "other")
    assert world.belief.probability("grasping", HELD) > 0.9

    def touch_both(hands: Mapping[str, HandPercept]) -> None:
        tips = {tip.replace("hand", "other"): pose for tip, pose in hands["hand"].tips.items()}
        touch({"hand": hands["hand"], "other": hands["hand"]._replace(tips=tips)})

    world.belief.touch = touch_both  # type: ignore[method-assign]
    world.run(1.0)
    told = [world.belief.probability("grasping", (hand, "cup")) for hand in both]
    assert told[0] == pytest.approx(told[1])
    assert sum(told) > 0.9

    def touch_with_the_other(hands: Mapping[str, HandPercept]) -> None:
        tips = {tip.replace("hand", "other"): pose for tip, pose in hands["hand"].tips.items()}
        touch({"other": hands["hand"]._replace(tips=tips)})

    world.belief.touch = touch_with_the_other  # type: ignore[method-assign]
    world.run(1.0)
    assert world.belief.probability("grasping", ("other", "cup")) > 0.9


def recognized_by_colour(world: Occlusion) -> None:
    """Percepts are exact, and tell no rotation."""
    covariance = np.diag([4e-6] * 3 + [math.pi**2] * 3)

    def percept(name: str) -> Pose:
        return Pose(world.truths[name].t, world.truths[name].q, world.now, covariance)

    world.percept = percept  # type: ignore[method-assign]


@pytest.mark.parametrize("lean", [0.45, 0.7, 1.0])
def test_a_hand_does_not_tilt_what_is_seen_to_be_pulled_over_the_edge(lean: float) -> None:
    world = cup_in_a_hand()
    recognized_by_colour(world)
    world.move("cup", standing(0.3, -0.5, SMALL))
    world.hand_from_object = Pose.from_rotvec(world.hand_from_object.t, (0.0, lean, 0.0))
    world.place_hand()
    for step in range(8):
        world.move("cup", standing(0.3, -0.52 - 0.013 * step, SMALL))
        assert _tilt(world.pose("cup").q) < 0.1
        assert world.error("cup") < 0.03


@pytest.mark.parametrize("lifted", [False, True])
def test_a_hand_does_not_tilt_what_is_seen_to_stand(lifted: bool) -> None:
    world = cup_in_a_hand()
    recognized_by_colour(world)
    height = 0.2 if lifted else 0.0
    world.move("cup", standing(0.3, -0.05, SMALL, on=height))
    world.hand_from_object = Pose.from_rotvec(world.hand_from_object.t, (0.0, 0.45, 0.0))
    world.place_hand()
    tilts = []
    for step in range(1, 9):
        world.move("cup", standing(0.3, -0.05 - 0.02 * step, SMALL, on=height))
        tilts.append(_tilt(world.pose("cup").q))
        assert world.error("cup") < 0.03
    assert max(tilts) > 0.3 if lifted else max(tilts) < 0.1


def test_the_tilt_alone_of_a_rotation() -> None:
    tilt, yaw = quaternions.from_rotvec((0.5, -1.1, 0.0)), quaternions.from_rotvec((0.0, 0.0, 0.4))
    assert without_yaw(quaternions.product(tilt, yaw)) == pytest.approx(tilt)


def _tilt(rotation: Quaternion) -> float:
    return math.hypot(*quaternions.to_rotvec(rotation))


def test_a_cup_that_is_seen_elsewhere_while_its_hand_is_not_is_held_no_more() -> None:
    world = cup_in_a_hand()
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.2))
    world.seen.discard("cup")
    world.hand_seen = False
    world.run(3.0)
    assert world.belief.grasps().keys() == {HELD}
    world.truths["cup"] = standing(0.1, -0.2, SMALL)
    world.seen.add("cup")
    world.run(2.5)
    assert world.belief.grasps() == {}
    assert world.error("cup") < 0.005


def test_fingertips_are_hidden_before_the_palm() -> None:
    world = cup_in_a_hand()
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.2))
    world.seen.discard("cup")
    tips, world.tips_from_object = world.tips_from_object, {}
    world.run(0.5)
    world.hand_seen = False
    world.run(3.0)
    assert {relation: grasp.state for relation, grasp in world.belief.grasps().items()} == {HELD: PINCHING}
    assert world.error("cup") < 0.02
    world.hand_seen, world.tips_from_object = True, tips
    world.run(1.0)
    assert world.belief.grasps().keys() == {HELD}


def test_what_stands_and_only_a_palm_is_near_is_not_held_for_long() -> None:
    world = cup_in_a_hand()
    world.tips_from_object = {}
    world.run(2.0)
    assert world.belief.grasps() == {}


def hidden_by(what: str) -> VisibilityQuery:
    """Nothing is to be seen but for that."""
    return lambda solids, _: [{"camera": ExpectedVisibility(0.0, what)} for _ in solids]


def touched_and_unseen(hiding: str) -> Occlusion:
    """A hand on a cup with its thumb, which is seen, and very likely with another finger, which is not."""
    world = cup_in_a_hand(grip="touch")
    world.tips_from_object.popitem()
    world.run(0.5)
    world.seen.discard("cup")
    world.visibility = hidden_by(hiding)
    world.run(0.8)
    return world


def test_what_a_hand_hides_and_touches_goes_with_it() -> None:
    world = touched_and_unseen("hand")
    world.move("cup", standing(0.1, -0.2, SMALL, on=0.1))
    world.run(0.3)
    assert world.belief.grasps().keys() == {HELD}
    assert world.error("cup") < 0.03
    world.truths["cup"] = standing(0.3, 0.0, SMALL)  # it was not: there it is
    world.seen.add("cup")
    world.tips_from_object = {}
    world.run(1.0)
    assert world.belief.grasps() == {}
    assert world.error("cup") < 0.01


def test_what_something_else_hides_is_only_touched() -> None:
    world = touched_and_unseen("block")
    world.move("cup", standing(0.1, -0.2, SMALL, on=0.1))
    assert world.pose("cup").t == pytest.approx((0.3, 0.0, 0.04), abs=0.03)


def test_fingertips_that_are_hidden_with_what_they_hold_open_with_the_one_that_is_seen() -> None:
    world = cup_in_a_hand()
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.2))
    world.seen.discard("cup")
    del world.tips_from_object["hand_finger_1"]
    world.run(2.0)
    assert world.belief.grasps()[HELD].state is PINCHING
    x, y, z = world.tips_from_object["hand_finger_0"]
    world.tips_from_object["hand_finger_0"] = (x, y + 0.03, z)
    world.run(1.0)
    assert world.belief.grasps() == {}
    assert world.pose("cup").t[2] < 0.06


def cup_held_unseen() -> Occlusion:
    world = cup_in_a_hand()
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.2))
    world.seen.discard("cup")
    world.run(0.5)
    return world


def test_what_fingers_hold_does_not_go_with_a_palm_that_only_seems_to_move() -> None:
    world = cup_held_unseen()
    slip = Pose((0.0, 0.0, 0.005))
    for _ in range(12):
        assert world.palm is not None
        world.palm = world.palm @ slip
        world.hand_from_object = slip.inverse() @ world.hand_from_object
        world.run(0.1)
    assert world.error("cup") < 0.015
    world.move("cup", standing(0.3, -0.2, SMALL, on=0.2))
    assert world.error("cup") < 0.03


def test_what_a_hand_lets_go_of_unseen_falls_where_its_fingers_opened() -> None:
    world = cup_held_unseen()
    world.tips_from_object = {
        name: (x, y + math.copysign(0.025, y), z) for name, (x, y, z) in world.tips_from_object.items()
    }
    for _ in range(10):  # and withdraws at once
        assert world.palm is not None
        world.palm = world.palm @ Pose((-0.015, 0.0, 0.005))
        world.run(0.1)
    assert world.belief.grasps() == {}
    assert world.pose("cup").t == pytest.approx((0.3, 0.0, 0.04), abs=0.015)


@pytest.mark.parametrize("on", [0.0, 0.08])
@pytest.mark.parametrize("seed", range(3))
def test_what_hidden_fingertips_let_go_of_falls_from_where_their_palm_last_stood_still(seed: int, on: float) -> None:
    world = cup_in_a_hand(seed)
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.2))
    world.seen.discard("cup")
    tips, world.tips_from_object = world.tips_from_object, {}
    world.move("cup", standing(0.3, -0.15, SMALL, on=on))
    world.run(1.0)
    world.truths["cup"] = standing(0.3, -0.15, SMALL)
    heights = []
    for k in range(12):
        assert world.palm is not None
        if k < 5:
            world.palm = world.palm @ Pose((-0.012, 0.0, 0.007))
        else:
            world.tips_from_object = {name: (x, y + math.copysign(0.025, y), z) for name, (x, y, z) in tips.items()}
        for _ in range(2):
            world.tick()
            if world.belief.grasps():
                heights.append(world.pose("cup").t[2])
    assert world.belief.grasps() == {}
    assert heights[-1] == pytest.approx(on + 0.04, abs=0.015)  # before it fell, if that
    assert world.error("cup") < 0.02


@pytest.mark.parametrize("roll", [0.1, math.pi / 6, 0.9])
def test_a_round_cup_that_a_hand_lays_down_rests_whichever_way_it_is_rolled(roll: float) -> None:
    world = Occlusion({"beaker": standing(0.3, 0.0, SMALL, yaw=roll)})
    world.run(2.0)
    world.hand("beaker")
    world.run(0.8)
    world.move("beaker", standing(0.3, 0.0, SMALL, on=0.2, yaw=roll))
    lying = Pose.from_rotvec((0.3, 0.0, 0.5 * SMALL[0]), (0.5 * math.pi, 0.0, 0.0)) @ Pose.from_rotvec(
        (0.0, 0.0, 0.0), (0.0, 0.0, roll)
    )
    world.move("beaker", Pose((0.3, 0.0, 0.2), lying.q))
    world.move("beaker", lying)
    world.run(0.5)
    world.palm = None
    world.belief.touch({})
    world.run(1.5)
    assert world.belief.plausible("beaker")
    assert world.belief.supports().keys() == {("beaker", "table")}
    assert math.dist(world.pose("beaker").t, lying.t) < 0.006


def test_what_is_in_a_cup_in_a_hand_goes_along() -> None:
    world = Occlusion({"cup": standing(0.3, 0.0, SMALL), "cube": standing(0.3, 0.0, CUBE, on=WALL)})
    world.run(2.0)
    world.seen = {"cup"}
    world.hand("cup")
    world.run(1.0)
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.2))
    world.seen = set()
    world.move("cup", standing(0.1, -0.3, SMALL, on=0.2))
    world.run(0.5)
    assert world.belief.contents().keys() == {("cube", "cup")}
    assert math.dist(world.pose("cube").t[:2], (0.1, -0.3)) < 0.05


def test_a_cube_that_a_hand_takes_from_a_tower_is_no_surprise() -> None:
    world = Occlusion({"cube_0": standing(0.3, 0.0, CUBE), "cube_1": standing(0.3, 0.0, CUBE, on=0.04)})
    world.run(2.0)
    world.hand("cube_1")
    world.tips_from_object = {name: (x, y, 0.0) for name, (x, y, _) in world.tips_from_object.items()}
    world.run(0.8)
    world.move("cube_1", standing(0.3, 0.0, CUBE, on=0.2))
    world.move("cube_1", standing(0.1, 0.1, CUBE, on=0.2))
    assert world.belief.grasps()["hand", "cube_1"].state is PINCHING
    assert world.error("cube_1") < 0.04
    assert world.error("cube_0") < 0.004
    assert world.texts() == []


@pytest.mark.parametrize("seed", range(2))
def test_hands_disturb_nothing_that_they_only_pass(seed: int) -> None:
    cubes = {f"cube_{k}": standing(0.3, 0.0, CUBE, on=0.04 * k) for k in range(3)}
    world = Occlusion(cubes, seed)
    world.run(2.0)
    world.hand("cube_2", opened=0.03)
    world.hand_noise = 0.005
    for k in range(20):
        world.palm = Pose((0.0, 0.02 * (k - 10), 0.06), (0.0, 0.0, 0.0, 1.0)) @ world.truths["cube_2"]
        world.run(0.1)
    assert all(world.error(name) < 0.004 for name in cubes)
    assert world.texts() == []


@pytest.mark.parametrize(
    ("solid", "point", "distance", "normal"),
    [
        (Solid("a", CUBE, (0.0, 0.0, 0.0)), (0.05, 0.0, 0.0), 0.03, (1.0, 0.0, 0.0)),
        (Solid("a", CUBE, (0.0, 0.0, 0.0)), (0.0, 0.0, -0.015), -0.005, (0.0, 0.0, -1.0)),
        (Solid("a", CUBE, (0.0, 0.0, 0.0)), (0.05, 0.06, 0.0), 0.05, (0.6, 0.8, 0.0)),
        (Solid("a", BALL, (1.0, 0.0, 0.0), shape=ROUND), (1.0, 0.05, 0.0), 0.02, (0.0, 1.0, 0.0)),
        (Solid("a", BOX, (0.0, 0.0, 0.0), shape=container(BOX)), (0.0725, 0.0, 0.0), 0.0095, (-1.0, 0.0, 0.0)),
    ],
)
def test_how_far_a_point_is_from_a_body(
    solid: Solid, point: tuple[float, float, float], distance: float, normal: tuple[float, float, float]
) -> None:
    assert solid.signed_distance(point)[0] == pytest.approx(distance)
    assert solid.signed_distance(point)[1] == pytest.approx(normal)


def test_a_hand_that_passes_along_what_it_touches_does_not_grasp_it() -> None:
    world = cup_in_a_hand(0, "touch")
    assert world.belief.grasps().keys() == {HELD}
    for _ in range(8):
        world.palm = Pose((0.008, 0.0, 0.0)) @ world.palm
        world.tips_from_object = {name: (x - 0.008, y, z) for name, (x, y, z) in world.tips_from_object.items()}
        world.hand_from_object = Pose((-0.008, 0.0, 0.0)) @ world.hand_from_object
        world.run(0.1)
    assert world.belief.grasps() == {}
