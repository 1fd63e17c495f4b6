"""The agent between a graph and its policy, in lockstep."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from agents.action_inference import ActionInference
from dsr.memory import Memory
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec
from dsr.timeline import EVENT, Retention
from dsr.vocabulary.observed_actions import DEEDS, PICK, PLACE, Deed, encoded, read_action

NAME = "action_inference"
HAND = "human_hand_0"


class Graph:
    """A cube of which a belief tells."""

    def __init__(self, **config: object) -> None:
        self.lockstep = Lockstep([AgentSpec(NAME, ActionInference, config)], strict=True)
        self.memory: Memory = self.lockstep.memory
        self.memory.add_node("world", "world")
        self.memory.add_node("cube", "cube", size=(0.04, 0.04, 0.04), perceived=True, plausible=True)
        self.memory.add_edge("world", "cube", "Virtual_RT")
        self.run(0.5)
        self.began = self.lockstep.clock.now()

    def do(self, *deeds: Deed) -> None:
        self.memory.update_node("cube", **{DEEDS: encoded(deeds)})

    def run(self, seconds: float) -> None:
        self.memory.flush()
        self.lockstep.run_for(seconds)

    def told(self) -> list[str]:
        actions = [action for node in self.memory.nodes(EVENT) if (action := read_action(node))]
        return [str(action) for action in sorted(actions)]


@pytest.fixture
def graph() -> Iterator[Graph]:
    graph = Graph()
    yield graph
    graph.lockstep.close()


def test_deeds_become_events_with_who_did_it_when_and_how_sure_that_is(graph: Graph):
    graph.do(Deed(PICK, graph.began, HAND, 0.8))
    graph.run(0.5)
    (event,) = [node for node in graph.memory.nodes(EVENT) if node["kind"] == "Pick"]
    assert event["participants"] == f"cube,{HAND}"
    assert event["time"] == graph.began and event["confidence"] == 0.8
    assert "taken up" in event["text"] and event["source"] == NAME


def test_after_a_restart_it_goes_on(graph: Graph):
    picked = Deed(PICK, graph.began, HAND, 0.8)
    graph.do(picked)
    graph.run(0.5)
    graph.lockstep.kill(NAME)
    graph.do(picked, Deed(PLACE, graph.began + 0.6, HAND, 0.8))
    graph.run(0.5)
    graph.lockstep.restart(NAME)
    graph.run(1.0)
    assert graph.told() == [f"Pick(cube, {HAND})", f"Place(cube, {HAND})"]


def test_what_is_too_old_for_the_timeline_is_not_told_again_after_a_restart(graph: Graph):
    graph.do(Deed(PICK, graph.began - Retention().age - 1.0, HAND, 0.8))
    graph.lockstep.kill(NAME)
    graph.lockstep.restart(NAME)
    graph.run(1.0)
    assert graph.told() == []


def test_what_goes_away_and_comes_back_is_not_told_again(graph: Graph):
    graph.do(Deed(PICK, graph.began, HAND, 0.8))
    graph.run(0.5)
    for present in (False, True):
        graph.memory.update_node("cube", present=present)
        graph.run(0.5)
    assert graph.told() == [f"Pick(cube, {HAND})"]


def test_the_published_policy_can_be_chosen():
    graph = Graph(policy="published")
    graph.memory.update_node("cube", plausible=False)
    graph.run(1.0)
    assert graph.told() == ["Pick(cube)"]
    graph.lockstep.close()


def deeds(count: int = 1, kind: str = PICK, by: str = "x") -> str:
    return encoded([Deed(kind, 1e9 + 0.01 * k, by, 1.0) for k in range(count)])


@pytest.mark.parametrize(
    "told",
    ["?", "[1]", deeds(kind="Sold"), deeds(3), deeds(by="a, b"), deeds(by="a\n\x1b[2J"), deeds(by="x" * 900_000)],
)
def test_what_is_no_deed_and_what_is_yet_to_come_is_left_out(graph: Graph, told: str, caplog: pytest.LogCaptureFixture):
    graph.memory.update_node("cube", **{DEEDS: told})
    graph.run(0.5)
    assert caplog.text.count("the deeds of cube are left out") == 1
    graph.do(Deed(PICK, graph.began + 100.0, HAND, 0.8))
    graph.run(0.5)
    assert graph.told() == []
    graph.memory.remove_node("cube")
    graph.run(0.5)
