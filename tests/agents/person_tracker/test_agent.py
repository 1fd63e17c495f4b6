"""The person tracker: who is told of has a node, who is not any more is not perceived."""

from __future__ import annotations

import pytest

from agents.drivers import PersonReading, PersonReadings
from agents.person_tracker import PersonTracker
from dsr import LocalNetwork, ManualClock, Memory
from dsr.agent import make_agent
from dsr.graph.access import WriteGuard
from dsr.network.keys import Keys

NEXT: list[PersonReadings] = []


class Tracker:
    """A driver that tells what is in `NEXT`."""

    def __init__(self, bus: object, keys: object) -> None: ...

    def readings(self) -> PersonReadings | None:
        return NEXT.pop() if NEXT else None

    def close(self) -> None: ...


@pytest.fixture
def clock() -> ManualClock:
    return ManualClock()


@pytest.fixture
def agent(clock: ManualClock) -> PersonTracker:
    NEXT.clear()
    bus = LocalNetwork(clock).connect("a")
    guard = WriteGuard("tracker", PersonTracker.writes)
    memory = Memory("g", "tracker", transport=bus, clock=clock, guard=guard)
    config = {"driver": f"{__name__}:Tracker"}
    agent = make_agent(
        PersonTracker, name="tracker", config=config, bus=bus, keys=Keys("g"), clock=clock, memory=memory
    )
    agent.setup()
    other = Memory("g", "other", transport=LocalNetwork(clock).connect("b"), clock=clock)
    other.replica.synchroniser.nobody_there()
    other.add_node("world", "world")
    other.add_node("cube", "cube")
    memory.restore(other.snapshot())
    assert isinstance(agent, PersonTracker)
    return agent


def reading(name: str, x: float = 1.0) -> PersonReading:
    return PersonReading(name, (x, 0.0, 0.5, 0.0, 0.0, 1.0, 0.0), 0.005, 0.02, (1.7, 1.3))


def test_who_is_told_of_has_a_node_with_a_pose(agent: PersonTracker, clock: ManualClock) -> None:
    NEXT.append(PersonReadings(clock.now(), [reading("human_1")]))
    agent.tick(clock.now())
    node, edge = agent.memory.node("human_1"), agent.memory.edge("world", "human_1", "RT")
    assert node.type == "person" and node["perceived"] and node["fov"] == (1.7, 1.3)
    assert edge.pose.t == (1.0, 0.0, 0.5) and edge.pose.covariance is not None


def test_who_is_not_told_of_any_more_is_not_perceived(agent: PersonTracker, clock: ManualClock) -> None:
    NEXT.append(PersonReadings(clock.now(), [reading("human_1")]))
    agent.tick(clock.now())
    clock.advance(0.3)
    NEXT.append(PersonReadings(clock.now(), []))
    agent.tick(clock.now())
    assert agent.memory.node("human_1")["perceived"] is True
    clock.advance(0.3)
    agent.tick(clock.now())
    assert agent.memory.node("human_1")["perceived"] is False
    assert agent.memory.edge("world", "human_1", "RT").pose.t == (1.0, 0.0, 0.5)


def test_names_that_cannot_be_used_are_counted(agent: PersonTracker, clock: ManualClock) -> None:
    NEXT.append(PersonReadings(clock.now(), [reading("cube"), reading("no name"), reading("human_1")]))
    agent.tick(clock.now())
    assert agent.skipped == {"taken": 1, "malformed": 1}
    assert "human_1" in agent.memory


def test_who_was_seen_at_a_time_to_come_is_not_perceived_for_ever(agent: PersonTracker, clock: ManualClock) -> None:
    agent.memory.add_node("human_1", "person", perceived=True, last_seen=1e12)
    agent.tick(clock.now())
    assert agent.memory.node("human_1")["perceived"] is False
