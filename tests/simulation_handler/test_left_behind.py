"""What a hand comes back without: it was left where both were out of sight, with what is in it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.math3d.transforms import Pose
from dsr.vocabulary.observed_actions import PLACE, RELEASE
from simulation_handler.explaining import VisibilityQuery
from simulation_handler.hands.going_along import GoingAlong
from simulation_handler.hands.relation import LEFT_BEHIND, PINCHING
from simulation_handler.perception.visibility import ExpectedVisibility
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import Bodies
from simulation_handler.state.objects import BelievedObject
from tests.simulation_handler.occluded import BOX, SMALL, Occlusion, standing
from tests.simulation_handler.worlds import CUBE, WALL

HELD = ("hand", "cup")
SHOWN, HIDDEN = standing(0.3, 0.0, SMALL, on=0.2), standing(0.3, -0.3, SMALL, on=0.2)


def behind(y: float) -> VisibilityQuery:
    """A wall hides what is further to the right than that, and the cup what is in it."""

    def visibility(solids: Sequence[Solid], _: Sequence[Solid]) -> list[dict[str, ExpectedVisibility]]:
        hiding = ["cup" if s.name == "cube" else "wall" if s.position[1] < y else "" for s in solids]
        return [{"camera": ExpectedVisibility(0.0 if what else 1.0, what)} for what in hiding]

    return visibility


def carried_behind_a_wall(seed: int = 0, *, with_cube: bool = False, height: float = 0.2) -> Occlusion:
    """A cup in a hand, both hidden by a wall, so high (m) above the table."""
    truths = {"cup": standing(0.3, 0.0, SMALL)}
    if with_cube:
        truths["cube"] = standing(0.3, 0.0, CUBE, on=WALL)
    world = Occlusion(truths, seed)
    world.run(2.0)
    if with_cube:
        world.seen.discard("cube")
    world.visibility = behind(-0.15)
    world.hand("cup")
    world.run(0.8)
    world.move("cup", SHOWN)
    world.move("cup", HIDDEN)
    world.move("cup", standing(0.3, -0.3, SMALL, on=height))
    world.seen.discard("cup")
    world.hand_seen = False
    world.run(1.5)
    assert world.belief.grasps()[HELD].state is PINCHING
    return world


def come_back(world: Occlusion, path: tuple[float, ...] = (-0.2, -0.1, 0.0, 0.0, 0.0, 0.0)) -> None:
    """The hand shows up without the cup; its fingers are as far apart as if they had it."""
    world.hand_seen = True
    for y in path:
        world.palm = standing(0.3, y, SMALL, on=0.2) @ world.hand_from_object.inverse()
        world.run(0.2)


@pytest.mark.parametrize(("height", "kind"), [(0.2, RELEASE), (0.05, PLACE), (0.0, PLACE)])
@pytest.mark.parametrize("seed", range(3))
def test_what_a_hand_comes_back_without_was_let_go_when_both_vanished(seed: int, height: float, kind: str) -> None:
    """However high the hand comes back."""
    world = carried_behind_a_wall(seed, height=height)
    vanished_at = world.now - 1.5
    come_back(world)
    world.run(2.0)
    assert world.belief.let_go()[HELD].state is LEFT_BEHIND
    assert world.belief.let_go()[HELD].since == pytest.approx(vanished_at, abs=0.2)
    assert world.belief.deeds("cup")[-1].kind == kind
    assert world.belief.deeds("cup")[-1].time == pytest.approx(vanished_at, abs=0.2)


@pytest.mark.parametrize("seed", range(3))
def test_what_a_hand_leaves_out_of_sight_is_not_in_it_when_it_comes_back(seed: int) -> None:
    world = carried_behind_a_wall(seed)
    come_back(world)
    world.run(0.5)
    assert world.belief.grasps() == {}
    x, y, z = world.pose("cup").t
    assert (x, y) == pytest.approx((0.3, -0.3), abs=0.02)
    assert z == pytest.approx(0.5 * SMALL[2], abs=0.005)
    assert ("cup", "table") in world.belief.supports()


@pytest.mark.parametrize("seed", range(3))
def test_what_was_left_did_not_take_the_way_of_the_hand(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else it would be seen to come back from there, moved by nobody, when it shows."""
    leave, left = GoingAlong.leave, list[BelievedObject]()

    def spy(self: GoingAlong, item: BelievedObject, *args: Any) -> float:
        left.append(item)
        return leave(self, item, *args)

    monkeypatch.setattr(GoingAlong, "leave", spy)
    come_back(carried_behind_a_wall(seed, height=0.0))
    assert [item.name for item in left] == ["cup"]
    assert left[0].path.last.t == pytest.approx(standing(0.3, -0.3, SMALL).t, abs=0.02)
    assert left[0].path.since(0.0) == [left[0].path.last]


def test_what_went_with_a_hand_when_it_was_last_seen_was_not_on_its_way_into_a_fall() -> None:
    """Else what is not where its hand must have left it would have fallen over the edge of the table, far away."""
    world = Occlusion({"cup": standing(0.3, 0.0, SMALL), "box": standing(0.0, 0.3, BOX)})
    world.run(2.0)
    world.visibility = behind(-0.15)
    world.hand("cup")
    world.run(0.8)
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.25))
    world.move("cup", standing(0.3, -0.15, SMALL, on=0.25), speed=0.3)
    world.seen.discard("cup")
    world.hand_seen = False
    world.move("cup", standing(0.3, -0.3, SMALL, on=0.25), speed=0.3)
    world.run(1.0)
    come_back(world)
    world.visibility = behind(-0.25)  # it could lie there
    world.run(3.0)
    assert world.texts() == ["removed(cup)"]


def test_what_an_open_hand_comes_back_without_stays_where_both_were_hidden() -> None:
    world = carried_behind_a_wall()
    world.visibility = behind(-0.15)
    world.tips_from_object = {name: (x, 2.5 * y, z) for name, (x, y, z) in world.tips_from_object.items()}
    come_back(world, (-0.15, 0.0, 0.1, 0.1, 0.1, 0.1))
    world.run(0.5)
    assert world.belief.grasps() == {}
    assert world.pose("cup").t[:2] == pytest.approx((0.3, -0.3), abs=0.02)


def test_what_was_seen_low_before_it_was_left_is_put_on_what_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Within the bottom of a box it would be pushed out, sideways, through the wall and over the edge of the table."""
    world = Occlusion({"cup": standing(0.3, 0.0, SMALL), "box": standing(0.3, -0.3, BOX)})
    world.run(2.0)
    world.visibility = behind(-0.15)
    world.hand("cup")
    world.run(0.8)
    for there in (SHOWN, HIDDEN, standing(0.3, -0.3, SMALL, on=WALL - 0.006)):
        world.move("cup", there)
    world.seen.discard("cup")
    world.hand_seen = False
    world.run(1.5)
    put, places = Bodies.put, list[Vector3]()

    def spy(bodies: Bodies, item: BelievedObject, position: Vector3, rotation: Quaternion) -> None:
        places.extend([position] if item.name == "cup" else [])
        put(bodies, item, position, rotation)

    monkeypatch.setattr(Bodies, "put", spy)
    come_back(world)
    assert world.belief.grasps() == {}
    assert places[-1] == pytest.approx(standing(0.3, -0.3, SMALL, on=WALL).t, abs=0.02)
    assert places[-1][2] == pytest.approx(WALL + 0.5 * SMALL[2], abs=0.001)


def test_what_is_in_it_stays_in_it() -> None:
    world = carried_behind_a_wall(with_cube=True)
    come_back(world)
    world.run(0.5)
    assert ("cube", "cup") in world.belief.contents()
    assert world.pose("cube").t[:2] == pytest.approx((0.3, -0.3), abs=0.03)


def test_what_hidden_fingers_let_go_of_does_not_go_with_a_palm_in_rays() -> None:
    world = carried_behind_a_wall()
    places, world.tips_from_object = world.tips_from_object, {}
    for step in range(1, 6):
        world.hand_seen = True
        world.palm = Pose((0.3 + 0.01 * step, -0.3, 0.24)) @ world.hand_from_object.inverse()
        world.run(0.1)
    world.run(2.0)  # it has drawn back a little
    world.tips_from_object = {name: (x, 1.8 * y, z) for name, (x, y, z) in places.items()}
    for step in range(1, 9):
        world.palm = Pose((0.35 + 0.06 * step, -0.3 + 0.04 * step, 0.24)) @ world.hand_from_object.inverse()
        world.run(0.1)
    world.run(1.5)
    assert world.belief.grasps() == {}
    assert world.pose("cup").t == pytest.approx((0.3, -0.3, 0.04), abs=0.03)


def held_in_a_box() -> tuple[Occlusion, Pose]:
    """A cup that a hand holds in a box, in view, and world_from_cup."""
    inside = standing(0.3, 0.0, SMALL, on=WALL)
    world = Occlusion({"box": standing(0.3, 0.0, BOX), "cup": standing(0.3, 0.3, SMALL)})
    world.run(2.0)
    world.hand("cup")
    world.run(0.8)
    for there in (standing(0.3, 0.3, SMALL, on=0.2), standing(0.3, 0.0, SMALL, on=0.2), inside):
        world.move("cup", there)
    world.run(1.0)
    return world, inside


def test_what_a_palm_would_take_through_a_wall_is_left_in_the_box() -> None:
    world, inside = held_in_a_box()
    assert ("cup", "box") in world.belief.contents()
    world.seen.discard("cup")
    world.tips_from_object = {}
    for step in range(1, 9):
        world.palm = (
            Pose((0.3 + 0.01 * step, 0.01 * step, inside.t[2] + 0.004 * step)) @ world.hand_from_object.inverse()
        )
        world.run(0.1)
        x, y, _ = world.pose("cup").t
        assert max(abs(x - 0.3), abs(y)) < 0.5 * (BOX[0] - SMALL[0]) + 0.015
    world.run(1.0)
    assert ("cup", "box") in world.belief.contents()
    assert world.pose("box").t == pytest.approx((0.3, 0.0, 0.5 * BOX[2]), abs=0.01)


def test_what_a_palm_that_rose_would_take_through_a_wall_is_where_it_surely_was() -> None:
    """Not where the palm had it last: it rose and went aside with that."""
    world, inside = held_in_a_box()
    world.seen.discard("cup")
    world.tips_from_object = {}
    for step in range(1, 11):
        aside, up = 0.012 * max(step - 4, 0), 0.01 * min(step, 4)
        world.palm = Pose((0.3 + aside, 0.0, inside.t[2] + up)) @ world.hand_from_object.inverse()
        world.run(0.1)
    world.run(1.0)
    assert world.belief.grasps() == {}
    assert world.pose("cup").t == pytest.approx(inside.t, abs=0.01)


def test_what_it_still_has_is_seen_in_it() -> None:
    world = carried_behind_a_wall()
    world.seen.add("cup")
    world.hand_seen = True
    world.move("cup", SHOWN)
    world.run(0.5)
    assert world.belief.grasps().keys() == {HELD}
    assert world.error("cup") < 0.01


def test_what_the_hand_itself_hides_may_be_in_it() -> None:
    world = carried_behind_a_wall()
    world.visibility = lambda solids, _: [{"camera": ExpectedVisibility(0.0, "hand")} for _ in solids]
    come_back(world)
    assert world.belief.grasps().keys() == {HELD}
    assert world.pose("cup").t == pytest.approx(SHOWN.t, abs=0.03)


def covered_by(share: float, hidden_by: str) -> VisibilityQuery:
    """All that can be seen, but of the cup only that share."""

    def visibility(solids: Sequence[Solid], _: Sequence[Solid]) -> list[dict[str, ExpectedVisibility]]:
        of_cup = ExpectedVisibility(share, hidden_by)
        return [{"camera": of_cup if s.name == "cup" else ExpectedVisibility(1.0, "")} for s in solids]

    return visibility


@pytest.mark.parametrize(("share", "hidden_by", "holds"), [(0.7, "hand", True), (1.0, "", False)])
def test_a_hand_in_sight_may_have_what_it_hides_in_part_but_not_what_it_cannot_hide(
    share: float, hidden_by: str, holds: bool
) -> None:
    """Nor is it where it was before: that would be seen."""
    world = Occlusion({"cup": standing(0.3, 0.0, SMALL)})
    world.run(2.0)
    world.visibility = covered_by(0.0, "hand")
    world.hand("cup")
    world.run(0.8)
    world.seen.discard("cup")
    world.run(0.5)
    world.visibility = covered_by(share, hidden_by)
    world.move("cup", SHOWN)
    world.run(2.0)
    assert (world.belief.grasps().keys() == {HELD}) is holds


@pytest.mark.parametrize("seed", range(3))
def test_what_is_not_seen_since_a_hand_took_hold_of_it_is_in_that_though_nothing_seems_to_hide_it(seed: int) -> None:
    """Nobody left it there either: it would be missed as much."""
    world = Occlusion({"cup": standing(0.3, 0.0, SMALL)}, seed)
    world.run(2.0)
    world.hand("cup")
    world.run(0.8)
    world.visibility = covered_by(1.0, "")
    world.seen.discard("cup")
    world.run(2.0)
    assert world.belief.grasps().keys() == {HELD}
    world.move("cup", SHOWN)
    world.run(2.0)
    assert world.belief.grasps().keys() == {HELD}
    assert world.error("cup") < 0.03


def put_down_and_hidden() -> Occlusion:
    """A cup that a hand was seen to put down and to open about, and that something hides since."""
    world = Occlusion({"cup": standing(0.3, 0.0, SMALL)})
    world.run(2.0)
    world.hand("cup")
    world.run(0.8)
    world.move("cup", SHOWN)
    world.move("cup", standing(0.3, 0.0, SMALL))
    world.run(0.4)
    places = world.tips_from_object
    world.hand("cup", opened=0.04)
    world.tips_from_object["hand_finger_1"] = places["hand_finger_1"]
    world.run(0.6)
    world.seen.discard("cup")
    world.visibility = behind(10.0)
    world.tips_from_object = places
    world.run(0.6)
    return world


def test_a_hand_that_was_seen_to_put_something_down_does_not_hold_it_again_unseen() -> None:
    world = put_down_and_hidden()
    assert PINCHING not in {grasp.state for grasp in world.belief.grasps().values()}
    world.move("cup", SHOWN)
    assert world.pose("cup").t == pytest.approx((0.3, 0.0, 0.5 * SMALL[2]), abs=0.02)


def test_touches_end_with_their_grasp() -> None:
    world = carried_behind_a_wall()
    world.truths["cup"] = standing(0.1, 0.3, SMALL)
    world.seen.add("cup")
    world.run(2.5)
    assert world.belief.grasps() == {}
    began = world.now
    world.hand_seen = True
    world.palm = Pose((0.3, -0.3, 0.6))
    for _ in range(20):
        world.tick()
        assert all(grasp.since >= began for grasp in world.belief.grasps().values())


def test_what_a_carried_box_takes_along_is_not_held_by_the_hand_that_touches_both() -> None:
    world = Occlusion({"box": standing(0.3, 0.0, BOX), "cup": standing(0.3, 0.0, SMALL, on=WALL)}, 2, noise=0.004)
    world.run(2.0)
    world.hand("box")
    world.tips_from_object["hand_finger_2"] = (0.0, 0.5 * SMALL[1] + 0.008, -0.03)
    world.run(0.8)
    assert HELD in world.belief.grasps()
    for step in range(1, 26):
        world.truths |= {"cup": standing(0.3, 0.0, SMALL, on=WALL + 0.01 * step)}
        world.move("box", standing(0.3, 0.0, BOX, on=0.01 * step), speed=0.1)
    world.seen.discard("cup")
    world.visibility = behind(10.0)
    world.run(0.5)
    before = world.pose("cup")
    for step in range(1, 11):
        world.palm = Pose((0.0, 0.0, 0.004 * step)) @ world.truths["box"] @ world.hand_from_object.inverse()
        world.run(0.1)
    assert ("cup", "box") in world.belief.contents()
    assert world.pose("cup").distance(before)[0] < 0.01
