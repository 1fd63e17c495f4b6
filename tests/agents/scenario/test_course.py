"""Recovery, relations, surprise and mission are judged rightly, on made-up runs."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from agents.scenario.format.scenario import Scenario, parse_scenario
from agents.scenario.judge.metrics import measure
from agents.scenario.judge.perturbations import perturbations, recovery, wrong_explanations
from agents.scenario.judge.verdicts import judge_check
from agents.scenario.truth.history import Explained, History, MissionState, Sample
from agents.scenario.truth.relations import true_relations
from dsr.math3d.transforms import Pose

FILE = """
name = "tower"
title = "a on b, which is moved"
duration = 10.0
settle = 1.0

[mission]
goal = "on(a, b)"

[[object]]
name = "a"
position = [0.3, 0.0, 0.06]

[[object]]
name = "b"
position = [0.3, 0.0, 0.02]

[[event]]
at = 4.0
do = "slide"
object = "b"
by = [0.1, 0.0]

[[expect]]
"""
BEFORE = {"a": Pose((0.3, 0.0, 0.06)), "b": Pose((0.3, 0.0, 0.02))}
AFTER = {"a": Pose((0.4, 0.0, 0.06)), "b": Pose((0.4, 0.0, 0.02))}
FALLEN = {"a": Pose((0.4, 0.0, 0.02)), "b": BEFORE["b"]}
EDGES = frozenset({("on", "a", "b"), ("on", "b", "table")})
Fields = Callable[[float], dict[str, Any]]


def course(expectation: str = "check = 'surprising'", fields: Fields = lambda time: {}) -> History:
    """A run of 10 s in which the tower moves from 4 to 5 s and the belief, wrong from then on, is right from 6 s on."""
    history = History(parse_scenario(FILE + expectation))
    for step in range(201):
        time = step / 20
        true = BEFORE if time < 4.5 else AFTER
        moving = frozenset({"a", "b"} if 4.0 < time < 5.0 else ())
        belief = BEFORE if time < 4.5 else FALLEN if time < 6.0 else AFTER
        values = {"truth": true, "beliefs": belief, "edges": EDGES, "moving": moving}
        history.add(Sample(time=time, **{**values, **fields(time)}))
    history.spans = {1: (4.0, 4.9)}
    return history


def verdict(expectation: str, fields: Fields = lambda time: {}, change: Callable[[History], None] | None = None):
    history = course(expectation, fields)
    if change is not None:
        change(history)
    found = judge_check(history.scenario.expectations[0], history)
    return found.passed, found.actual


def test_true_relations_follow_from_poses():
    scenario = course().scenario
    leaning = {"a": Pose.from_rotvec((0.3, 0.045, 0.04), (0.4, 0.0, 0.0)), "b": BEFORE["b"]}
    beside = {"a": Pose((0.34, 0.0, 0.02)), "b": BEFORE["b"]}
    assert true_relations(scenario, BEFORE) == {("a", "b"), ("b", "table")}
    assert true_relations(scenario, BEFORE, held={"a"}) == {("b", "table")}
    assert true_relations(scenario, beside) == {("a", "table"), ("b", "table")}
    assert true_relations(scenario, {"a": Pose((0.3, 0.0, 0.065)), "b": BEFORE["b"]}) == {("b", "table")}
    assert true_relations(scenario, {"a": Pose((0.3, 0.0, -0.70))}) == set()
    assert ("b", "table") in true_relations(scenario, leaning)


def test_recovery_counts_from_when_all_lies_still():
    history = course()
    (one,) = perturbations(history)
    assert (one.begin, one.end, one.until) == pytest.approx((4.0, 5.0, 10.0))
    found = recovery(history, one, 0.005)
    assert found.seconds == pytest.approx(1.0) and found.last in BEFORE
    assert recovery(history, one, 0.2).seconds == 0.0


def test_recovery_counts_from_when_what_was_moved_can_be_seen():
    history = course(fields=lambda time: {"in_view": frozenset("a" if time < 4.0 or time >= 5.7 else "")})
    (one,) = perturbations(history)
    assert one.end == pytest.approx(5.7)
    assert recovery(history, one, 0.005).seconds == pytest.approx(0.3)


def test_what_the_gripper_is_taking_meanwhile_is_not_what_was_moved():
    def fields(time: float) -> dict[str, Any]:
        return {
            "truth": BEFORE if time < 4.5 else {**BEFORE, "b": AFTER["b"]},
            "moving": frozenset({"a"} if 4.9 < time < 5.2 else ()),
            "held": "a" if time > 5.1 else None,
            "in_view": frozenset({"b"} if time < 7.0 else {"a", "b"}),
        }

    (one,) = perturbations(course(fields=fields))
    assert one.end == pytest.approx(4.95)


def test_a_passing_tremble_does_not_end_what_is_looked_at():
    history = course(fields=lambda time: {"moving": frozenset("a")} if time == 5.5 else {})
    assert recovery(history, perturbations(history)[0], 0.005).seconds == pytest.approx(1.0)


def test_events_that_overlap_are_one_perturbation_and_one_under_way_never_ends():
    history = course()
    history.spans = {2: (4.5, 6.0), 1: (4.0, 4.9), 3: (8.0, None)}
    first, second = perturbations(history)
    assert first.events == (1, 2) and first.until == 8.0
    assert second.end == math.inf and recovery(history, second, 0.005).seconds == math.inf


def test_an_object_that_moves_again_or_is_taken_is_not_judged_any_more():
    def moved_later(time: float) -> dict[str, Any]:
        return {"truth": {**AFTER, "a": Pose((0.5, 0.0, 0.02))}} if time >= 8.0 else {}

    def taken(time: float) -> dict[str, Any]:
        return {"held": "a", "beliefs": AFTER | {"a": Pose((0.0, 0.0, 1.0))}} if time >= 8.0 else {}

    for fields in (moved_later, taken):
        history = course(fields=fields)
        assert recovery(history, perturbations(history)[0], 0.005).seconds == pytest.approx(1.0)


def test_a_belief_that_is_lost_again_or_never_found_has_not_recovered():
    def lost(time: float) -> dict[str, Any]:
        return {"beliefs": {"a": AFTER["a"]}} if time >= 9.0 else {}

    history = course(fields=lost)
    found = recovery(history, perturbations(history)[0], 0.005)
    assert found.seconds == math.inf and found.last == "b" and found.error == math.inf
    metrics, notes = measure(history)
    assert "recovery_time_max_s" not in metrics
    assert "no recovery time of perturbation 1 (event 1): b was never believed within 5 mm of the truth" in notes


def test_why_a_perturbation_has_no_recovery_time_where_nothing_lay_still():
    history = course()
    for spans in ({1: (4.0, None)}, {1: (4.0, 4.9), 2: (5.0, 5.5)}):
        history.spans = spans
        _, notes = measure(history)
        why = "things did not lie still before the next one or the end"
        assert len([note for note in notes if note.endswith(why)]) == 1
        assert any(note.startswith("no recovery time of perturbation 1 (event 1)") for note in notes)


def test_what_was_removed_must_not_be_believed():
    def removed(time: float) -> dict[str, Any]:
        return {"truth": {"b": AFTER["b"]}} if time >= 4.9 else {}

    history = course(fields=removed)
    assert recovery(history, perturbations(history)[0], 0.005).last == "a"


def test_belief_recovered_needs_all_events_and_tells_who_took_longest():
    passed, actual = verdict("check = 'belief_recovered'")
    assert passed and actual.startswith("event 1: 1.00 s (") and "off until then" in actual
    assert not verdict("check = 'belief_recovered'\nwithin = 0.9")[0]

    def never(history: History) -> None:
        history.spans = {}

    assert verdict("check = 'belief_recovered'", change=never) == (False, "event 1 (slide) has not begun")


def test_times_count_from_the_end_of_an_event():
    assert not verdict("check = 'belief_error'\nevent = 1\nat = 0.9")[0]
    assert verdict("check = 'belief_error'\nevent = 1\nat = 1.1")[0]
    assert verdict("check = 'belief_error'\nevent = 1\nafter = 1.1\nat = 4.0")[0]
    assert not verdict("check = 'belief_error'\nevent = 1\nafter = 0.9\nat = 4.0")[0]
    assert (
        verdict("check = 'belief_error'\nevent = 1\nat = 6.0")[1]
        == "the run ended before 11.0 s, when it was to be judged"
    )

    def begun(history: History) -> None:
        history.spans = {1: (4.0, None)}

    assert verdict("check = 'belief_error'\nevent = 1\nat = 1.0", change=begun)[1] == "event 1 has not ended"


def test_edges_may_have_to_hold_always():
    def gone_for_a_moment(time: float) -> dict[str, Any]:
        return {"edges": frozenset()} if time == 7.0 else {}

    always = "check = 'edges'\npresent = [['a', 'b']]"
    assert verdict(always, gone_for_a_moment)[0]
    assert verdict(f"{always}\nafter = 7.1", gone_for_a_moment)[0]
    assert verdict(f"{always}\nafter = 6.0", gone_for_a_moment) == (False, "none at 7.00 s")


def test_relations_are_compared_with_the_true_ones():
    assert verdict("check = 'relations_right'")[0]
    wrong = lambda time: {"edges": frozenset({("on", "a", "table"), ("on", "b", "table")})}  # noqa: E731
    passed, actual = verdict("check = 'relations_right'", wrong)
    assert not passed and actual.startswith("a: on table, truly b")
    assert verdict("check = 'true_relations'\npresent = [['a', 'b']]\nabsent = [['a', 'table']]", wrong)[0]
    assert not verdict("check = 'true_relations'\nabsent = [['a', 'b']]")[0]


def test_gone_means_absent_without_pose_and_relations():
    gone: Fields = lambda time: {"absent": frozenset("a"), "beliefs": {"b": AFTER["b"]}, "edges": frozenset()}  # noqa: E731
    assert verdict("check = 'gone'\nobjects = ['a']", gone) == (True, "a: gone")
    passed, actual = verdict("check = 'gone'\nobjects = ['a']")
    assert not passed and actual == "a: still present, has a belief, rests on something"


def test_surprises_are_counted_when_they_rise():
    def twice(time: float) -> dict[str, Any]:
        return {"surprising": frozenset("a" if 5.0 <= time < 6.0 or time >= 9.0 else "")}

    assert verdict("check = 'surprises'\nleast = 2\nmost = 2", twice) == (True, "2: a at 5.00 s, a at 9.00 s")
    assert verdict("check = 'surprises'\nmost = 0\nobjects = ['b']", twice)[0]
    assert verdict("check = 'surprises'\nmost = 1\nafter = 6.0", twice)[0]
    assert not verdict("check = 'surprising'", twice)[0]
    assert verdict("check = 'surprising'\nat = 8.0", twice)[0]
    assert verdict("check = 'surprising'\nobjects = ['a']\nvalue = true", twice)[0]
    assert measure(course(fields=twice))[0]["surprises_raised"] == 2


def test_the_last_status_and_all_replans_of_the_mission_count():
    def reach(history: History) -> None:
        history.missions = [
            MissionState(0.5, "intention_1", "executing", "", 0),
            MissionState(6.0, "intention_1", "executing", "", 2),
            MissionState(8.0, "intention_1", "reached", "", 2),
        ]

    assert verdict("check = 'mission'", change=reach) == (True, "reached since 8.0 s")
    assert verdict("check = 'mission'\nat = 7.0", change=reach) == (False, "executing since 6.0 s")
    assert verdict("check = 'mission'") == (False, "there was no intention")
    assert verdict("check = 'replans'\nleast = 1\nmost = 2", change=reach) == (True, "2")
    assert not verdict("check = 'replans'\nmost = 1", change=reach)[0]
    history = course()
    reach(history)
    metrics = measure(history)[0]
    assert (metrics["replans"], metrics["mission_first_reached_s"], metrics["mission_reached_s"]) == (2, 8.0, 8.0)


def test_explanations_are_wrong_if_what_they_lead_to_is():
    history = course()
    history.explanations = [
        Explained(5.2, "event_1", "moved_alone(a)"),
        Explained(6.0, "event_2", "moved_with_supports(a; b)"),
    ]
    assert [wrong.node for wrong in wrong_explanations(history)] == ["event_1"]
    metrics = measure(history)[0]
    assert metrics["explanations"] == 2 and metrics["wrong_beliefs"] == 1
    assert metrics["recovery_time_1_s"] == metrics["recovery_time_max_s"] == pytest.approx(1.0)
    assert metrics["recovery_in_view_max_s"] == pytest.approx(1.0)


def test_what_is_wrong_in_the_belief_only_also_counts_from_when_the_camera_can_see_what_stands_on_it():
    def fields(time: float) -> dict[str, Any]:
        belief = BEFORE if time < 4.5 or time >= 6.0 else {"a": BEFORE["a"], "b": AFTER["b"]}
        seen = frozenset("a" if time < 4.0 or time >= 5.7 else "")
        return {"truth": BEFORE, "beliefs": belief, "moving": frozenset(), "in_view": seen}

    metrics = measure(course(fields=fields))[0]
    assert metrics["recovery_time_max_s"] > 1.0
    assert metrics["recovery_in_view_max_s"] == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("expectation", "message"),
    [
        ("check = 'belief_error'\nevent = 2\nat = 1", "event: there is no event 2; expected a number from 1 to 1"),
        ("check = 'belief_error'\nevent = 1", "expected `at` (s) with `event`"),
        ("check = 'surprises'\nleast = 3\nmost = 2", "most: at least 3 and at most 2 is impossible"),
        ("check = 'true_relations'", "true_relations: expected `present` or `absent`"),
        (
            "check = 'true_relations'\npresent = [['a', 'tabel']]",
            "present: unknown object 'tabel'; did you mean 'table'?",
        ),
        ("check = 'edges'\npresent = [['a', 'b']]\nafter = 11", "after: the window begins at 11.0 s"),
    ],
)
def test_wrong_expectations_are_refused(expectation: str, message: str):
    with pytest.raises(Exception, match=r"expect\.1") as caught:
        parse_scenario(FILE + expectation)
    assert message in str(caught.value)


@pytest.mark.parametrize("check", ["mission", "replans"])
def test_a_mission_is_expected_only_where_there_is_one(check: str):
    text = FILE.replace("[mission]\ngoal", "#")
    with pytest.raises(Exception, match=r"there is no \[mission\] in this file"):
        parse_scenario(f"{text}check = '{check}'")


def test_a_scenario_may_say_what_the_robot_wants():
    scenario: Scenario = course().scenario
    assert scenario.mission is not None and scenario.mission.goal == "on(a, b)" and not scenario.mission.maintain
    with pytest.raises(Exception, match=r"mission\.gaol: unknown field; did you mean 'goal'\?"):
        parse_scenario(FILE.replace("goal =", "gaol ="))
