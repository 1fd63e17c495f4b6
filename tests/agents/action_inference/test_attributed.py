"""The default policy: who did what when, and what is no action."""

from __future__ import annotations

from typing import Any

import pytest

from agents.action_inference.attributed import AttributedPolicy
from agents.action_inference.observation import Holder, ObservedEnd, ObservedGrasp
from dsr.math3d.transforms import Pose
from dsr.vocabulary.observed_actions import PICK, PLACE, RELEASE, Action
from tests.agents.action_inference.stage import TICK, Stage

UP, DOWN, ASIDE = (0.0, 0.0, 0.2), (0.0, 0.0, -0.2), (0.2, 0.0, 0.0)
NOTICED = 0.1  # s until the belief knows that a thing is taken up
HAND = "human_hand_0"


@pytest.fixture
def stage() -> Stage:
    """A cup that lies on the table and was seen for 1 s, with noise of 3 mm."""
    stage = Stage(AttributedPolicy(), noise=0.003)
    stage.add("cup", (0.0, 0.0, 0.02))
    stage.run(1.0)
    return stage


def lift(stage: Stage, name: str = "cup", seconds: float = 1.0) -> float:
    """Lift it at 0.2 m/s; the belief says so of what something holds. Returns when that began."""
    began = stage.now
    stage.change(name, on=frozenset(), plausible=False)
    stage.run(NOTICED, **{name: UP})
    if stage.things[name].grasps:
        stage.change(name, lifted=began)
    stage.run(seconds - NOTICED, **{name: UP})
    return began


def put_down(stage: Stage, name: str = "cup", seconds: float = 1.0) -> float:
    """The reverse; returns when it touched down."""
    stage.run(seconds, **{name: DOWN})
    stage.change(name, on=frozenset({"table"}), plausible=True)
    return stage.now


def test_it_is_picked_and_placed_by_an_unknown_hand_at_the_right_times(stage: Stage):
    picked = lift(stage)
    stage.run(2.0)
    placed = put_down(stage)
    stage.run(1.0)
    assert stage.told == ["Pick(cup)", "Place(cup)"]
    (pick_noticed, pick), (place_noticed, place) = stage.actions
    assert pick.time == pytest.approx(picked, abs=0.1) and pick_noticed < picked + 0.4
    assert place.time == pytest.approx(placed, abs=0.1) and place_noticed < placed + 0.4


def test_an_action_is_no_more_probable_than_the_grasp_that_it_rests_on():
    told = {}
    for probability in (1.0, 0.6):
        stage = Stage(AttributedPolicy())
        stage.add("cup", (0.0, 0.0, 0.02))
        stage.run(1.0)
        stage.change("cup", grasps=(ObservedGrasp(HAND, stage.now, probability),))
        lift(stage)
        stage.run(1.0)
        put_down(stage)
        stage.grasp("cup")
        stage.run(1.0)
        assert [action.kind for _, action in stage.actions] == [PICK, PLACE]
        told[probability] = stage.confidences
    assert told[0.6] == pytest.approx([0.6 * confidence for confidence in told[1.0]])


def test_what_is_probably_not_where_it_is_said_to_lie_was_probably_not_let_go():
    """A hand goes out of sight, and the belief presumes that the thing fell from it: nobody has seen that."""
    for probability in (1.0, 0.7):
        stage = Stage(AttributedPolicy())
        stage.add("cup", (0.0, 0.0, 0.02))
        stage.run(1.0)
        stage.change("cup", grasps=(ObservedGrasp(HAND, stage.now, 0.9),))
        lift(stage)
        stage.run(1.0)
        stage.visible["cup"] = False
        stage.grasp("cup")
        stage.run(0.4)
        stage.change("cup", believed=Pose((0.0, 0.0, 0.02)), plausible=True, on=frozenset({"table"}), lies=probability)
        stage.run(1.0)
        assert stage.told == [f"Pick(cup, {HAND})", f"Release(cup, {HAND})"]
        assert stage.confidences == pytest.approx([0.9, 0.9 * 0.7 * probability]), "nobody saw it fall"


def test_a_hand_that_opens_has_held_the_thing_as_probably_as_before():
    stage = Stage(AttributedPolicy())
    stage.add("cup", (0.0, 0.0, 0.02))
    stage.run(1.0)
    stage.change("cup", grasps=(ObservedGrasp(HAND, stage.now, 0.7),))
    lift(stage)
    stage.change("cup", grasps=(ObservedGrasp(HAND, stage.now, 0.95),))
    stage.run(1.0)
    put_down(stage)
    stage.change("cup", grasps=(ObservedGrasp(HAND, stage.now, 0.1),))
    stage.run(0.3)
    stage.grasp("cup")
    stage.run(1.0)
    stage.change("cup", grasps=(ObservedGrasp(HAND, stage.now, 0.4),))
    lift(stage)
    stage.run(1.0)
    assert [action.kind for _, action in stage.actions] == [PICK, PLACE, PICK]
    assert stage.confidences == pytest.approx([0.7, 0.95, 0.4]), "another hold is as probable as it is itself"


def test_noise_is_no_pick():
    for noise in (0.003, 0.005):
        stage = Stage(AttributedPolicy(), noise=noise)
        stage.add("cup", (0.0, 0.0, 0.02))
        stage.run(300.0)
        assert stage.told == []


def test_a_single_false_percept_is_no_pick(stage: Stage):
    stage.true["cup"] = (0.0, 0.0, 0.2)
    stage.run(0.1)
    stage.true["cup"] = (0.0, 0.0, 0.02)
    stage.run(2.0)
    assert stage.told == []


def test_what_is_pushed_or_hidden_or_falls_off_the_table_is_not_picked(stage: Stage):
    stage.run(1.0, cup=ASIDE)
    stage.visible["cup"] = False
    stage.run(3.0)
    stage.change("cup", on=frozenset())
    stage.run(0.4, cup=(0.0, 0.0, -1.7))
    stage.run(2.0)
    stage.visible["cup"] = True
    stage.run(2.0)
    assert stage.told == []


def test_who_grasps_it_has_picked_it_rather_than_who_is_nearer(stage: Stage):
    stage.holders = {name: Holder(name, ((0.0, 0.0, 0.05),)) for name in (HAND, "gripper")}
    stage.grasp("cup", "gripper")
    stage.visible["cup"] = False
    lift(stage)
    assert stage.told == ["Pick(cup, gripper)"]
    put_down(stage)
    stage.run(0.5)
    assert stage.told == ["Pick(cup, gripper)"], "it is not let go yet"
    stage.grasp("cup")
    stage.run(0.5)
    assert stage.told == ["Pick(cup, gripper)", "Place(cup, gripper)"]


def test_what_is_held_is_picked_when_the_belief_says_so_and_told_once(stage: Stage):
    stage.grasp("cup", HAND)
    stage.run(1.0, cup=(0.0, 0.0, 0.05))
    assert stage.told == [], "whether a hand takes it up is for the belief to say"
    stage.change("cup", lifted=stage.now - 0.4)
    stage.run(0.2)
    assert stage.told == [f"Pick(cup, {HAND})"]
    assert stage.actions[0][1].time == pytest.approx(stage.now - 0.6)
    stage.change("cup", on=frozenset({"table"}), plausible=True)
    stage.grasp("cup")
    stage.run(1.0)
    stage.grasp("cup", HAND)
    stage.run(1.0)
    assert [action.kind for _, action in stage.actions] == [PICK, PLACE]


def test_what_an_earlier_run_has_told_is_not_picked_again():
    policy = AttributedPolicy()
    policy.recall(Action(99.0, PLACE, "cup", HAND))
    later = Stage(policy)
    later.add("cup", (0.0, 0.0, 0.02), lifted=97.0)
    later.grasp("cup", HAND)
    later.run(1.0)
    assert later.told == []


def test_the_nearest_hand_has_picked_it_where_no_grasp_is_told(stage: Stage):
    stage.holders = {
        HAND: Holder(HAND, ((0.5, 0.0, 0.2), (0.0, 0.05, 0.1))),
        "human_hand_1": Holder("human_hand_1", ((0.3, 0.0, 0.1),)),
    }
    lift(stage)
    assert stage.told == [f"Pick(cup, {HAND})"]


def test_what_is_held_out_of_sight_is_not_released(stage: Stage):
    stage.holders = {HAND: Holder(HAND, ((0.0, 0.0, 0.05),))}
    stage.grasp("cup", HAND)
    lift(stage)
    stage.visible["cup"] = False
    stage.holders = {HAND: Holder(HAND, ((0.0, 0.0, 0.05),), perceived=False)}
    stage.run(3.0, cup=ASIDE)
    assert stage.told == [f"Pick(cup, {HAND})"]
    stage.visible["cup"] = True
    put_down(stage)
    stage.grasp("cup")
    stage.run(1.0)
    assert stage.told == [f"Pick(cup, {HAND})", f"Place(cup, {HAND})"]


def test_what_a_hidden_hand_has_taken_is_not_released_though_no_grasp_is_told(stage: Stage):
    stage.holders = {HAND: Holder(HAND, ((0.0, 0.0, 0.05),))}
    lift(stage)
    stage.visible["cup"] = False
    stage.holders = {HAND: Holder(HAND, ((0.0, 0.0, 0.05),), perceived=False)}
    stage.change("cup", plausible=True, believed=Pose((0.0, 0.0, 0.02)), on=frozenset({"table"}))
    stage.run(3.0)
    assert stage.told == [f"Pick(cup, {HAND})"]


def test_what_is_let_go_of_in_the_air_is_released_at_that_time(stage: Stage):
    stage.grasp("cup", HAND)
    lift(stage)
    let_go = stage.now
    stage.grasp("cup")
    stage.visible["cup"] = False
    stage.run(0.1, cup=(0.0, 0.0, -1.8))
    stage.change("cup", inside=frozenset({"box"}), plausible=True)
    stage.run(2.0)
    assert stage.told == [f"Pick(cup, {HAND})", f"Release(cup, {HAND})"]
    noticed, release = stage.actions[1]
    assert release.time == pytest.approx(let_go, abs=0.1) and noticed < let_go + 0.2


def test_what_vanishes_from_the_air_and_is_believed_below_was_released_by_somebody(stage: Stage):
    lift(stage)
    stage.run(1.0)
    let_go = stage.now
    stage.visible["cup"] = False
    stage.run(0.8)
    assert stage.told == ["Pick(cup)"], "as long as it is believed in the air"
    stage.change("cup", plausible=True, believed=Pose((0.0, 0.0, 0.02)), inside=frozenset({"box"}))
    stage.run(1.0)
    assert stage.told == ["Pick(cup)", "Release(cup)"]
    assert stage.actions[1][1].time == pytest.approx(let_go, abs=0.15)


def test_contents_are_not_picked_when_their_container_is(stage: Stage):
    stage.add("ball", (0.3, 0.0, 0.03), on=frozenset(), inside=frozenset({"green"}))
    stage.add("green", (0.3, 0.0, 0.05), size=(0.1, 0.1, 0.1))
    stage.run(1.0)
    stage.change("green", on=frozenset(), plausible=False)
    stage.run(1.0, green=UP, ball=UP)
    stage.visible["ball"] = False
    stage.run(1.0)
    stage.run(1.0, green=DOWN)
    stage.change("green", on=frozenset({"table"}), plausible=True)
    stage.change("ball", inside=frozenset({"blue"}), believed=Pose((0.5, 0.0, 0.03)))
    stage.visible["ball"] = True
    stage.true["ball"] = (0.5, 0.0, 0.03)
    stage.run(2.0)
    assert stage.told == ["Pick(green)", "Place(green)"]


def test_contents_can_be_taken_out_of_what_lies_still(stage: Stage):
    stage.add("green", (0.3, 0.0, 0.05), size=(0.1, 0.1, 0.1))
    stage.add("ball", (0.3, 0.0, 0.03), on=frozenset(), inside=frozenset({"green"}))
    stage.run(1.0)
    stage.change("ball", inside=frozenset(), plausible=False)
    stage.run(1.0, ball=UP)
    assert stage.told == ["Pick(ball)"]


def test_a_noisy_percept_of_what_a_thing_lies_on_hides_no_pick(stage: Stage):
    stage.add("lid", (0.0, 0.0, 0.06), on=frozenset({"cup"}))
    stage.run(1.0)
    stage.grasp("lid", HAND)
    x, y, z = stage.true["cup"]
    stage.true["cup"] = (x, y, z + 0.012)
    stage.run(0.1)
    stage.true["cup"] = (x, y, z)
    lift(stage, "lid")
    put_down(stage, "lid")
    stage.grasp("lid")
    stage.run(0.5)
    assert stage.told == ["Pick(lid, human_hand_0)", "Place(lid, human_hand_0)"]


def test_what_a_hand_keeps_holding_where_it_put_it_came_to_rest_when_it_touched_down(stage: Stage):
    stage.grasp("cup", HAND)
    stage.run(0.3)
    lift(stage)
    placed = put_down(stage)
    stage.run(20.0)
    stage.grasp("cup")
    stage.run(0.5)
    assert stage.told == ["Pick(cup, human_hand_0)", "Place(cup, human_hand_0)"]
    assert stage.actions[-1][1].time == pytest.approx(placed, abs=0.1)


def test_it_can_be_picked_again(stage: Stage):
    for _ in range(3):
        lift(stage)
        put_down(stage)
        stage.run(1.0)
    assert [action.kind for _, action in stage.actions] == [PICK, PLACE] * 3


def test_what_is_seen_again_higher_up_lies_there_unless_it_is_implausible():
    for plausible in (True, False):
        stage = Stage(AttributedPolicy())
        stage.add("cup", (0.0, 0.0, 0.02))
        stage.run(1.0)
        stage.visible["cup"] = False
        stage.run(2.0)
        stage.visible["cup"], stage.true["cup"] = True, (0.1, 0.0, 0.1)
        stage.change("cup", plausible=plausible)
        stage.run(2.0)
        assert stage.told == ([] if plausible else ["Pick(cup)"])


def test_what_is_seen_again_lies_where_it_is_seen_to_lie_and_not_where_its_last_sight_was_off():
    stage = Stage(AttributedPolicy(), bias=0.0)
    stage.add("cup", (0.0, 0.0, 0.02))
    stage.run(1.0)
    x, y, z = stage.true["cup"]
    stage.true["cup"] = (x, y, z - 0.017)  # so little of it was in sight that it seemed to be lower
    stage.run(1.0)
    stage.visible["cup"], stage.true["cup"] = False, (x, y, z)
    stage.run(3.0)
    stage.visible["cup"] = True
    for height in (0.0, -0.013, 0.002, 0.004, 0.0, 0.002):
        stage.true["cup"] = (x, y, z + height)
        stage.run(0.1)
    stage.run(1.0)
    assert stage.told == []


def test_a_grasp_that_is_lost_sight_of_does_not_end_the_hold(stage: Stage):
    stage.grasp("cup", HAND)
    lift(stage)
    stage.grasp("cup")
    stage.run(3.0)
    assert stage.told == [f"Pick(cup, {HAND})"]
    put_down(stage)
    stage.run(1.0)
    assert stage.told[1:] == [f"Place(cup, {HAND})"]


def lower(stage: Stage, seconds: float, cup: float, hand: float) -> None:
    """Let the cup and the hand above it sink at these speeds, m/s."""
    for _ in range(round(seconds / TICK)):
        ((x, y, z), *_) = stage.holders[HAND].points
        stage.holders = {HAND: Holder(HAND, ((x, y, z - hand * TICK),))}
        stage.run(TICK, cup=(0.0, 0.0, -cup))


@pytest.mark.parametrize("missing", [0.1, 0.4, 10.0])
def test_a_grasp_that_is_lost_sight_of_while_the_hand_puts_it_down_is_no_release(stage: Stage, missing: float):
    stage.holders = {HAND: Holder(HAND, ((0.0, 0.0, 0.25),))}
    stage.grasp("cup", HAND)
    lift(stage)
    height = stage.true["cup"][2] - 0.02
    lower(stage, 0.2, 0.25, 0.25)
    stage.grasp("cup")
    lower(stage, min(missing, height / 0.25 - 0.2), 0.25, 0.25)
    if missing < 1.0:
        stage.grasp("cup", HAND)
        lower(stage, height / 0.25 - 0.2 - missing, 0.25, 0.25)
        stage.grasp("cup")
    down = stage.now
    stage.change("cup", plausible=True, on=frozenset({"table"}))
    stage.run(1.0)
    assert stage.told == [f"Pick(cup, {HAND})", f"Place(cup, {HAND})"]
    assert stage.actions[1][1].time == pytest.approx(down, abs=0.15)


def test_a_hand_that_goes_up_from_what_it_put_down_has_not_released_it(stage: Stage):
    stage.holders = {HAND: Holder(HAND, ((0.0, 0.0, 0.25),))}
    stage.grasp("cup", HAND)
    lift(stage)
    lower(stage, 1.0, 0.2, 0.2)
    stage.grasp("cup")
    lower(stage, 0.5, 0.0, -0.5)
    stage.change("cup", plausible=True, on=frozenset({"table"}))
    lower(stage, 0.5, 0.0, -0.5)
    assert stage.told == [f"Pick(cup, {HAND})", f"Place(cup, {HAND})"]


@pytest.mark.parametrize(("seen", "kind"), [(False, "Place"), (True, "Release")])
def test_what_a_hand_only_seems_to_take_along_after_it_put_it_down_was_placed(stage: Stage, seen: bool, kind: str):
    stage.grasp("cup", HAND)
    lift(stage)
    put_down(stage)
    stage.visible["cup"] = seen
    stage.run(0.5)
    rested = stage.now
    stage.change("cup", on=frozenset())
    stage.run(0.4, cup=(0.0, 0.0, 0.2))
    stage.grasp("cup")
    stage.run(0.2, cup=(0.0, 0.0, -0.4))
    stage.change("cup", plausible=True, on=frozenset({"table"}))
    stage.run(0.5)
    assert stage.told == [f"Pick(cup, {HAND})", f"{kind}(cup, {HAND})"]
    assert stage.actions[1][1].time == pytest.approx(rested if kind == "Place" else rested + 0.4, abs=0.1)


def see_more(stage: Stage) -> None:
    """Two more cups beside it, seen for 2 s."""
    for number in (1, 2):
        stage.add(f"cup_{number}", (0.2 * number, 0.0, 0.02))
    stage.run(2.0)


def shake(stage: Stage, shift: tuple[float, float, float]) -> None:
    """All percepts are displaced from now on; beliefs are not."""
    stage.true = {name: (x + shift[0], y + shift[1], z + shift[2]) for name, (x, y, z) in stage.true.items()}


@pytest.mark.parametrize("height", [0.03, -0.04])
def test_what_a_bumped_camera_sees_higher_or_lower_is_not_picked(stage: Stage, height: float):
    see_more(stage)
    shake(stage, (0.01, 0.0, height))
    stage.run(1.0)
    for name in stage.things:
        stage.change(name, in_doubt=True)
    stage.run(2.0)
    shake(stage, (-0.01, 0.0, -height))
    stage.run(0.1)
    for name in stage.things:
        stage.change(name, in_doubt=False)
    stage.run(2.0)
    assert stage.told == []


def test_a_camera_that_stays_in_doubt_tells_nothing_of_what_it_saw_long_before(stage: Stage):
    stage.change("cup", in_doubt=True)
    shake(stage, (0.01, 0.0, 0.03))
    stage.run(10.0)
    stage.change("cup", in_doubt=False)
    stage.run(1.0)
    assert stage.told == []


def test_what_is_lifted_while_the_camera_is_in_doubt_is_told_when_it_is_not(stage: Stage):
    stage.change("cup", in_doubt=True)
    picked = lift(stage)
    assert stage.told == []
    stage.change("cup", in_doubt=False)
    stage.run(0.5)
    assert stage.told == ["Pick(cup)"]
    assert stage.actions[0][1].time == pytest.approx(picked, abs=0.1)


def test_one_of_several_that_is_lifted_by_itself_is_picked_at_once(stage: Stage):
    see_more(stage)
    began = lift(stage)
    assert stage.told == ["Pick(cup)"]
    assert stage.actions[0][0] - began < 0.5


def test_what_is_lifted_all_at_once_is_picked_after_a_while(stage: Stage):
    see_more(stage)
    picked = stage.now
    for name in stage.things:
        stage.change(name, on=frozenset(), plausible=False)
    stage.run(1.0, **dict.fromkeys(stage.things, UP))
    stage.run(1.5)
    assert sorted(stage.told) == ["Pick(cup)", "Pick(cup_1)", "Pick(cup_2)"]
    assert all(action.time == pytest.approx(picked, abs=0.1) for _, action in stage.actions)


def test_what_falls_from_a_hand_that_goes_down_is_released(stage: Stage):
    stage.holders = {HAND: Holder(HAND, ((0.0, 0.0, 0.25),))}
    stage.grasp("cup", HAND)
    lift(stage)
    lower(stage, 0.2, 0.2, 0.2)
    let_go = stage.now
    stage.grasp("cup")
    lower(stage, 0.1, 0.6, 0.2)
    stage.change("cup", plausible=True, on=frozenset({"table"}))
    lower(stage, 0.5, 0.0, 0.2)
    assert stage.told == [f"Pick(cup, {HAND})", f"Release(cup, {HAND})"]
    assert stage.actions[1][1].time == pytest.approx(let_go, abs=0.1)


@pytest.mark.parametrize(("how", "kind"), [("dropped", "Release"), ("put down", "Place")])
def test_how_the_belief_says_that_a_hand_let_go_is_told(stage: Stage, how: str, kind: str):
    """The grasp ends when the thing has long been lying: only the belief knows how it came down."""
    stage.grasp("cup", HAND)
    lift(stage)
    stage.run(0.7, cup=(0.0, 0.0, -0.2))
    let_go = stage.now
    stage.run(0.1, cup=(0.0, 0.0, -0.3))
    stage.change("cup", plausible=True, on=frozenset({"table"}))
    stage.run(0.2)
    stage.grasp("cup")
    stage.change("cup", let_go=ObservedEnd(HAND, let_go, how))
    stage.run(0.5)
    assert stage.told == [f"Pick(cup, {HAND})", f"{kind}(cup, {HAND})"]
    assert stage.actions[1][1].time == pytest.approx(let_go, abs=0.15)


def test_an_earlier_run_is_continued(stage: Stage):
    policy = AttributedPolicy()
    policy.recall(Action(99.0, PICK, "cup", HAND))
    policy.recall(Action(98.0, RELEASE, "plate", HAND))
    later = Stage(policy)
    later.add("cup", (0.0, 0.0, 0.02))
    later.add("plate", (0.3, 0.0, 0.02))
    later.run(1.0)
    assert later.told == [f"Place(cup, {HAND})"] and later.actions[0][1].kind == PLACE


def found_in_hand(plausible: bool = False) -> Stage:
    """A cup that was never seen before comes into view in the air, in a hand that is in view."""
    stage = Stage(AttributedPolicy(), noise=0.003)
    stage.holders = {HAND: Holder(HAND, ((0.0, 0.0, 0.25),))}
    stage.add("cup", (0.0, 0.0, 0.22), on=frozenset(), plausible=plausible, believed=None)
    stage.visible["cup"] = False
    stage.run(1.0)
    stage.visible["cup"] = True
    stage.change("cup", believed=Pose((0.0, 0.0, 0.22)))
    stage.run(0.3)
    stage.grasp("cup", HAND)
    return stage


def test_what_is_first_seen_in_a_hand_is_placed_though_nobody_saw_it_picked():
    stage = found_in_hand()
    stage.run(1.0, cup=ASIDE)
    placed = put_down(stage)
    stage.run(1.0)
    assert stage.told == []
    stage.grasp("cup")
    stage.run(1.0)
    assert stage.told == [f"Place(cup, {HAND})"]
    assert stage.actions[0][1].time == pytest.approx(placed, abs=0.1)


def test_what_is_first_seen_in_a_hand_that_opens_is_released():
    stage = found_in_hand()
    stage.run(1.0, cup=ASIDE)
    stage.grasp("cup")
    stage.run(0.1, cup=(0.0, 0.0, -2.0))
    stage.change("cup", plausible=True, on=frozenset({"table"}))
    stage.run(1.0)
    assert stage.told == [f"Release(cup, {HAND})"]


def test_what_a_hand_touches_where_it_is_first_seen_is_not_placed():
    for settles_after in (0.2, 1.0):
        stage = found_in_hand()
        stage.run(settles_after)
        stage.change("cup", plausible=True, on=frozenset({"shelf"}))  # it has stood on something unknown all the time
        stage.run(1.0)
        stage.grasp("cup")
        stage.run(2.0)
        assert stage.told == []


def out_of_sight(stage: Stage, seconds: float = 2.0, *, hand_too: bool = True, palm_too: bool = True) -> None:
    """Hide the cup that a hand has lifted, and then that hand, or its fingers, for some time."""
    stage.holders = {HAND: Holder(HAND, ((0.0, 0.0, 0.25),))}
    stage.visible["cup"] = False
    stage.run(0.5)
    hidden = Holder(HAND, ((0.0, 0.0, 0.25),), perceived=not (hand_too and palm_too), shows_fingers=not hand_too)
    stage.holders = {HAND: hidden}
    stage.run(seconds)
    stage.holders = {HAND: Holder(HAND, ((0.0, 0.0, 0.25),))}
    stage.run(0.2)


def comes_down(stage: Stage, to: tuple[float, float, float] = (0.05, 0.0, 0.12), lean: float = 0.0) -> None:
    """Believe that the cup, which nobody sees, is now there, on a shelf, and leans (rad)."""
    stage.change("cup", believed=Pose.from_rotvec(to, (lean, 0.0, 0.0)), plausible=True, on=frozenset({"shelf"}))
    stage.run(1.7)


@pytest.mark.parametrize(("grasps", "palm_too"), [(True, True), (False, True), (True, False)])
def test_what_was_left_where_nobody_saw_it_was_probably_put_down(stage: Stage, grasps: bool, palm_too: bool):
    stage.holders = {HAND: Holder(HAND, ((0.0, 0.0, 0.05),))}
    if grasps:
        stage.grasp("cup", HAND)
    lift(stage)
    out_of_sight(stage, palm_too=palm_too)
    reappeared = stage.now - 0.2
    stage.grasp("cup")
    comes_down(stage)
    assert stage.told == [f"Pick(cup, {HAND})", f"Place(cup, {HAND})"]
    assert stage.actions[1][1].time == pytest.approx(reappeared, abs=0.1) and stage.confidences[1] == 0.7


@pytest.mark.parametrize(
    ("hand_too", "to", "lean"),
    [(False, (0.05, 0.0, 0.12), 0.0), (True, (0.05, 0.0, -0.2), 0.0), (True, (0.3, 0.0, 0.12), 0.0),
     (True, (0.05, 0.0, 0.12), 1.57)],
)  # fmt: skip
def test_what_fell_further_or_over_or_from_a_hand_in_sight_was_released(
    stage: Stage, hand_too: bool, to: tuple[float, float, float], lean: float
):
    stage.change("cup", size=(0.03, 0.03, 0.04))
    stage.grasp("cup", HAND)
    lift(stage)
    out_of_sight(stage, hand_too=hand_too)
    stage.grasp("cup")
    comes_down(stage, to, lean)
    assert stage.told == [f"Pick(cup, {HAND})", f"Release(cup, {HAND})"]


def test_what_is_still_coming_down_may_yet_stand_there(stage: Stage):
    stage.change("cup", size=(0.03, 0.03, 0.04))
    stage.grasp("cup", HAND)
    lift(stage)
    out_of_sight(stage)
    stage.grasp("cup")
    stage.change("cup", believed=Pose.from_rotvec((0.05, 0.0, 0.14), (0.5, 0.0, 0.0)))
    stage.run(0.2)
    comes_down(stage)
    assert stage.told == [f"Pick(cup, {HAND})", f"Place(cup, {HAND})"]


def test_what_is_not_seen_where_it_would_have_been_put_down_was_released(stage: Stage):
    stage.grasp("cup", HAND)
    lift(stage)
    out_of_sight(stage)
    stage.grasp("cup")
    stage.change("cup", believed=Pose((0.05, 0.0, 0.12)), plausible=True, on=frozenset({"shelf"}))
    stage.run(1.2)
    assert stage.told == [f"Pick(cup, {HAND})"]
    comes_down(stage, (0.1, 0.3, -0.7))
    assert stage.told == [f"Pick(cup, {HAND})", f"Release(cup, {HAND})"]


def test_what_is_seen_to_fall_after_it_was_out_of_sight_was_released(stage: Stage):
    stage.grasp("cup", HAND)
    lift(stage)
    out_of_sight(stage)
    stage.grasp("cup")
    stage.visible["cup"] = True
    stage.run(0.1)
    stage.run(0.1, cup=(0.0, 0.0, -0.9))
    stage.change("cup", plausible=True, on=frozenset({"shelf"}))
    stage.run(1.0)
    assert stage.told == [f"Pick(cup, {HAND})", f"Release(cup, {HAND})"]


@pytest.mark.parametrize(("stays", "palm", "kind"), [(0.0, 0.2, PLACE), (0.5, 0.2, RELEASE), (0.0, 0.24, RELEASE)])
def test_what_was_lowered_by_a_hand_that_goes_on_down_was_put_down(stage: Stage, stays: float, palm: float, kind: str):
    stage.change("cup", size=(0.03, 0.03, 0.04))
    stage.holders = {HAND: Holder(HAND, ((0.0, 0.0, 0.25),))}
    stage.grasp("cup", HAND)
    lift(stage, seconds=2.0)
    stage.run(0.5, cup=DOWN)
    stage.run(stays)
    stage.visible["cup"] = False
    stage.run(0.4)
    stage.grasp("cup")
    stage.holders = {HAND: Holder(HAND, ((0.0, 0.0, palm),))}
    comes_down(stage, (0.0, 0.0, 0.1))
    assert stage.told == [f"Pick(cup, {HAND})", f"{kind}(cup, {HAND})"]


@pytest.mark.parametrize(("stays", "kind"), [(0.0, PLACE), (0.5, RELEASE)])
@pytest.mark.parametrize(
    "rests", [{"plausible": True, "inside": frozenset({"box"})}, {"plausible": False, "on": frozenset({"box"})}]
)
def test_what_was_being_lowered_when_it_was_last_seen_was_put_down(
    stage: Stage, rests: dict[str, Any], stays: float, kind: str
):
    lift(stage)
    stage.run(0.5, cup=DOWN)
    stage.run(stays)
    vanished = stage.now
    stage.visible["cup"] = False
    stage.run(1.0)
    stage.change("cup", believed=Pose((0.0, 0.0, 0.04)), **rests)
    stage.run(1.0)
    assert stage.told == ["Pick(cup)", f"{kind}(cup)"]
    assert stage.actions[1][1].time == pytest.approx(vanished + (0.4 if kind == PLACE else 0.0), abs=0.15)
