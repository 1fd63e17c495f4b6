"""What the belief says was done with things: taken up, put down or dropped, by whom, when, and how surely."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import pytest

from dsr.math3d.transforms import Pose
from dsr.vocabulary.handling import Handling
from dsr.vocabulary.observed_actions import DEEDS, PICK, PLACE, RELEASE, UNKNOWN, Deed, deeds_of, encoded
from simulation_handler.config import BeliefConfig
from simulation_handler.hands.deeds import GUESSED, Deeds, HoldMoment
from simulation_handler.hands.letting_go import LetGo
from simulation_handler.hands.touching import Touching
from simulation_handler.motion.holding import GripperGrasp
from tests.simulation_handler.occluded import BOX, PERIOD, SMALL, Occlusion, standing
from tests.simulation_handler.test_agent import Table
from tests.simulation_handler.worlds import CUBE, cube_at

HELD_ALOFT = 0.97
"""1, least probability of what is seen in the air in a hand"""
AWAY = Pose((0.5, 0.3, 0.3))
G = 9.81


def deeds(world: Occlusion, name: str = "cup") -> list[tuple[str, str]]:
    """What was done with it, and by whom."""
    return [(deed.kind, deed.by) for deed in world.belief.deeds(name)]


def last(world: Occlusion, name: str = "cup") -> Deed:
    return world.belief.deeds(name)[-1]


def grasped(seed: int = 0, tips: str = "pinch") -> Occlusion:
    """A cup on the table in a hand that has not moved it yet."""
    world = Occlusion({"cup": standing(0.3, 0.0, SMALL)}, seed)
    world.run(2.0)
    world.hand("cup", tips=tips)
    world.run(0.8)
    assert deeds(world) == []
    return world


def lifted(seed: int = 0, height: float = 0.15) -> Occlusion:
    """The same, in the air."""
    world = grasped(seed)
    world.move("cup", standing(0.3, 0.0, SMALL, on=height))
    return world


def open_hand(world: Occlusion) -> None:
    """Let the hand go away."""
    world.held, world.palm = "", AWAY
    world.run(1.0)


def fall(world: Occlusion, height: float, to: float = 0.0, y: float = 0.0) -> None:
    """Let the cup fall from that height (m) to the table, or to another height."""
    for k in range(1, 9):
        world.truths["cup"] = standing(0.3, y, SMALL, on=max(to, height - 0.5 * G * (k * PERIOD) ** 2))
        world.tick()


@pytest.mark.parametrize("seen", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_what_a_hand_takes_up_has_left_when_it_did(seed: int, seen: bool) -> None:
    world = grasped(seed)
    if not seen:
        world.seen.discard("cup")
        world.run(0.5)
    began = world.now
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.15))
    world.run(0.3)
    assert deeds(world) == [(PICK, "hand")]
    assert last(world).time == pytest.approx(began, abs=0.15)


@pytest.mark.parametrize("seed", range(3))
def test_what_a_hand_pushes_or_lets_lie_is_not_taken_up(seed: int) -> None:
    world = grasped(seed, "touch")
    world.move("cup", standing(0.3, 0.15, SMALL))
    world.run(3.0)
    assert deeds(world) == []


def test_what_is_in_what_a_hand_takes_up_is_not_taken_up_itself() -> None:
    world = Occlusion({"box": standing(0.3, 0.0, BOX), "ball": Pose((0.3, 0.0, 0.03))})
    world.run(2.0)
    world.hand("box")
    world.run(0.8)
    world.seen.discard("ball")
    world.move("box", standing(0.3, 0.0, BOX, on=0.15))
    world.run(0.3)
    world.move("box", standing(0.3, 0.2, BOX))
    world.run(0.5)
    open_hand(world)
    assert deeds(world, "box") == [(PICK, "hand"), (PLACE, "hand")] and deeds(world, "ball") == []


@pytest.mark.parametrize("seed", range(3))
def test_what_is_put_down_came_to_rest_when_it_touched_down_and_can_be_taken_up_again(seed: int) -> None:
    world = lifted(seed)
    world.move("cup", standing(0.3, 0.2, SMALL, on=0.15))
    world.move("cup", standing(0.3, 0.2, SMALL))
    down = world.now
    world.run(2.0)
    assert deeds(world) == [(PICK, "hand")], "it is not let go yet"
    open_hand(world)
    assert deeds(world) == [(PICK, "hand"), (PLACE, "hand")]
    assert last(world).time == pytest.approx(down, abs=0.25)
    world.hand("cup")
    world.run(0.8)
    world.move("cup", standing(0.3, 0.2, SMALL, on=0.15))
    assert deeds(world) == [(PLACE, "hand"), (PICK, "hand")], "older deeds are forgotten"


def test_it_is_taken_up_once_however_often_it_is_lowered_in_the_air() -> None:
    world = lifted()
    first = last(world)
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.05))
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.15))
    assert world.belief.deeds("cup") == (first,)


@pytest.mark.parametrize("seed", range(3))
def test_what_falls_was_released_when_the_hand_opened(seed: int) -> None:
    world = lifted(seed)
    world.run(0.5)
    opened = world.now
    world.held, world.palm = "", AWAY
    fall(world, 0.15)
    assert deeds(world) == [(PICK, "hand"), (RELEASE, "hand")], "before it is known where it comes to rest"
    assert last(world).time == pytest.approx(opened, abs=0.15)
    world.run(2.0)
    assert len(deeds(world)) == 2


class Moments:
    """What is believed of a cup, at 20 Hz."""

    def __init__(self) -> None:
        self.touching = SimpleNamespace(let_go={}, hands={"hand": None})
        unused: Any = None
        self.deeds = Deeds(unused, cast(Touching, self.touching), unused, unused)
        self.now = 1000.0

    def run(self, seconds: float, bottom: float, **values: Any) -> None:
        """Let time pass while its bottom is at that height (m)."""
        for _ in range(round(seconds / PERIOD)):
            self.now += PERIOD
            place = standing(0.3, 0.0, SMALL, on=bottom)
            self.deeds.take_in("cup", HoldMoment(time=self.now, pose=place, bottom=bottom, **values))

    def lift(self, height: float, *, lowered: bool = False) -> None:
        """Let a hand take the cup up."""
        self.run(1.0, 0.0, rests=True)
        self.run(1.0, height, holder="hand", held=0.9, hovers=True, palm=0.1 + height, lowered=lowered)

    def let_go(self, state: Handling) -> None:
        self.touching.let_go["hand", "cup"] = LetGo(state, self.now)

    @property
    def told(self) -> list[tuple[str, float]]:
        """Kind and probability of each deed."""
        return [(deed.kind, deed.probability) for deed in self.deeds.of("cup")]


GUESS = round(0.9 * GUESSED, 2)


@pytest.mark.parametrize(
    ("state", "height", "lowered", "palm", "told"),
    [
        (Handling.PUT_DOWN, 0.05, False, 0.1, (PLACE, 0.9)),
        (Handling.DROPPED, 0.02, False, 0.12, (RELEASE, 0.9)),
        (Handling.LET_GO, 0.1, False, 0.2, (RELEASE, GUESS)),
        (Handling.LET_GO, 0.1, True, 0.2, (PLACE, GUESS)),
        (Handling.LET_GO, 0.1, False, 0.1, (PLACE, GUESS)),
        (Handling.LEFT_BEHIND, 0.1, False, 0.2, (PLACE, GUESS)),
        (Handling.LEFT_BEHIND, 0.4, False, 0.5, (RELEASE, GUESS)),
    ],
)
def test_how_a_hold_ended_tells_what_was_done_and_else_how_far_it_came_down(
    state: Handling, height: float, lowered: bool, palm: float, told: tuple[str, float]
) -> None:
    cup = Moments()
    cup.lift(height, lowered=lowered)
    cup.let_go(state)
    cup.run(2.0, 0.0, rests=True, is_seen=False, palm=palm)
    assert cup.told == [(PICK, 0.9), told]


@pytest.mark.parametrize("bottom", [0.0, 0.095])
def test_what_nobody_sees_may_yet_be_found_missing_before_it_is_told_where_it_was_put(bottom: float) -> None:
    cup = Moments()
    cup.lift(0.1)
    cup.let_go(Handling.LEFT_BEHIND)
    cup.run(0.9, bottom, rests=True, is_seen=False)
    cup.run(0.3, -0.3)
    cup.run(1.2, -0.7, rests=True, is_seen=False)
    assert cup.told == [(PICK, 0.9), (RELEASE, GUESS)]


def test_what_is_probably_not_where_it_is_said_to_lie_was_probably_not_put_there() -> None:
    cup = Moments()
    cup.lift(0.1)
    cup.let_go(Handling.PUT_DOWN)
    cup.run(0.5, 0.0, rests=True, carried=0.5)
    assert cup.told == [(PICK, 0.9), (PLACE, 0.45)]


def test_how_an_earlier_hold_ended_does_not_count() -> None:
    cup = Moments()
    cup.lift(0.1)
    cup.let_go(Handling.DROPPED)
    cup.run(1.0, 0.0, rests=True)
    cup.run(1.0, 0.2, hovers=True, near="hand")
    assert [kind for kind, _ in cup.told] == [RELEASE, PICK]
    cup.run(0.5, 0.2, hovers=True)
    assert [kind for kind, _ in cup.told] == [RELEASE, PICK]
    cup.run(0.5, 0.2, rests=True)
    assert [kind for kind, _ in cup.told] == [PICK, PLACE]


@pytest.mark.parametrize(("hands", "by"), [(["hand"], "hand"), ([], UNKNOWN)])
def test_what_comes_back_was_put_down_by_a_guess_and_only_by_a_hand_that_is_still_known(
    hands: list[str], by: str
) -> None:
    cup = Moments()
    cup.lift(0.1)
    picked = cup.deeds.of("cup")[-1]
    cup.deeds = Deeds(*cast(Any, (None, cup.touching, None, None)))
    cup.deeds.recall("cup", [picked])
    cup.touching.hands = dict.fromkeys(hands)
    cup.run(0.5, 0.0, rests=True)
    assert [(deed.kind, deed.by, deed.probability) for deed in cup.deeds.of("cup")[1:]] == [(PLACE, by, GUESS)]


def test_how_a_hold_ended_before_it_was_gone_does_not_count_once_it_is_back() -> None:
    cup = Moments()
    cup.lift(0.1)
    cup.let_go(Handling.LEFT_BEHIND)
    picked = cup.deeds.of("cup")[-1]
    cup.deeds = Deeds(*cast(Any, (None, cup.touching, None, None)))
    cup.deeds.recall("cup", [picked])
    cup.now += 10.0
    back = cup.now
    cup.run(0.5, 0.0, rests=True)
    assert cup.deeds.of("cup")[-1] == Deed(PLACE, pytest.approx(back, abs=0.1), "hand", GUESS)


def test_what_comes_back_in_its_hand_is_as_surely_held_as_is_believed_then() -> None:
    cup = Moments()
    cup.deeds.recall("cup", [Deed(PICK, 999.0, "gripper", 0.5)])
    cup.run(0.5, 0.1, holder="gripper")
    cup.run(0.5, 0.0, rests=True)
    assert cup.deeds.of("cup")[-1] == Deed(PLACE, pytest.approx(1000.55, abs=0.1), "gripper", round(GUESSED, 2))


@pytest.mark.parametrize("values", [{"follows": True}, {"falls": True}, {"is_seen": False}, {"hovers": False}])
def test_what_goes_along_or_falls_or_is_not_seen_in_the_air_was_lifted_by_nobody(values: dict[str, bool]) -> None:
    cup = Moments()
    cup.run(1.0, 0.0, rests=True)
    cup.run(1.0, 0.1, **{"hovers": True, **values})
    assert cup.told == []


def test_the_only_hand_that_has_what_hovers_within_reach_lifted_it() -> None:
    cup = Moments()
    cup.run(1.0, 0.0, rests=True)
    cup.run(1.0, 0.1, hovers=True, near="hand", held=0.8)
    assert [(deed.by, deed.probability) for deed in cup.deeds.of("cup")] == [("hand", 0.8)]


def test_what_jumps_into_the_air_was_less_probably_taken_up_than_what_was_seen_on_its_way() -> None:
    way, jump = (Occlusion({"cup": standing(0.3, 0.0, SMALL)}) for _ in range(2))
    for world in (way, jump):
        world.run(2.0)
    way.move("cup", standing(0.3, 0.0, SMALL, on=0.4))
    jump.truths["cup"] = standing(0.3, 0.0, SMALL, on=0.4)
    jump.run(3.0)
    assert deeds(way) == deeds(jump) == [(PICK, UNKNOWN)]
    assert last(jump).probability < 0.65 and 0.7 < last(way).probability < 0.95


@pytest.mark.parametrize("seed", range(3))
def test_what_nobody_in_sight_lifts_and_puts_down_was_moved_by_somebody_unknown(seed: int) -> None:
    world = Occlusion({"cup": standing(0.3, 0.0, SMALL)}, seed)
    world.run(2.0)
    began = world.now
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.15))
    noticed = world.now
    assert deeds(world) == [(PICK, UNKNOWN)] and last(world).time == pytest.approx(began, abs=0.25)
    world.move("cup", standing(0.3, 0.2, SMALL, on=0.15))
    world.move("cup", standing(0.3, 0.2, SMALL))
    world.run(2.0)
    assert deeds(world) == [(PICK, UNKNOWN), (PLACE, UNKNOWN)] and last(world).time > noticed


def test_what_nobody_in_sight_lifts_and_drops_was_released() -> None:
    world = Occlusion({"cup": standing(0.3, 0.0, SMALL)})
    world.run(2.0)
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.3))
    world.run(1.0)
    dropped = world.now
    fall(world, 0.3)
    world.run(1.0)
    assert deeds(world) == [(PICK, UNKNOWN), (RELEASE, UNKNOWN)]
    assert last(world).time == pytest.approx(dropped, abs=0.15)


@pytest.mark.parametrize("seed", range(3))
def test_noise_a_false_percept_a_push_or_a_fall_off_the_table_are_no_deeds(seed: int) -> None:
    world = Occlusion({"cup": standing(0.3, 0.0, SMALL)}, seed, noise=0.004)
    world.run(20.0)
    world.truths["cup"] = standing(0.3, 0.0, SMALL, on=0.2)
    world.run(2 * PERIOD)
    world.truths["cup"] = standing(0.3, 0.0, SMALL)
    world.run(2.0)
    world.move("cup", standing(0.3, 0.2, SMALL))
    world.run(1.0)
    world.move("cup", standing(0.3, 0.65, SMALL), speed=0.5)
    floor = -BeliefConfig().floor_below_table
    fall(world, 0.0, to=floor, y=0.65)
    world.run(2.0)
    assert world.pose("cup").t[2] < 0.5 * floor and deeds(world) == []


def test_what_is_first_seen_in_a_hand_is_put_down_though_nobody_saw_it_picked() -> None:
    world = Occlusion({"cup": standing(0.3, 0.0, SMALL, on=0.3)})
    world.hand("cup")
    world.run(1.0)
    world.move("cup", standing(0.3, 0.0, SMALL))
    world.run(1.0)
    assert deeds(world) == []
    open_hand(world)
    assert deeds(world) == [(PLACE, "hand")]


def test_an_earlier_run_is_continued() -> None:
    before = lifted()
    world = Occlusion({"cup": before.truths["cup"]})
    world.belief.recall("cup", before.pose("cup"), held=True)
    world.belief.recall_deeds("cup", before.belief.deeds("cup"))
    world.hand("cup")
    world.run(1.0)
    assert world.belief.deeds("cup") == before.belief.deeds("cup"), "it is not told again"
    world.move("cup", standing(0.3, 0.0, SMALL))
    world.run(0.5)
    open_hand(world)
    assert deeds(world) == [(PICK, "hand"), (PLACE, "hand")]


def test_an_earlier_run_tells_who_had_taken_up_what_is_gone() -> None:
    table = Table()
    picked = Deed(PICK, table.lockstep.clock.now() - 60.0, "hand", 0.8)
    table.memory.add_node("cube_1", "cube", size=CUBE, mass=0.05, present=False, **{DEEDS: encoded([picked])})
    table.run(0.5)
    assert deeds_of(table.memory.node("cube_1")) == (picked,)
    table.truths["cube_1"] = cube_at(0.4, 0.1)
    table.run(1.0)
    found = [(deed.kind, deed.by, deed.probability) for deed in deeds_of(table.memory.node("cube_1"))]
    assert found == [(PICK, "hand", 0.8), (PLACE, UNKNOWN, pytest.approx(0.8 * GUESSED, abs=0.01))]
    table.lockstep.close()


def test_nothing_is_known_of_what_is_no_more() -> None:
    world = lifted()
    world.belief.remove("cup")
    world.belief.add_object("cup", SMALL)
    assert world.belief.deeds("cup") == ()


def test_a_deed_is_as_probable_as_the_hold_that_it_rests_on() -> None:
    world = lifted()
    picked = last(world).probability
    world.run(0.5)
    sure = world.belief.probability("grasping", ("hand", "cup"))
    assert 0.5 < picked <= 1.0 and math.isclose(sure, HELD_ALOFT, abs_tol=0.02)
    world.held, world.palm = "", AWAY
    fall(world, 0.15)
    assert last(world).kind == RELEASE and last(world).probability == pytest.approx(sure, abs=0.01)


def test_what_a_gripper_takes_up_has_left_when_it_did() -> None:
    world = Occlusion({"cube": Pose((0.3, 0.0, 0.02))})
    world.run(2.0)
    began = world.now
    for k in range(1, 21):
        gripper = Pose((0.3, 0.0, 0.1 + 0.01 * k))
        world.belief.hold({"cube": GripperGrasp("gripper", gripper, Pose((0.0, 0.0, -0.08)))})
        world.truths["cube"] = Pose((0.3, 0.0, 0.02 + 0.01 * k))
        world.tick()
    assert last(world, "cube") == Deed(PICK, pytest.approx(began, abs=0.15), "gripper", 1.0)
