"""The chronicler writes what happens in the graph, with its true times, once."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from agents.chronicler import Chronicler
from dsr import ConfigError, Memory
from dsr.agent import Access, Agent
from dsr.graph.schema import MAX_LENGTH
from dsr.network.keys import agent_of
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec
from dsr.timeline import (
    EVENT,
    FORBIDDEN,
    INTENTION,
    PRESENT,
    SITUATION,
    SUMMARY,
    Entry,
    chronicle,
    kept_by,
    query,
    recall,
    stored_summaries,
    tell,
)
from dsr.timeline.retention import read_all
from dsr.vocabulary.halting import HaltOrder, write_order


class Worker(Agent):
    """Ticks."""

    name = "worker"
    writes = Access()

    def tick(self, now: float) -> None:
        pass


class Stage:
    def __init__(self, *writers: str, workers: tuple[str, ...] = (), **config: Any) -> None:
        specs = [AgentSpec(name, Chronicler, config) for name in writers or ("chronicler",)]
        specs += [AgentSpec(name, Worker, {}) for name in workers]
        self.lockstep = Lockstep(specs, strict=True)
        self.memory = self.lockstep.memory
        for name, kind in (("world", "world"), ("mind", "mind"), ("table", "table")):
            self.memory.add_node(name, kind)
        self.start = self.lockstep.clock.now()

    @property
    def now(self) -> float:
        return self.lockstep.clock.now()

    def run(self, seconds: float = 0.5) -> None:
        self.lockstep.run_for(seconds)

    def entries(self, *kinds: str, **wanted: Any) -> list[Entry]:
        return query(self.memory, kind=kinds, **wanted)

    def spans(self, *kinds: str) -> list[tuple[str, float, float | None]]:
        """Participants, begin and end (s since the start) of situations."""
        return [
            (",".join(entry.participants), entry.begin - self.start,
             None if entry.end is None else pytest.approx(entry.end - self.start, abs=1e-5))
            for entry in self.entries(*kinds, type=SITUATION)
        ]  # fmt: skip


@pytest.fixture
def stage() -> Iterator[Stage]:
    stage = Stage()
    with stage.lockstep:
        yield stage


def test_a_relation_is_a_situation_from_its_own_time_on(stage: Stage) -> None:
    stage.memory.add_node("a", "cube")
    stage.memory.add_edge("a", "table", "on", since=stage.start - 2.0, source="contact")
    stage.run(1.0)
    [entry] = stage.entries("on")
    assert (entry.participants, entry.begin, entry.is_open) == (("a", "table"), stage.start - 2.0, True)
    assert (entry.source, entry.text) == ("contact", "a on table (contact)")
    stage.memory.remove_edge("a", "table", "on")
    ended = stage.now
    stage.run(1.0)
    [entry] = stage.entries("on")
    assert entry.end is not None and 0.0 <= entry.end - ended <= 0.11


def test_a_relation_that_is_dated_anew_is_another_one(stage: Stage) -> None:
    stage.memory.add_node("a", "cube")
    stage.memory.add_edge("a", "table", "on", since=stage.start)
    stage.run()
    stage.memory.update_edge("a", "table", "on", since=stage.start + 0.4)
    stage.run()
    assert stage.spans("on") == [("a,table", 0.0, 0.4), ("a,table", pytest.approx(0.4), None)]


def test_a_grip_without_a_date_is_dated_by_its_values(stage: Stage) -> None:
    for name, kind in (("hand", "gripper"), ("a", "cube")):
        stage.memory.add_node(name, kind)
    stage.run()
    taken = stage.now - stage.start
    stage.memory.add_edge("hand", "a", "grasping", source="gripper")
    stage.run(2.0)
    assert stage.spans("grasping") == [("hand,a", pytest.approx(taken, abs=1e-5), None)]


def test_a_surprise_begins_and_ends_when_it_was_written(stage: Stage) -> None:
    stage.memory.add_node("a", "cube")
    stage.run()
    stage.memory.update_node("a", surprising=True, surprise="12 mm beside")
    begin = stage.now - stage.start
    stage.run()
    stage.memory.update_node("a", surprising=True, surprise="13 mm beside")
    stage.run()
    end = stage.now - stage.start
    stage.memory.update_node("a", surprising=False)
    stage.run(2.0)
    assert stage.spans("surprising") == [("a", pytest.approx(begin, abs=1e-5), end)]
    assert "12 mm" in stage.entries("surprising")[0].text


def test_things_appear_and_go(stage: Stage) -> None:
    stage.memory.add_node("a", "cube", marker_id=3)
    stage.memory.add_node("human_hand_0", "hand", perceived=True)
    stage.run(2.0)
    stage.memory.update_node("a", present=False)
    gone = stage.now - stage.start
    stage.run(1.0)
    stage.memory.update_node("a", present=True)
    back = stage.now - stage.start
    stage.run(1.0)
    stage.memory.remove_node("human_hand_0")
    stage.run(2.0)
    spans = stage.spans("present")
    assert spans[0] == ("a", 0.0, gone) and spans[2] == ("a", pytest.approx(back, abs=1e-5), None)
    assert spans[1][0] == "human_hand_0" and 4.0 <= stage.entries("present")[1].last - stage.start <= 5.1
    assert [event.kind for event in tell(stage.entries("present")) if event.subject == "a"] == [
        "appeared", "gone", "appeared",
    ]  # fmt: skip


def test_what_was_there_before_is_told_with_its_true_time() -> None:
    stage = Stage("first", "later")
    with stage.lockstep:
        stage.lockstep.kill("later")
        stage.lockstep.kill("first")
        stage.memory.add_node("a", "cube", marker_id=3)
        stage.run(5.0)
        stage.lockstep.restart("later")
        stage.run(2.0)
        assert stage.spans("present") == [("a", 0.0, None)]


def test_intentions_and_actions_tell_their_status_and_last(stage: Stage) -> None:
    memory = stage.memory
    memory.add_node("intention_0", "intention", goal="on(a,b)", status="wanted")
    memory.add_node("action_0_0", "action", skill="pick", target="a", status="planned")
    stage.run()
    memory.update_node("action_0_0", status="running")
    stage.run(1.0)
    memory.update_node("action_0_0", status="failed", explanation="slipped")
    memory.update_node("intention_0", status="reached")
    stage.run(0.5)
    memory.remove_node("action_0_0")
    stage.run(1.0)
    assert [event.text for event in stage.entries("action", type=EVENT)] == [
        "action_0_0 (pick a) planned",
        "action_0_0 (pick a) running",
        "action_0_0 (pick a) failed: slipped",
        "action_0_0 removed",
    ]
    assert [event.text for event in stage.entries("intention", type=EVENT)] == [
        "intention_0 (on(a,b)) wanted",
        "intention_0 (on(a,b)) reached",
    ]
    assert stage.spans("action") == [("action_0_0,a", pytest.approx(0.5, abs=1e-5), 1.5)]
    assert stage.spans("intention") == [("intention_0", 0.0, 1.5)]
    assert stage.entries("action", type=SITUATION)[0].outcome == "failed: slipped"
    assert stage.entries("action", type=EVENT)[-1].details == {"skill": "pick", "target": "a", "status": "removed"}


def test_agents_come_fall_silent_and_stop() -> None:
    stage = Stage(workers=("worker",))
    with stage.lockstep:
        stage.run(5.0)
        assert {entry.participants for entry in stage.entries("agent")} == {
            ("chronicler", "chronicler-1"), ("worker", "worker-1"),
        }  # fmt: skip
        stage.lockstep.kill("worker")
        stage.run(5.0)
        [entry] = stage.entries("agent", participants="worker")
        assert entry.outcome == "worker silent for 3 s" and 4.0 <= entry.last - stage.start <= 5.1
        stage.lockstep.restart("worker")
        stage.run(5.0)
        [_, again] = stage.entries("agent", participants="worker")
        assert again.is_open and again.participants == ("worker", "worker-2")


def test_a_restart_writes_nothing_twice_and_ends_what_ended_meanwhile() -> None:
    stage = Stage(workers=("worker",))
    with stage.lockstep:
        memory = stage.memory
        for name in ("a", "b"):
            memory.add_node(name, "cube", marker_id=3)
            memory.add_edge(name, "table", "on", since=stage.start)
        memory.update_node("a", surprising=True)
        memory.add_node("intention_0", "intention", goal="on(a,b)", status="wanted")
        stage.run(3.0)
        before = {entry.name for entry in query(memory)}
        stage.lockstep.kill("chronicler")
        memory.remove_edge("a", "table", "on")
        memory.update_node("a", surprising=False)
        calmed = stage.now - stage.start
        stage.run(2.0)
        stage.lockstep.restart("chronicler")
        stage.run(8.0)
        new = [entry.participants for entry in query(memory) if entry.name not in before]
        assert new == [("chronicler", "chronicler-2")]
        assert stage.spans("surprising") == [("a", pytest.approx(0.0, abs=1e-5), calmed)]
        assert {names: end is None for names, _, end in stage.spans("on")} == {"a,table": False, "b,table": True}
        [old] = stage.entries("agent", participants="chronicler-1")
        assert not old.is_open


def test_two_at_once_write_one_timeline() -> None:
    stage = Stage("chronicler", "second", workers=("worker",))
    with stage.lockstep:
        memory = stage.memory
        for name, kind in (("a", "cube"), ("hand", "gripper")):
            memory.add_node(name, kind, note="x")
        memory.add_node("intention_0", "intention", goal="g", status="wanted")
        for round_ in range(3):
            memory.add_edge("a", "table", "on", since=stage.now)
            memory.add_edge("hand", "a", "grasping")
            memory.update_node("a", surprising=True, present=round_ != 1)
            memory.update_node("intention_0", status="planning")
            stage.run(2.0)
            memory.remove_edge("a", "table", "on")
            memory.remove_edge("hand", "a", "grasping")
            memory.update_node("a", surprising=False)
            memory.update_node("intention_0", status="executing")
            stage.run(2.0)
        counts = {
            kind: len(stage.entries(kind, type=SITUATION)) for kind in ("on", "grasping", "surprising", "present")
        }
        assert counts == {"on": 3, "grasping": 3, "surprising": 3, "present": 2}
        assert len(stage.entries("intention", type=EVENT)) == 6
        assert len(stage.entries("agent")) == 3
        assert all(len(entry.writers) <= 2 for entry in query(memory))
        stage.lockstep.kill("chronicler")
        stage.run(6.0)
        assert [entry.outcome for entry in stage.entries("agent", participants="chronicler")] == [
            "chronicler silent for 3 s"
        ]
        assert kept_by(memory) == "second"


def test_what_another_told_before_it_is_known_here_is_not_ended(stage: Stage) -> None:
    """A second chronicler may hear of a relation earlier."""
    stage.memory.add_node("a", "cube")
    stage.memory.add_node("situation_" + 20 * "0", SITUATION, kind="on", participants="a,table", begin=stage.start)
    stage.run(0.8)
    assert stage.spans("on") == [("a,table", 0.0, None)]
    stage.run(1.0)
    assert stage.spans("on")[0][2] is not None


def test_situations_of_others_are_left_alone(stage: Stage) -> None:
    stage.memory.add_node("situation_x-1_0", SITUATION, kind="on", participants="a,b", begin=stage.start)
    stage.run(5.0)
    assert stage.spans("on") == [("a,b", 0.0, None)]


def test_retention_is_configured() -> None:
    stage = Stage(count=20)
    with stage.lockstep:
        stage.memory.add_node("a", "cube", note="x")
        for _ in range(40):
            stage.memory.add_edge("a", "table", "on", since=stage.now)
            stage.run(0.2)
            stage.memory.remove_edge("a", "table", "on")
            stage.run(0.2)
        assert 15 <= len(query(stage.memory)) <= 20
        assert [entry.is_open for entry in stage.entries("present")] == [True]


def test_runs_of_one_seed_are_identical() -> None:
    def names() -> list[str]:
        stage = Stage("chronicler", "second")
        with stage.lockstep:
            stage.memory.add_node("a", "cube", surprising=True)
            stage.memory.add_edge("a", "table", "on", since=stage.start)
            stage.run(2.0)
            return [entry.name for entry in query(stage.memory)]

    assert names() == names()


@pytest.mark.parametrize("config", [{"count": 0}, {"age": -1.0}])
def test_a_wrong_configuration_is_told(config: dict[str, Any]) -> None:
    with pytest.raises(ConfigError):
        Stage(**config)


def test_an_emergency_stop_is_a_situation_that_says_who_halted_and_who_released() -> None:
    with Stage().lockstep as lockstep:
        write_order(lockstep.memory, HaltOrder("1", True, "anna", "a hand is in the way", lockstep.clock.now()))
        lockstep.run_for(1.0)
        write_order(lockstep.memory, HaltOrder("2", False, "ben", "", lockstep.clock.now()))
        lockstep.run_for(0.5)
        told = [(event.kind, event.subject, event.text) for event in tell(query(lockstep.memory, kind=FORBIDDEN))]
    assert told == [
        ("halted", "halt", "halted by anna: a hand is in the way"),
        ("released", "halt", "released by ben"),
    ]


def test_what_is_over_goes_into_summaries_by_the_one_that_keeps_the_timeline() -> None:
    stage = Stage("first", "second")
    with stage.lockstep:
        stage.memory.add_node("a", "cube")
        stage.memory.add_edge("a", "table", "on", since=stage.start - 2.0, source="contact")
        stage.run(1.0)
        stage.memory.remove_edge("a", "table", "on")
        stage.run(35.0)
        [entry] = recall(stage.memory, kind="on")
        keeper = kept_by(stage.memory)
        summaries = list(stored_summaries(stage.memory))
        assert keeper and {agent_of(node.created[0][0]) for node in stage.memory.nodes(SUMMARY)} == {keeper}
        told = [item for stored in summaries for item in stored.summary.items if item.kind == "on"]
        assert [item.participants for item in told] == [entry.participants] == [("a", "table")]
        assert told[0].begin == pytest.approx(stage.start - 2.0, abs=0.06)


def test_a_text_of_the_greatest_length_keeps_nothing_from_being_told(stage: Stage) -> None:
    """What is told of it is longer than what it is made of."""
    memory, longest = stage.memory, "x" * MAX_LENGTH
    memory.add_node("a", "cube", surprising=True, surprise=longest)
    memory.add_edge("a", "table", "on", source=longest)
    memory.add_node("intention_0", "intention", goal=longest, status=longest, explanation=longest)
    memory.add_node("action_0", "action", skill="pick", target=longest, destination="table", status="running")
    stage.run(2.0)
    told = query(memory)
    assert {entry.kind for entry in told} >= {"on", "surprising", "intention", "action", "present"}
    assert {entry.participants for entry in stage.entries("action")} == {("action_0", "table")}
    assert max(len(entry.text) for entry in told) == MAX_LENGTH


def test_however_much_somebody_makes_up_what_others_do_is_told_and_nothing_is_told_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looks = 0

    def looked(memory: Memory) -> list[Entry]:
        nonlocal looks
        looks += 1
        return read_all(memory)

    monkeypatch.setattr(chronicle, "read_all", looked)
    stage = Stage(count=60)
    with stage.lockstep:
        stage.memory.add_node("a", "cube")
        stage.run()
        liar = stage.lockstep._join("liar", "liar-1", None)
        for number in range(200):
            liar.add_node(f"zz_{number}", "intention", goal="on(a,b)", status="wanted")
        liar.flush()
        looks = 0
        stage.run(2.0)
        told = stage.entries(INTENTION, PRESENT, type=SITUATION, open=True)
        assert ("a",) in {entry.participants for entry in told} and len(told) == 30
        assert looks < 30, "each event had all entries read"
        stage.run(5.0)
        assert stage.entries(INTENTION, PRESENT, type=SITUATION, open=True) == told
        assert not [entry for entry in stage.entries(INTENTION) if entry.text.endswith("removed")]
