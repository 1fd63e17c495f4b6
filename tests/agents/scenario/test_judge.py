"""The judge tells right from wrong beliefs, on made-up runs."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from agents.scenario.format.scenario import Scenario, parse_scenario
from agents.scenario.judge.judge import Judge
from agents.scenario.judge.metrics import measure
from agents.scenario.judge.result import Result, write_result
from agents.scenario.judge.verdicts import judge_check
from agents.scenario.truth.history import History, Sample
from dsr.clock import ManualClock
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.network.keys import Keys
from dsr.network.local_transport import LocalNetwork
from dsr.runtime.status import State, Status, encode_status

FILE = """
name = "pair"
title = "Two cubes"
duration = 10.0
settle = 2.0

[[object]]
name = "a"
position = [0.3, 0.0, 0.02]

[[object]]
name = "b"
position = [0.4, 0.0, 0.02]
"""
TRUE = {"a": Pose((0.3, 0.0, 0.02)), "b": Pose((0.4, 0.0, 0.02))}
HOVERING = {name: Pose((*pose.t[:2], 0.03)) for name, pose in TRUE.items()}
SEEN = {"a": True, "b": True}


def scenario_with(expectation: str = "", extra: str = "") -> Scenario:
    return parse_scenario(f"{FILE}\n{extra}\n[[expect]]\n{expectation}\n" if expectation else FILE)


def good_sample(time: float) -> Sample:
    return Sample(time=time, truth=TRUE, percepts=HOVERING, beliefs=TRUE, perceived=SEEN)


def run(scenario: Scenario, sample: Callable[[float], Sample] = good_sample, rate: float = 10.0) -> History:
    history = History(scenario)
    for step in range(int(scenario.duration * rate) + 1):
        history.add(sample(step / rate))
    return history


def verdict(expectation: str, sample: Callable[[float], Sample] = good_sample, extra: str = "") -> tuple[bool, str]:
    scenario = scenario_with(expectation, extra)
    found = judge_check(scenario.expectations[0], run(scenario, sample))
    return found.passed, found.actual


def believing(beliefs: dict[str, Pose]) -> Callable[[float], Sample]:
    return lambda time: msgspec.structs.replace(good_sample(time), beliefs=beliefs)


@pytest.mark.parametrize(
    "check",
    ["belief_closer_than_percept", "no_interpenetration", "resting", "resting_height", "no_drift", "belief_error"],
)
def test_a_perfect_belief_passes_and_a_missing_one_fails(check: str):
    assert verdict(f"check = '{check}'")[0]
    passed, actual = verdict(f"check = '{check}'", believing({"a": TRUE["a"]}))
    assert not passed and "no belief" in actual


@pytest.mark.parametrize(
    ("check", "pose"),
    [
        ("belief_closer_than_percept", Pose((0.4, 0.011, 0.02))),
        ("no_interpenetration", Pose((0.3395, 0.0, 0.0205))),
        ("no_interpenetration", Pose((0.4, 0.0, 0.0194))),
        ("resting", Pose((0.4, 0.0, 0.0215))),
        ("resting", Pose((0.4, 0.0, 0.0185))),
        ("resting_height", Pose((0.4, 0.0, 0.0212))),
        ("belief_error", Pose((0.4, 0.006, 0.02))),
        ("belief_error'\nangle = 0.1\n#'", Pose.from_rotvec((0.4, 0.0, 0.02), (0.0, 0.0, 0.11))),
    ],
)
def test_a_wrong_belief_fails(check: str, pose: Pose):
    wrong = believing({"a": TRUE["a"], "b": pose})
    if check == "no_interpenetration" and pose.t[0] < 0.35:
        wrong = believing({"a": TRUE["a"], "b": Pose((0.3394, 0.0, 0.02))})
    assert not verdict(f"check = '{check}'", wrong)[0]


def test_a_belief_on_top_of_another_rests_although_it_is_at_the_wrong_place():
    tower = believing({"a": TRUE["a"], "b": Pose((0.31, 0.0, 0.06))})
    assert verdict("check = 'resting'", tower)[0]
    assert not verdict("check = 'resting_height'", tower)[0]


def test_a_moving_belief_does_not_rest_and_drifts():
    def sliding(time: float) -> Sample:
        return believing({"a": TRUE["a"], "b": Pose((0.4 + 0.0005 * time, 0.0, 0.02))})(time)

    passed, actual = verdict("check = 'no_drift'", sliding)
    assert not passed and actual == "b: 4.00 mm; a: 0.00 mm"
    assert verdict("check = 'no_drift'\nafter = 9.0", sliding)[0]
    assert verdict("check = 'resting'", sliding)[0]
    assert not verdict("check = 'resting'\ntolerance = 0.0004", sliding)[0]


def test_what_happens_before_the_belief_settled_is_not_judged():
    def late(time: float) -> Sample:
        return good_sample(time) if time >= 2 else believing({"a": TRUE["a"], "b": TRUE["a"]})(time)

    assert verdict("check = 'no_interpenetration'", late)[0]
    assert not verdict("check = 'no_interpenetration'\nafter = 1.0", late)[0]


@pytest.mark.parametrize("check", ["no_interpenetration", "no_drift", "belief_error", "belief_closer_than_percept"])
def test_without_any_object_nothing_holds(check: str):
    def empty(time: float) -> Sample:
        return Sample(time=time, truth={})

    assert verdict(f"check = '{check}'", empty) == (False, "there was no object to judge")


def test_a_check_is_judged_at_its_time():
    def lifted(time: float) -> Sample:
        return believing({"a": TRUE["a"], "b": HOVERING["b"]} if 4 <= time < 6 else TRUE)(time)

    assert verdict("check = 'resting_height'\nat = 3.9", lifted)[0]
    assert not verdict("check = 'resting_height'\nat = 5.0", lifted)[0]
    assert verdict("check = 'resting_height'", lifted)[0]
    assert verdict("check = 'resting_height'\nat = 5.0\nobjects = ['a']", lifted)[0]


def test_only_percepts_that_are_perceived_count():
    def covered(time: float) -> Sample:
        far = {name: Pose((9.0, 9.0, 9.0)) for name in TRUE}
        seen = good_sample(time)
        return msgspec.structs.replace(seen, percepts=far, perceived=dict.fromkeys(TRUE, False)) if time > 5 else seen

    metrics, notes = measure(run(scenario_with(), covered))
    assert metrics["percept_error_a_m"] == pytest.approx(0.01)
    assert notes == []


def test_an_object_never_seen_fails_the_comparison_and_has_no_percept_metrics():
    def hidden(time: float) -> Sample:
        percepts = {"a": HOVERING["a"]}
        return msgspec.structs.replace(good_sample(time), percepts=percepts, perceived={"a": True, "b": False})

    assert verdict("check = 'belief_closer_than_percept'", hidden) == (
        False,
        "b: never seen; a: belief 0.00 mm, percept 10.00 mm",
    )
    assert verdict("check = 'belief_closer_than_percept'\nobjects = ['a']", hidden)[0]
    metrics, notes = measure(run(scenario_with(), hidden))
    assert "percept_error_b_m" not in metrics
    assert metrics["belief_error_b_m"] == 0.0
    assert notes == ["b was never seen: it has no percept metrics"]


def test_metrics_of_a_known_run():
    shifted = {"a": TRUE["a"], "b": Pose.from_rotvec((0.4, 0.003, 0.0204), (0.0, 0.0, 0.2))}
    metrics, _ = measure(run(scenario_with(), believing(shifted)))
    assert metrics["belief_error_b_m"] == pytest.approx(math.hypot(0.003, 0.0004))
    assert metrics["belief_error_b_rad"] == pytest.approx(0.2)
    assert metrics["belief_gap_b_m"] == pytest.approx(0.0004)
    assert metrics["belief_height_error_b_m"] == pytest.approx(0.0004)
    assert metrics["belief_drift_b_m"] == 0.0
    assert metrics["percept_overlap_max_m"] == metrics["belief_overlap_max_m"] == 0.0
    assert metrics["objects_perceived"] == 2
    assert metrics["samples"] == 81


def test_a_belief_outside_the_table_has_no_gap_metric_instead_of_an_infinite_one():
    metrics, _ = measure(run(scenario_with(), believing({"a": TRUE["a"], "b": Pose((5.0, 0.0, 0.02))})))
    assert "belief_gap_b_m" not in metrics and "belief_gap_a_m" in metrics


def test_edges_attributes_and_perceived():
    def linked(time: float) -> Sample:
        return msgspec.structs.replace(
            good_sample(time),
            edges=frozenset({("on", "a", "table"), ("on", "b", "table")}),
            attributes={("a", "surprising"): False, ("a", "mass"): 0.05},
            perceived={"a": True, "b": False},
        )

    assert verdict("check = 'edges'\npresent = [['a', 'table']]\nabsent = [['a', 'b']]", linked)[0]
    assert not verdict("check = 'edges'\npresent = [['a', 'b']]", linked)[0]
    assert verdict("check = 'edges'\nabsent = [['b', 'table']]", linked) == (False, "a -> table, b -> table")
    assert verdict("check = 'edges'\ntype = 'in'\nabsent = [['a', 'table']]", linked) == (True, "none")
    assert verdict("check = 'attribute'\nnode = 'a'\nname = 'surprising'\nvalue = false", linked)[0]
    assert verdict("check = 'attribute'\nnode = 'a'\nname = 'mass'\nvalue = 0.06\ntolerance = 0.02", linked)[0]
    assert not verdict("check = 'attribute'\nnode = 'a'\nname = 'mass'\nvalue = 0.06", linked)[0]
    assert verdict("check = 'attribute'\nnode = 'b'\nname = 'mass'\nvalue = 0.05", linked) == (False, "not set")
    assert verdict("check = 'perceived'\nobjects = ['a']", linked)[0]
    assert verdict("check = 'perceived'", linked) == (False, "b: false; a: true")
    assert verdict("check = 'perceived'\nvalue = false\nobjects = ['b']", linked)[0]


def test_a_killed_agent_must_come_back_in_time():
    kill = "[[event]]\nat = 3.0\ndo = 'kill'\nagent = 'plant'"
    scenario = scenario_with("check = 'recovered'\nagent = 'plant'\nwithin = 2.0", kill)
    history = run(scenario)
    check = scenario.expectations[0]
    assert judge_check(check, history).actual == "event 1 (kill) has not begun"
    history.kills = {1: 3.0}
    assert not judge_check(check, history).passed
    history.agent_starts = [(0.1, "plant"), (4.0, "recorder"), (5.1, "plant")]
    assert judge_check(check, history).actual == "ready after 2.1 s"
    assert not judge_check(check, history).passed
    assert measure(history)[0]["restart_max_s"] == pytest.approx(2.1)
    history.agent_starts.append((4.9, "plant"))
    assert judge_check(check, history).passed


def lagging(time: float) -> Sample:
    """Both move from 4 to 6 s, and the beliefs follow 0.3 s later; somebody holds one of them until 7 s."""
    going, seen = (min(max(now - 4.0, 0.0), 2.0) * 0.1 for now in (time, time - 0.3))
    truth = {name: Pose((x, y + going, z)) for name, (x, y, z) in ((name, pose.t) for name, pose in TRUE.items())}
    beliefs = {name: Pose((x, y + seen, z)) for name, (x, y, z) in ((name, pose.t) for name, pose in TRUE.items())}
    moving = frozenset(TRUE) if 4.0 <= time < 6.0 else frozenset()
    held = {"b": "unknown"} if 4.0 <= time < 7.0 else {}
    return Sample(time=time, truth=truth, beliefs=beliefs, moving=moving, grasped=held)


def test_a_lag_may_be_left_out_of_the_window_by_rest_and_by_share():
    check = "check = 'belief_error'\nafter = 2.0\n"
    assert not verdict(check, lagging)[0]
    assert not verdict(check + "objects = ['a']\nat_rest = true", lagging)[0], "it comes to rest before its belief"
    assert verdict(check + "objects = ['b']\nat_rest = true", lagging)[0], "while it is held it is not at rest"
    assert verdict(check + "objects = ['a']\nat_rest = true\nshare = 0.95", lagging)[0]
    passed, found = verdict(check + "share = 0.9", lagging)
    assert not passed and "a: right 72.8% of the time, at most 30.00 mm" in found
    assert verdict(check + "share = 0.7", lagging)[0]


def test_what_never_rests_or_is_not_believed_does_not_count_as_right():
    def moving(time: float) -> Sample:
        return msgspec.structs.replace(good_sample(time), moving=frozenset({"a"}))

    check = "check = 'belief_error'\nafter = 2.0\n"
    assert verdict(check + "at_rest = true", moving) == (False, "a: never at rest then; b: 0.00 mm")

    def forgotten(time: float) -> Sample:
        return msgspec.structs.replace(good_sample(time), beliefs=TRUE if time < 6.0 else {})

    assert verdict(check, forgotten) == (False, "a: no belief; b: no belief")
    assert not verdict(check + "share = 0.6", forgotten)[0]
    assert verdict(check + "share = 0.4", forgotten)[0]


def test_only_a_share_that_is_asked_for_is_in_the_description():
    texts = [
        judge_check(
            scenario_with(f"check = 'belief_error'\nafter = 2\n{more}").expectations[0], run(scenario_with())
        ).text
        for more in ("", "at_rest = true\nshare = 0.9")
    ]
    assert texts[0] == "belief_error (tolerance 5.00 mm, after 2 s)"
    assert texts[1] == "belief_error (tolerance 5.00 mm, after 2 s, at_rest true, share 90%)"


def test_without_truth_nothing_passes():
    scenario = scenario_with("check = 'no_interpenetration'")
    assert not judge_check(scenario.expectations[0], History(scenario)).passed
    assert measure(History(scenario))[0] == {}


def test_the_description_says_what_was_asked():
    scenario = scenario_with("check = 'edges'\npresent = [['a', 'b']]\nat = 3")
    assert judge_check(scenario.expectations[0], History(scenario)).text == "edges (at 3 s, type on, present a -> b)"


def test_a_result_refuses_numbers_that_json_does_not_know(tmp_path: Path):
    def make(value: float) -> Result:
        return Result(
            scenario="x",
            seed=0,
            mode="lockstep",
            sensor="poses",
            passed=True,
            expectations=[],
            metrics={"a_m": value},
            notes=[],
        )

    with pytest.raises(ValueError, match="not finite: a_m"):
        make(math.nan)
    write_result(make(0.5), tmp_path / "deep" / "result.json")
    written = json.loads((tmp_path / "deep" / "result.json").read_text())
    assert written["metrics"] == {"a_m": 0.5}
    assert list(written)[:7] == ["scenario", "seed", "mode", "sensor", "policy", "hands", "passed"]


class Rig:
    """A judge on a network with one writer."""

    def __init__(self, scenario: Scenario) -> None:
        self.clock = ManualClock(1000.0)
        self.network = LocalNetwork(self.clock)
        self.keys = Keys("test")
        self.bus = self.network.connect("plant")
        self.writer = Memory("test", "writer", transport=self.bus, clock=self.clock, rid="writer-1")
        link = self.network.connect("judge")
        reader = Memory("test", "judge", transport=link, clock=self.clock, rid="judge-1")
        self.reader = reader
        self.judge = Judge(scenario, reader, link, self.keys)

    def step(self, truth: bytes | None = None, seconds: float = 0.05, *, silent: bool = False) -> None:
        self.clock.advance(seconds)
        if truth is None:
            objects = {name: (*pose.t, *pose.q) for name, pose in TRUE.items()}
            truth = msgspec.msgpack.encode({"stamp": self.clock.now(), "objects": objects, "robot": [0.0]})
        if not silent:
            self.bus.publish(self.keys.truth(), truth)
        for _ in range(4):
            self.writer.poll()
            self.writer.flush()
            self.network.deliver()
            self.reader.poll()
            self.reader.flush()
        self.judge.sample()


@pytest.fixture
def rig() -> Rig:
    return Rig(scenario_with("check = 'attribute'\nnode = 'table'\nname = 'mass'\nvalue = 3.0"))


def fill(memory: Memory) -> None:
    memory.add_node("world", "world")
    memory.add_node("table", "table", mass=3.0)
    memory.add_node("camera_overhead", "camera")
    memory.add_node("a", "cube", perceived=True)
    memory.add_node("b", "cube")
    down = Pose((0.3, 0.0, 0.7), (1.0, 0.0, 0.0, 0.0))
    memory.add_edge("world", "camera_overhead", "RT", pose=down)
    memory.add_edge("camera_overhead", "a", "RT", pose=Pose((0.0, 0.0, 0.67)))
    memory.add_edge("world", "a", "Virtual_RT", pose=TRUE["a"])
    memory.add_edge("a", "table", "on")


def test_the_judge_reads_percepts_beliefs_and_attributes_from_the_memory(rig: Rig):
    fill(rig.writer)
    rig.judge.begin(1000.0)
    for _ in range(20):
        rig.step()
    last = rig.judge.history.samples[-1]
    assert last.time == pytest.approx(1.0)
    assert last.truth["a"].distance(TRUE["a"]) == (0.0, 0.0)
    assert last.percepts["a"].t == pytest.approx((0.3, 0.0, 0.03))
    assert last.beliefs == {"a": TRUE["a"]}
    assert last.perceived == {"a": True, "b": False}
    assert last.attributes == {("table", "mass"): 3.0}


def test_nothing_before_the_start_counts(rig: Rig):
    rig.step()
    rig.judge.begin(rig.clock.now() + 0.07)
    for _ in range(4):
        rig.step()
    assert [sample.time for sample in rig.judge.history.samples] == pytest.approx([0.03, 0.08, 0.13])


def test_malformed_messages_are_counted_and_dropped(rig: Rig):
    rig.judge.begin(1000.0)
    for truth in (b"", b"\xc1", msgspec.msgpack.encode({"stamp": 1, "objects": {"a": [0] * 7}}), b"\x93abc"):
        rig.step(truth)
    rig.bus.publish(rig.keys.status("x"), b"junk")
    rig.step()
    assert rig.judge.dropped == 5
    assert len(rig.judge.history.samples) == 1


def test_agent_starts_are_noticed_once_per_start(rig: Rig):
    rig.judge.begin(1000.0)
    for rid, state in [("x-1", State.STARTING), ("x-1", State.READY), ("x-1", State.READY), ("x-2", State.READY)]:
        rig.bus.publish(
            rig.keys.status("x"),
            encode_status(Status(agent="x", rid=rid, pid=1, state=state, stamp=rig.clock.now() + 0.05)),
        )
        rig.step()
    assert rig.judge.history.agent_starts == [(pytest.approx(0.1), "x"), (pytest.approx(0.2), "x")]


def test_a_flag_that_rises_and_falls_between_two_truths_counts(rig: Rig):
    fill(rig.writer)
    rig.judge.begin(1000.0)
    rig.step()
    for flag in (True, False):
        rig.writer.update_node("a", surprising=flag)
        rig.step(silent=True)
    rig.step()
    rig.step()
    assert [sample.surprising for sample in rig.judge.history.samples] == [set(), {"a"}, set()]


MISSION = """
linger = 1.0

[mission]
goal = "on(a, b)"

[[event]]
at = 0.5
do = "remove"
object = "b"
"""


def test_a_run_may_end_when_all_is_over_and_the_judge_follows_the_mind():
    rig = Rig(parse_scenario(FILE.replace("settle = 2.0", MISSION.partition("\n\n")[0]) + MISSION.partition("\n\n")[2]))
    fill(rig.writer)
    rig.writer.add_node("intention_0", "intention", status="executing", goal="on(a,b)")
    rig.judge.begin(1000.0)
    objects = {name: (*pose.t, *pose.q) for name, pose in TRUE.items()}
    over = []
    for step in range(1, 61):
        now = step / 20
        moves = {1: (0.5, 0.5)} if now > 0.5 else {}
        values = {"objects": objects, "moves": moves, "held": "a", "moving": ["a"], "in_view": ["b"]}
        rig.step(msgspec.msgpack.encode({"stamp": 1000.0 + now, **values}))
        if now == 1.0:
            rig.writer.update_node("intention_0", status="reached", replans=2)
            rig.writer.update_node("a", surprising=True)
            rig.writer.update_node("b", present=False)
            rig.writer.add_node("event_0", "event", time=1000.9, explanation="removed(b)")
        if not over and rig.judge.is_over(now):
            over.append(now)
    history = rig.judge.history
    assert over == [pytest.approx(2.05, abs=0.06)] and history.end == over[0]
    assert [(state.status, state.replans) for state in history.missions] == [("executing", 0), ("reached", 2)]
    assert [explained.explanation for explained in history.explanations] == ["removed(b)"]
    last = history.samples[-1]
    assert (last.held, last.moving, last.in_view) == ("a", {"a"}, {"b"})
    assert (last.surprising, last.absent) == ({"a"}, {"b"})
