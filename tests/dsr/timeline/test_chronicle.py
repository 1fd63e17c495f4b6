"""The timeline in the working memory: what agents write there, ask, and forget."""

from __future__ import annotations

import math
from typing import Any

import pytest

from dsr import Access, AgentError, ConfigError, Memory, SchemaError
from dsr.clock import ManualClock
from dsr.graph.access import WriteGuard, check_writers
from dsr.network.local_transport import LocalNetwork
from dsr.timeline import (
    WRITTEN_ATTRIBUTES,
    WRITTEN_EDGES,
    WRITTEN_NODES,
    Chronicle,
    Retention,
    explanations,
    query,
    read_entry,
    tell,
)

START = 1e9
WRITES = Access(nodes=WRITTEN_NODES, edges=WRITTEN_EDGES, attributes=(*WRITTEN_ATTRIBUTES, "target"))


class Company:
    """Some agents on one network in memory, on a manual clock."""

    def __init__(self) -> None:
        self.clock = ManualClock(START)
        self.network = LocalNetwork(self.clock)
        self.memories: list[Memory] = []

    def join(self, agent: str, run: int = 1) -> Memory:
        guard = WriteGuard(agent, WRITES)
        rid = f"{agent}-{run}"
        memory = Memory("g", agent, transport=self.network.connect(rid), clock=self.clock, rid=rid, guard=guard)
        self.memories.append(memory)
        self.pass_time(0.0)
        return memory

    def leave(self, memory: Memory) -> None:
        self.memories.remove(memory)
        memory.close()
        self.pass_time(0.0)

    def pass_time(self, seconds: float) -> None:
        self.clock.advance(seconds)
        for _ in range(4):
            for memory in self.memories:
                memory.flush()
            self.network.deliver()
            for memory in self.memories:
                memory.poll()


@pytest.fixture
def company() -> Company:
    return Company()


def names(memory: Memory, **wanted: Any) -> list[str]:
    return [entry.text for entry in query(memory, **wanted)]


def test_an_event_is_a_node_below_the_timeline(company: Company) -> None:
    memory = company.join("waiter")
    name = Chronicle(memory).happened("Pick", ("cup_1", "hand"), START - 2.0, text="picked", confidence=0.9, target="x")
    assert name == "event_waiter-1_0"
    assert dict(memory.node(name)) == {
        "kind": "Pick", "participants": "cup_1,hand", "time": START - 2.0, "text": "picked", "confidence": 0.9,
        "source": "waiter", "target": "x",
    }  # fmt: skip
    assert memory.get_edge("timeline", name, "has") is not None
    entry = read_entry(memory.node(name))
    assert entry is not None and entry.participants == ("cup_1", "hand") and entry.interval == (START - 2, START - 2)
    assert entry.details == {"target": "x"} and entry.writers == ("waiter",) and not entry.is_open


def test_a_situation_lasts_until_it_is_ended_and_can_be_resumed(company: Company) -> None:
    chronicle = Chronicle(company.join("waiter"), "w")
    name = chronicle.begin("serving", "tray")
    entry = chronicle.entry(name)
    assert entry is not None and entry.is_open and (entry.begin, entry.source) == (START, "w")
    company.pass_time(2.0)
    assert chronicle.end(name, outcome="spilt") and not chronicle.end(name)
    entry = chronicle.entry(name)
    assert entry is not None and entry.end == START + 2.0 and entry.outcome == "spilt"
    assert chronicle.resume(name) and not chronicle.resume(name)
    entry = chronicle.entry(name)
    assert entry is not None and entry.is_open and entry.outcome == ""
    assert not chronicle.end("nobody") and not chronicle.resume("nobody")


def test_an_end_before_the_begin_counts_as_the_begin(company: Company) -> None:
    chronicle = Chronicle(company.join("waiter"))
    name = chronicle.begin("serving", "tray")
    chronicle.end(name, START - 5.0)
    entry = chronicle.entry(name)
    assert entry is not None and entry.end == START


def test_queries_by_kind_participant_source_type_and_time(company: Company) -> None:
    memory = company.join("waiter")
    chronicle = Chronicle(memory)
    chronicle.happened("Pick", ("a", "hand"), START, text="pick a")
    held = chronicle.begin("grasping", ("hand", "a"), START, text="hold a", source="contact")
    chronicle.end(held, START + 4.0)
    chronicle.happened("Place", ("a", "hand"), START + 4.0, text="place a")
    chronicle.begin("on", ("a", "b"), START + 4.0, text="a on b")
    company.clock.advance(10.0)
    assert names(memory) == ["pick a", "hold a", "place a", "a on b"]
    assert names(memory, kind="Pick") == ["pick a"] and names(memory, kind=["on", "Pick"]) == ["pick a", "a on b"]
    assert names(memory, participants="b") == ["a on b"] and names(memory, participants=("hand", "b")) == []
    assert names(memory, source="contact") == ["hold a"] and names(memory, type="event") == ["pick a", "place a"]
    assert names(memory, since=START + 4.5) == ["a on b"] and names(memory, until=START) == ["pick a", "hold a"]
    assert names(memory, open=True) == ["a on b"] and names(memory, open=False, type="situation") == ["hold a"]
    entry = chronicle.entry(held)
    assert entry is not None
    assert names(memory, during=entry) == ["pick a", "hold a", "place a"]
    assert names(memory, during=(START + 3.0, None)) == ["place a", "a on b"]
    assert names(memory, relation="starts", of=entry) == ["pick a"]
    assert names(memory, relation=("met_by", "finishes"), of=entry) == ["place a", "a on b"]
    assert names(memory, relation="after", of=(START, START + 1.0)) == ["place a", "a on b"]


@pytest.mark.parametrize(
    ("wanted", "expected"),
    [({"relation": "durin", "of": (0.0, 1.0)}, "did you mean 'during'"), ({"relation": "during"}, "go together"),
     ({"of": (0.0, 1.0)}, "go together"), ({"during": (2.0, 1.0)}, "ends before"),
     ({"relation": "before", "of": (math.nan, 3.0)}, "of: expected numbers .* got \\(nan, 3.0\\)"),
     ({"relation": 3, "of": (0.0, 1.0)}, "relation: expected a name or several, got 3"),
     ({"during": (math.nan, 3.0)}, "during: expected numbers"), ({"during": (None, 1.0)}, "during: expected numbers"),
     ({"during": (0.0, "x")}, "during: expected numbers"), ({"during": (1.0,)}, "during: expected an entry"),
     ({"during": "x"}, "during: expected an entry"), ({"during": "on"}, "during: expected an entry"),
     ({"kind": 3}, "kind: expected a name or several, got 3"), ({"kind": ["on", None]}, "kind: .*got None"),
     ({"participants": 3}, "participants: expected a name"), ({"participants": [3]}, "participants: expected a name"),
     ({"since": math.nan}, "since: expected a number"), ({"until": "x"}, "until: expected a number"),
     ({"since": 2.0, "until": 1.0}, "the earlier time first"),
     ({"source": 3}, "source: expected a name"), ({"open": "yes"}, "open: expected true, false or None, got 'yes'"),
     ({"type": "evnt"}, "did you mean 'event'"), ({"type": "cube"}, "valid: event, situation")],
)  # fmt: skip
def test_wrong_queries_are_told(company: Company, wanted: dict[str, Any], expected: str) -> None:
    memory = company.join("waiter")
    Chronicle(memory).happened("x")
    with pytest.raises(ConfigError, match=expected):
        query(memory, **wanted)


def test_writers_do_not_meet_each_other_and_all_see_all(company: Company) -> None:
    first, second = company.join("first"), company.join("second")
    for memory in (first, second):
        Chronicle(memory).happened("ping", text=memory.agent)
    company.pass_time(1.0)
    assert names(first) == names(second) == ["first", "second"]


def test_the_same_key_is_one_entry_whoever_tells_it_and_after_a_restart(company: Company) -> None:
    first, second = company.join("first"), company.join("second")
    told = {Chronicle(memory).happened("x", "a", START, key="k") for memory in (first, second)}
    company.pass_time(1.0)
    assert len(told) == 1 and [entry.writers for entry in query(first)] == [("first", "second")]
    company.leave(first)
    again = Chronicle(company.join("first", run=2))
    assert {again.happened("x", "a", START, key="k")} == told and len(again.query()) == 1
    assert again.happened("x", "b", START, key="k") not in told


def test_names_of_a_restarted_agent_are_new_ones(company: Company) -> None:
    memory, _ = company.join("waiter"), company.join("witness")
    Chronicle(memory).happened("x")
    Chronicle(memory).happened("x")
    company.pass_time(1.0)
    company.leave(memory)
    again = company.join("waiter", run=2)
    Chronicle(again).happened("x")
    assert len(query(again)) == 3


def test_the_count_bounds_the_own_and_the_oldest_go_first(company: Company) -> None:
    memory, other = company.join("waiter"), company.join("other")
    chronicle = Chronicle(memory, keep=Retention(count=5))
    Chronicle(other).happened("kept", time=START - 100.0, text="of another")
    company.pass_time(0.0)
    lasting = chronicle.begin("lasting", time=START - 50.0, text="lasting")
    for index in range(30):
        chronicle.happened("x", time=START + index, text=str(index))
        assert len(query(memory, kind=("x", "lasting"))) <= 5
    assert names(memory, kind="x") == ["26", "27", "28", "29"] and lasting in memory
    assert names(memory, kind="kept") == ["of another"]


def test_even_what_lasts_is_bounded(company: Company) -> None:
    memory = company.join("waiter")
    chronicle = Chronicle(memory, keep=Retention(count=5))
    for index in range(20):
        chronicle.begin("lasting", time=START + index, text=str(index))
    assert names(memory) == ["15", "16", "17", "18", "19"]


def test_age_bounds_what_is_over(company: Company) -> None:
    memory = company.join("waiter")
    chronicle = Chronicle(memory, keep=Retention(age=100.0))
    chronicle.happened("x", text="old")
    chronicle.begin("y", text="lasting")
    company.pass_time(101.0)
    chronicle.happened("x", text="new")
    assert names(memory) == ["lasting", "new"]


def test_an_event_with_a_key_that_was_forgotten_does_not_come_back(company: Company) -> None:
    memory = company.join("waiter")
    chronicle = Chronicle(memory, keep=Retention(count=3, age=100.0))
    for index in range(6):
        chronicle.happened("x", time=START + index, key=str(index), text=str(index))
    chronicle.happened("x", time=START, key="0")
    assert names(memory) == ["3", "4", "5"]
    company.pass_time(200.0)
    chronicle.forget()
    chronicle.happened("x", time=START + 5, key="5")
    assert names(memory) == []


def test_events_are_told_again_after_all_that_was_left_lasted(company: Company) -> None:
    memory = company.join("waiter")
    chronicle = Chronicle(memory, keep=Retention(count=5))
    lasting = [chronicle.begin("lasting", time=START + index, text=str(index)) for index in range(9)]
    chronicle.happened("x", time=START, key="before", text="before")
    for name in lasting:
        chronicle.end(name, time=START + 20.0)
    company.pass_time(30.0)
    chronicle.happened("x", time=START + 30.0, key="after", text="after")
    assert "after" in names(memory)


def test_entries_of_who_is_gone_are_forgotten_by_others_but_nothing_recent_is(company: Company) -> None:
    gone, here = company.join("gone"), company.join("here")
    theirs = Chronicle(gone)
    for index in range(30):
        theirs.happened("x", time=START + index)
    company.pass_time(40.0)
    company.leave(gone)
    chronicle = Chronicle(here, keep=Retention(count=5, age=1000.0))
    assert chronicle.forget() == 0 and len(query(here)) == 30
    company.pass_time(100.0)
    assert chronicle.forget() == 25 and len(query(here)) == 5
    company.pass_time(1000.0)
    assert chronicle.forget() == 5


def test_entries_of_who_is_there_are_left_alone(company: Company) -> None:
    other, here = company.join("other"), company.join("here")
    for index in range(30):
        Chronicle(other, keep=Retention(age=1e9)).happened("x", time=START + index)
    company.pass_time(5000.0)
    assert Chronicle(here, keep=Retention(count=5)).forget() == 0


def test_a_situation_that_its_writer_left_is_ended_when_it_was_missed(company: Company) -> None:
    gone, here, _ = company.join("gone"), company.join("here"), company.join("witness")
    name = Chronicle(gone).begin("serving", "tray")
    company.pass_time(10.0)
    company.leave(gone)
    chronicle = Chronicle(here)
    for _ in range(5):
        company.pass_time(10.0)
        chronicle.forget()
    entry = chronicle.entry(name)
    assert entry is not None and entry.is_open
    for _ in range(5):
        company.pass_time(10.0)
        chronicle.forget()
    entry = chronicle.entry(name)
    assert entry is not None and entry.end == START + 20.0 and "gone" in entry.outcome


def test_who_is_cut_off_from_all_ends_nothing_of_others(company: Company) -> None:
    gone, here = company.join("gone"), company.join("here")
    name = Chronicle(gone).begin("serving", "tray")
    company.pass_time(10.0)
    company.leave(gone)
    chronicle = Chronicle(here)
    for _ in range(20):
        company.pass_time(10.0)
        chronicle.forget()
    entry = chronicle.entry(name)
    assert entry is not None and entry.is_open


def test_an_agent_finds_what_its_earlier_run_left_open(company: Company) -> None:
    first = company.join("waiter")
    name = Chronicle(first).begin("serving", "tray")
    Chronicle(company.join("other")).begin("serving", "pot")
    company.pass_time(1.0)
    company.leave(first)
    assert [entry.name for entry in Chronicle(company.join("waiter", run=2)).left_open()] == [name]


def test_declarations_go_with_each_other_and_what_is_not_declared_is_refused(company: Company) -> None:
    check_writers({"a": WRITES, "b": WRITES})
    chronicle = Chronicle(company.join("waiter"))
    with pytest.raises(AgentError, match="'goal'"):
        chronicle.happened("x", goal="y")
    with pytest.raises(SchemaError, match="confidence"):
        chronicle.happened("x", confidence="much")  # type: ignore[arg-type]


@pytest.mark.parametrize("confidence", [2.0, -0.1, 2, math.nan, math.inf])
def test_a_confidence_is_0_to_1(company: Company, confidence: float) -> None:
    chronicle = Chronicle(company.join("waiter"))
    for write in (chronicle.happened, chronicle.begin):
        with pytest.raises(SchemaError, match="'confidence': expected 0 to 1, got"):
            write("x", key="once", confidence=confidence)
    assert chronicle.query() == []
    chronicle.happened("x", confidence=0.0)
    chronicle.happened("x", confidence=1)


@pytest.mark.parametrize("values", [{}, {"begin": 3.0}, {"time": 9e11}, {"time": -9e11}, {"time": 2.6e11}])
def test_nodes_without_a_time_are_no_entries(company: Company, values: dict[str, Any]) -> None:
    memory = company.join("waiter")
    memory.add_node("event_x", "event", kind="x", **values)
    assert query(memory) == [] and Chronicle(memory).forget() == 0


def test_explanations_of_graphs_without_kinds_are_known(company: Company) -> None:
    memory = company.join("waiter")
    memory._guard = None
    memory.add_node("event_0", "event", time=2.0, explanation="fell(a)")
    memory.add_node("event_1", "event", time=1.0, explanation="fell(b)", kind="explained")
    memory.add_node("event_2", "event", time=0.0, kind="Pick")
    assert [node.name for node in explanations(memory)] == ["event_1", "event_0"]


def test_entries_are_told_as_begin_and_end(company: Company) -> None:
    chronicle = Chronicle(company.join("waiter"))
    on = chronicle.begin("on", ("a", "b"), START)
    chronicle.end(on, START + 3.0)
    chronicle.begin("surprising", "a", START + 1.0, text="a is surprising: beside")
    chronicle.begin("action", "action_0", START)
    chronicle.happened("Pick", ("a", "hand"), START + 2.0, confidence=0.5)
    told = [(event.time - START, event.kind, event.subject, event.text) for event in tell(chronicle.query())]
    assert told == [
        (0.0, "began", "a on b", "a on b"),
        (1.0, "surprised", "a", "a is surprising: beside"),
        (2.0, "Pick", "a", "Pick a, hand"),
        (3.0, "ended", "a on b", "no more a on b"),
    ]


@pytest.mark.parametrize("wrong", [{"count": 0}, {"age": 0.0}, {"age": float("nan")}])
def test_a_retention_keeps_something(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="expected a positive"):
        Retention(**wrong)
