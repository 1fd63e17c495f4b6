"""How the belief says that a hand came to hold something no more: dropped, from however low, or put down."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dsr.math3d.transforms import Pose
from dsr.vocabulary.handling import Handling
from dsr.vocabulary.observed_actions import PLACE
from simulation_handler.hands.relation import DROPPED, LEFT_BEHIND, LET_GO, PINCHING, PUT_DOWN, TOUCHING
from simulation_handler.worlds.circumstances import HELD as IN_VIEW
from simulation_handler.worlds.circumstances import HELD_ALOFT, HELD_LYING, HELD_OPENING, hold
from tests.simulation_handler.occluded import PERIOD, SMALL, Occlusion, standing

HELD = ("hand", "cup")
G = 9.81
FAR = 0.007
"""m, standard deviation of each coordinate of a percept from a far camera"""


class FarOcclusion(Occlusion):
    """Percepts of a far camera, which tell how noisy they are."""

    def __init__(self, truths: dict[str, Pose], seed: int) -> None:
        super().__init__(truths, seed, noise=FAR)

    def percept(self, name: str) -> Pose:
        """Where an object is seen, with covariance."""
        return super().percept(name).with_covariance(np.diag([FAR**2] * 3 + [0.01**2] * 3))


def lifted_and_lowered(seed: int, to: float, kind: type[Occlusion] = Occlusion) -> Occlusion:
    """A cup that a hand took up and holds again with its bottom at that height (m)."""
    world = kind({"cup": standing(0.3, 0.0, SMALL)}, seed)
    world.run(2.0)
    world.hand("cup")
    world.run(0.8)
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.15))
    world.move("cup", standing(0.3, 0.0, SMALL, on=to))
    world.run(0.5)
    assert world.belief.grasps()[HELD].state is PINCHING
    return world


def opened(world: Occlusion, fallen_from: float) -> float:
    """The hand opens at 0.1 m/s while the cup falls to the table; gives when it opened, s."""
    at, palm, places = world.now, world.palm, world.tips_from_object
    world.held = ""
    for k in range(1, 21):
        seconds = k * PERIOD
        height = max(0.0, fallen_from - 0.5 * G * seconds**2)
        world.truths["cup"] = standing(0.3, 0.0, SMALL, on=height)
        wider = min(0.1 * seconds, 0.025)
        world.tips_from_object = {name: (x, y + math.copysign(wider, y), z) for name, (x, y, z) in places.items()}
        world.palm = palm
        world.tick()
    return at


@pytest.mark.parametrize("height", [0.02, 0.03, 0.05, 0.12])
@pytest.mark.parametrize("seed", range(3))
def test_what_falls_from_a_hand_was_dropped_however_low_that_was(seed: int, height: float) -> None:
    world = lifted_and_lowered(seed, height)
    at = opened(world, height)
    assert world.belief.grasps() == {}
    assert world.belief.let_go()[HELD].state is DROPPED
    assert world.belief.let_go()[HELD].since == pytest.approx(at, abs=0.2)


@pytest.mark.parametrize("seed", range(3))
def test_what_lies_where_a_hand_opens_was_put_down(seed: int) -> None:
    world = lifted_and_lowered(seed, 0.0)
    opened(world, 0.0)
    assert world.belief.let_go()[HELD].state is PUT_DOWN


@pytest.mark.parametrize("seed", range(6))
def test_what_lies_where_a_hand_opens_does_not_fall_by_the_noise_of_a_far_camera(seed: int) -> None:
    world = lifted_and_lowered(seed, 0.0, FarOcclusion)
    opened(world, 0.0)
    assert world.belief.let_go()[HELD].state is not DROPPED


@pytest.mark.parametrize("seed", range(2))
def test_what_tells_whether_a_hand_holds_is_where_the_thing_is_and_how_the_fingers_are(seed: int) -> None:
    def way(world: Occlusion) -> str:
        return hold(world.belief.evidence().objects["cup"], IN_VIEW)

    def probability(world: Occlusion) -> float:
        return world.belief.probability("grasping", HELD)

    carried, lying = lifted_and_lowered(seed, 0.12), lifted_and_lowered(seed, 0.0)
    assert way(carried) == HELD_ALOFT and way(lying) == HELD_LYING
    assert probability(lying) < probability(carried)
    before, ways = probability(lying), set()
    for wider in (0.01, 0.02, 0.02, 0.02):
        places = lying.tips_from_object
        lying.held = ""
        lying.tips_from_object = {name: (x, y + math.copysign(wider, y), z) for name, (x, y, z) in places.items()}
        lying.tick()
        if HELD in lying.belief.grasps():
            ways.add(way(lying))
    assert HELD_OPENING in ways, "before it is sure that the hand has let go"
    assert probability(lying) < before


@pytest.mark.parametrize(("height", "state"), [(0.05, DROPPED), (0.0, PUT_DOWN)])
def test_it_is_known_when_it_shows_how_fingers_let_go_of_what_they_hid(height: float, state: Handling) -> None:
    world = lifted_and_lowered(0, height)
    world.seen.discard("cup")
    world.run(0.5)
    opened(world, height)
    assert world.belief.let_go()[HELD].state is LET_GO
    world.seen.add("cup")
    world.run(0.3)
    assert world.belief.let_go()[HELD].state is state


@pytest.mark.parametrize("seed", range(3))
def test_a_fingertip_that_seems_to_touch_again_as_its_hand_rises_does_not_lift_what_was_put_down(seed: int) -> None:
    world = lifted_and_lowered(seed, 0.0)
    world.seen.discard("cup")
    world.run(0.5)
    places, palm, opened_at = world.tips_from_object, world.palm, world.now
    assert palm is not None
    index = min(places)
    x, y, z = places[index]
    world.held = ""
    for rise, apart in ((0.0, 0.04), (0.0, 0.04), (0.03, 0.0), (0.06, 0.04), (0.09, 0.04), (0.12, 0.04), (0.15, 0.04)):
        world.palm = Pose((0.0, 0.0, rise)) @ palm
        world.tips_from_object = {index: (x, y + math.copysign(apart, y), z)}
        world.run(0.1)
    world.run(1.0)
    assert world.belief.let_go()[HELD].state is LET_GO
    assert world.belief.let_go()[HELD].since == pytest.approx(opened_at, abs=0.2)
    assert world.belief.deeds("cup")[-1].kind == PLACE
    assert world.error("cup") < 0.01


@pytest.mark.parametrize("flickers", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_what_a_hand_lowers_fast_unseen_does_not_fall_from_it(seed: int, *, flickers: bool) -> None:
    """Not even while a fingertip seems apart at every other look: its way is that of the hand alone."""
    world = lifted_and_lowered(seed, 0.2)
    world.seen.discard("cup")
    world.run(0.5)
    places = world.tips_from_object
    index = min(places)
    x, y, z = places[index]
    for step in range(1, 11):
        world.tips_from_object = places | ({index: (x, y + math.copysign(0.04, y), z)} if flickers and step % 2 else {})
        world.truths["cup"] = standing(0.3, 0.03 * step, SMALL, on=min(0.2, 0.4 - 0.04 * step))
        world.place_hand()
        world.run(0.1)
    opened_at = world.now
    opened(world, 0.0)
    world.run(1.0)
    assert world.belief.let_go()[HELD].state is LET_GO
    assert world.belief.let_go()[HELD].since == pytest.approx(opened_at, abs=0.3)
    assert world.belief.deeds("cup")[-1].kind == PLACE


def test_what_is_held_again_is_not_told_to_have_been_let_go() -> None:
    world = lifted_and_lowered(0, 0.05)
    opened(world, 0.05)
    world.hand("cup")
    world.run(0.8)
    assert world.belief.let_go() == {}


def test_what_is_seen_to_lie_where_a_hidden_hand_cannot_have_it_was_not_seen_to_be_put_down() -> None:
    world = lifted_and_lowered(0, 0.12)
    world.hand_seen = False
    world.seen.discard("cup")
    world.run(0.6)
    world.truths["cup"] = standing(0.42, 0.1, SMALL)
    world.seen.add("cup")
    world.run(1.5)
    assert world.belief.grasps() == {}
    assert world.belief.let_go()[HELD].state is LEFT_BEHIND


@pytest.mark.parametrize("seed", range(3))
def test_a_hidden_hand_has_what_is_seen_in_the_air_until_that_lies(seed: int) -> None:
    world = lifted_and_lowered(seed, 0.12)
    world.hand_seen = False
    world.run(0.3)
    world.move("cup", standing(0.3, 0.2, SMALL, on=0.12))
    world.run(0.5)
    world.move("cup", standing(0.3, 0.2, SMALL))
    at = world.now
    world.held, world.palm = "", Pose((0.5, 0.3, 0.3))
    world.run(2.0)
    assert world.belief.grasps() == {}
    assert world.belief.deeds("cup")[-1].kind == PLACE
    assert world.belief.deeds("cup")[-1].time == pytest.approx(at, abs=0.3)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_seen_to_fall_from_a_hidden_hand_was_dropped(seed: int) -> None:
    world = lifted_and_lowered(seed, 0.5)
    world.hand_seen = False
    world.run(0.5)
    opened(world, 0.5)
    world.run(1.0)
    assert world.belief.let_go()[HELD].state is DROPPED


@pytest.mark.parametrize(("height", "state"), [(0.08, LET_GO), (0.0, PUT_DOWN)])
def test_what_may_have_gone_down_with_a_hidden_hand_is_not_known_to_have_been_put_down(
    height: float, state: Handling
) -> None:
    world = lifted_and_lowered(0, height)
    world.seen.discard("cup")
    world.run(0.5)
    opened(world, height)
    assert world.belief.let_go()[HELD].state is LET_GO
    world.hand_seen = False
    world.run(0.5)
    world.seen.add("cup")
    world.run(0.5)
    assert world.belief.let_go()[HELD].state is state


def test_how_a_touch_that_held_something_in_the_air_ends_is_known_as_of_a_pinch() -> None:
    world = lifted_and_lowered(0, 0.12)
    world.hand("cup", tips="touch")
    world.run(0.6)
    assert world.belief.grasps()[HELD].state is TOUCHING
    world.move("cup", standing(0.3, 0.0, SMALL))
    world.run(0.4)
    world.held, world.palm = "", Pose((0.5, 0.3, 0.3))
    world.run(0.8)
    assert world.belief.let_go()[HELD].state is PUT_DOWN


def test_nothing_is_told_of_a_hand_that_is_no_more() -> None:
    world = lifted_and_lowered(0, 0.12)
    world.palm = None
    world.belief.touch({})
    world.run(0.5)
    assert world.belief.let_go() == {}


@pytest.mark.parametrize("seed", range(6))
def test_what_a_hand_lowers_and_quickly_rises_from_was_not_dropped(seed: int) -> None:
    world = lifted_and_lowered(seed, 0.1)
    world.move("cup", standing(0.3, 0.0, SMALL), speed=0.2)
    world.held, places, palm = "", world.tips_from_object, world.palm
    assert palm is not None
    for k in range(1, 9):
        wider = min(0.2 * k * PERIOD, 0.025)
        world.tips_from_object = {name: (x, y + math.copysign(wider, y), z) for name, (x, y, z) in places.items()}
        world.palm = Pose((0.0, 0.0, 0.15 * k * PERIOD)) @ palm
        world.tick()
    world.run(0.5)
    assert world.belief.grasps() == {}
    assert world.belief.let_go()[HELD].state is not DROPPED
