"""True actions and relations from made-up truths, and how well they were known."""

from __future__ import annotations

import math

import pytest

from agents.scenario.format.scenario import parse_scenario
from agents.scenario.judge.accuracy import accuracy, true_holders, unseen_curves
from agents.scenario.judge.metrics import measure
from agents.scenario.truth.actions import compare, true_actions
from agents.scenario.truth.history import History, Inferred, Sample
from agents.scenario.truth.relations import true_contents, true_relations
from dsr.math3d.transforms import Pose
from dsr.vocabulary.observed_actions import PICK, PLACE, RELEASE, Action

FILE = """
name = "grips"
title = "A cube is moved about, and a ball is in a container"
duration = 10.0
settle = 1.0

[[object]]
name = "cube"
position = [0.3, 0.0, 0.02]

[[object]]
name = "green"
model = "container_green"
known = true
position = [0.6, 0.0, 0.075]

[[object]]
name = "ball"
model = "ball"
known = true
position = [0.3, 0.3, 0.03]
"""
RATE = 20
HAND = "human_hand_0"


def history_of(heights: dict[float, float], grips: dict[float, str | None], extra: str = "") -> History:
    """The cube at heights (m) that are given at times (s) and interpolated, held by whom from those times on."""
    history = History(parse_scenario(FILE + extra))
    times = sorted(heights)
    for step in range(10 * RATE + 1):
        time = step / RATE
        after = next((t for t in times if t >= time), times[-1])
        before = max((t for t in times if t <= time), default=times[0])
        share = 0.0 if after == before else (time - before) / (after - before)
        z = heights[before] + share * (heights[after] - heights[before])
        by = [who for since, who in sorted(grips.items()) if since <= time]
        truth = {"cube": Pose((0.3, 0.0, z))}
        edges = {("on", "cube", "table")} if z < 0.021 else set()
        history.add(
            Sample(
                time=time,
                truth=truth,
                beliefs=truth,
                perceived={"cube": True},
                grasped={"cube": by[-1]} if by and by[-1] else {},
                edges=frozenset(edges),
            )
        )
    return history


LIFTED = {0.0: 0.02, 3.0: 0.02, 4.0: 0.22, 6.0: 0.22, 7.0: 0.02}


def test_what_is_lifted_and_put_down_was_picked_and_placed_by_who_held_it():
    pick, place = true_actions(history_of(LIFTED, {2.5: HAND, 8.0: None}))
    assert (pick.kind, pick.by, place.kind, place.by) == (PICK, HAND, PLACE, HAND)
    assert pick.time == pytest.approx(3.05) and place.time == pytest.approx(7.0)


def test_what_is_let_go_in_the_air_was_released():
    falls = {0.0: 0.02, 3.0: 0.02, 4.0: 0.22, 5.0: 0.22, 5.2: 0.02}
    assert [action.kind for action in true_actions(history_of(falls, {2.5: "gripper", 5.0: None}))] == [PICK, RELEASE]


def test_what_is_only_touched_or_still_held_has_not_been_put_down():
    assert true_actions(history_of({0.0: 0.02}, {2.0: HAND, 8.0: None})) == []
    held = true_actions(history_of({0.0: 0.02, 3.0: 0.02, 4.0: 0.2}, {2.0: HAND}))
    assert [action.kind for action in held] == [PICK]


def test_inferred_actions_are_paired_with_true_ones_of_the_same_kind_and_thing():
    history = history_of(LIFTED, {2.5: HAND, 8.0: None})
    history.actions = [
        Inferred(Action(3.1, PICK, "cube", HAND), 3.3),
        Inferred(Action(7.2, RELEASE, "cube", HAND), 7.4),
        Inferred(Action(3.0, PICK, "ball"), 3.5),
    ]
    comparison = compare(history)
    assert [match.inferred is not None for match in comparison.matches] == [True, False]
    assert {str(one.action) for one in comparison.extra} == {"Release(cube, human_hand_0)", "Pick(ball)"}
    metrics = accuracy(history, history.samples)
    assert metrics["action_precision"] == pytest.approx(1 / 3) and metrics["action_recall"] == 0.5
    assert metrics["pick_delay_max_s"] == pytest.approx(0.25) and metrics["pick_time_error_max_s"] == pytest.approx(
        0.05
    )
    assert metrics["action_by_right"] == 1.0
    notes = measure(history)[1]
    assert any(note.startswith("not inferred: Place(cube") for note in notes)
    assert any(note.startswith("inferred, but not done: ") and "Pick(ball)" in note for note in notes)


def test_what_is_inferred_around_a_teleport_does_not_count():
    extra = "[[event]]\nat = 3.0\ndo = 'place'\nobject = 'cube'\nposition = [0.3, 0.0, 0.02]\n"
    history = history_of({0.0: 0.02}, {}, extra)
    history.spans = {1: (3.0, 3.0)}
    history.actions = [Inferred(Action(3.1, PICK, "cube"), 3.3), Inferred(Action(8.0, PICK, "cube"), 8.3)]
    assert [one.action.time for one in compare(history).extra] == [8.0]


def test_the_delay_of_a_relation_counts_from_when_it_became_true():
    history = history_of(LIFTED, {2.5: HAND, 8.0: None})
    late = []
    for sample in history.samples:
        edges = {("on", "cube", "table")} if sample.time < 3.0 or sample.time >= 8.5 else set()
        edges |= {("grasping", HAND, "cube")} if 3.0 <= sample.time < 8.0 else set()
        late.append(_with_edges(sample, edges))
    history.samples = late
    metrics = accuracy(history, history.samples)
    assert metrics["on_precision"] == 1.0 and metrics["on_recall"] < 1.0
    assert metrics["on_delay_max_s"] == pytest.approx(0.5)
    assert metrics["grasping_delay_max_s"] == pytest.approx(0.5)
    assert metrics["grasping_precision"] == 1.0 and metrics["grasping_recall"] == pytest.approx(0.91, abs=0.02)


def _with_edges(sample: Sample, edges: set[tuple[str, str, str]]) -> Sample:
    return Sample(
        time=sample.time, truth=sample.truth, beliefs=sample.beliefs, grasped=sample.grasped, edges=frozenset(edges)
    )


def test_a_ball_in_a_container_rests_on_its_bottom_and_is_in_it():
    scenario = parse_scenario(FILE)
    size = scenario.object("green").size
    green, inside = Pose((0.6, 0.0, size[2] / 2)), Pose((0.6, 0.02, 0.0335))
    assert true_contents(scenario, {"green": green, "ball": inside}) == {("ball", "green")}
    assert ("ball", "table") not in true_relations(scenario, {"green": green, "ball": inside})
    assert ("green", "table") in true_relations(scenario, {"green": green, "ball": inside})
    tilted = Pose.from_rotvec((0.6, 0.0, 0.3), (math.pi, 0.0, 0.0))
    assert true_contents(scenario, {"green": tilted, "ball": inside}) == set()


def test_errors_of_unseen_objects_are_told_apart():
    history = history_of({0.0: 0.02}, {})
    samples = []
    for sample in history.samples:
        error = 0.1 if 5.0 <= sample.time < 6.0 else 0.0
        samples.append(
            Sample(
                time=sample.time,
                truth=sample.truth,
                beliefs={"cube": Pose((0.3, error, 0.02))},
                perceived={"cube": sample.time < 4.0},
            )
        )
    history.samples = samples
    metrics = accuracy(history, history.samples)
    assert metrics["unseen_error_cube_max_m"] == pytest.approx(0.1) == metrics["unseen_error_max_m"]
    assert metrics["unseen_error_cube_median_m"] == 0.0 and metrics["unseen_believed_cube"] == 1.0
    curve = dict(unseen_curves(history, history.samples)["unseen_error_cube_m"])
    assert sorted(curve) == [4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0]
    assert curve[5.0] == pytest.approx(0.1) and curve[4.0] == curve[6.0] == 0.0


def test_both_hands_hold_what_goes_from_one_to_the_other() -> None:
    other = "human_hand_1"
    sample = Sample(time=1.0, truth={}, grasped={"cube": other}, pinched={HAND: "cube", other: "cube"})
    assert true_holders(sample) == ({(HAND, "cube"), (other, "cube")}, frozenset())
