"""The agent between a graph and its policy, in lockstep."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from agents.action_inference import ActionInference
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec
from dsr.timeline import EVENT
from dsr.vocabulary.observed_actions import read_action

NAME = "action_inference"
OVERHEAD = Pose((0.3, 0.0, 0.65), (1.0, 0.0, 0.0, 0.0))


class Graph:
    """A cube on a table under a camera, and a hand."""

    def __init__(self, **config: object) -> None:
        self.lockstep = Lockstep([AgentSpec(NAME, ActionInference, config)], strict=True)
        self.memory: Memory = self.lockstep.memory
        memory = self.memory
        memory.add_node("world", "world")
        memory.add_node("table", "table", size=(1.2, 1.2, 0.04))
        memory.add_node("camera", "camera")
        memory.add_node("human_hand_0", "hand", perceived=True)
        memory.add_node("human_hand_0_finger_0", "finger", perceived=True)
        memory.add_node("cube", "cube", size=(0.04, 0.04, 0.04), perceived=True, plausible=True)
        memory.add_edge("world", "table", "RT", pose=Pose((0.3, 0.0, 0.0)))
        memory.add_edge("world", "camera", "RT", pose=OVERHEAD)
        memory.add_edge("world", "human_hand_0", "RT", pose=Pose((0.3, 0.0, 0.2)))
        memory.add_edge("human_hand_0", "human_hand_0_finger_0", "has")
        memory.add_edge("world", "human_hand_0_finger_0", "RT", pose=Pose((0.3, 0.02, 0.1)))
        memory.add_edge("cube", "table", "on", source="contact", since=1.0)
        self.height = 0.02
        memory.flush()

    def run(self, seconds: float, speed: float = 0.0) -> None:
        for _ in range(round(seconds / 0.1)):
            self.height += 0.1 * speed
            world_pose = Pose((0.3, 0.0, self.height))
            self.memory.add_edge("world", "cube", "Virtual_RT", pose=world_pose)
            seen = (OVERHEAD.inverse() @ world_pose).with_stamp(self.lockstep.clock.now())
            self.memory.add_edge("camera", "cube", "RT", pose=seen)
            self.memory.flush()
            self.lockstep.run_for(0.1)

    def told(self) -> list[str]:
        actions = [action for node in self.memory.nodes(EVENT) if (action := read_action(node))]
        return [str(action) for action in sorted(actions)]


@pytest.fixture
def graph() -> Iterator[Graph]:
    graph = Graph()
    yield graph
    graph.lockstep.close()


def test_actions_become_events_with_who_did_it_when_and_how_sure_that_is(graph: Graph):
    graph.run(1.0)
    began = graph.lockstep.clock.now()
    graph.memory.remove_edge("cube", "table", "on")
    graph.memory.update_node("cube", plausible=False)
    graph.run(0.6, 0.2)
    (event,) = [node for node in graph.memory.nodes(EVENT) if node["kind"] == "Pick"]
    assert event["participants"] == "cube,human_hand_0"
    assert event["time"] == pytest.approx(began, abs=0.11)
    assert 0.8 <= event["confidence"] < 1.0 and "near" in event["text"] and event["source"] == NAME


def test_after_a_restart_it_goes_on(graph: Graph):
    graph.run(1.0)
    graph.memory.remove_edge("cube", "table", "on")
    graph.memory.update_node("cube", plausible=False)
    graph.run(1.0, 0.2)
    graph.lockstep.kill(NAME)
    graph.run(0.5)
    graph.lockstep.restart(NAME)
    graph.run(1.0, -0.2)
    graph.memory.add_edge("cube", "table", "on", source="contact", since=1.0)
    graph.memory.update_node("cube", plausible=True)
    graph.run(1.0)
    assert graph.told() == ["Pick(cube, human_hand_0)", "Place(cube, human_hand_0)"]


def test_the_published_policy_can_be_chosen():
    graph = Graph(policy="published")
    graph.run(1.0)
    graph.memory.update_node("cube", plausible=False)
    graph.run(1.0)
    assert graph.told() == ["Pick(cube)"]
    graph.lockstep.close()


def test_things_that_come_and_go_and_edges_from_nowhere_do_no_harm(graph: Graph):
    graph.memory.add_node("lost", "cube")
    graph.memory.add_node("lost_camera", "camera")
    graph.memory.add_edge("lost_camera", "lost", "RT", pose=Pose((0.0, 0.0, 1.0)))
    graph.memory.add_node("human_hand_1", "hand")
    graph.run(0.5)
    graph.memory.remove_node("cube")
    graph.memory.remove_node("camera")
    graph.memory.flush()
    graph.lockstep.run_for(0.5)
    assert graph.told() == []
