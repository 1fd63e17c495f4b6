"""What the graph view folds: links of arms, fingers of hands and finished actions, and what it leaves out."""

from __future__ import annotations

from typing import Any

import pytest

from agents.viewer.folding import MOST_EDGES, MOST_NODES, fold
from agents.viewer.model import read_scene
from dsr import LocalNetwork, ManualClock, Memory, Pose


def build_arm(memory: Any) -> None:
    memory.add_node("world", "world")
    memory.add_node("robot", "robot")
    memory.add_node("arm", "arm")
    memory.add_edge("world", "robot", "has")
    memory.add_edge("robot", "arm", "has")
    above = "arm"
    for number in range(1, 4):
        memory.add_node(f"arm_link_{number}", "body")
        memory.add_edge(above, f"arm_link_{number}", "has")
        above = f"arm_link_{number}"
    memory.add_node("gripper", "gripper")
    memory.add_edge(above, "gripper", "has")


def test_links_are_folded_into_their_arm(stage: Any) -> None:
    build_arm(stage.memory)
    folded = fold(stage.memory)
    assert set(folded.nodes) == {"world", "robot", "arm", "gripper"}
    assert folded.labels["arm"] == "arm (3 links)"
    assert ("arm", "gripper", "has") in folded.edges and len(folded.edges) == 3


def test_fingers_are_folded_into_their_hand_wherever_they_are_measured_from(stage: Any) -> None:
    memory = stage.memory
    memory.add_node("world", "world")
    memory.add_node("hand_0", "hand")
    memory.add_edge("world", "hand_0", "RT", pose=Pose())
    for count, expected in ((1, "hand_0 (1 finger)"), (2, "hand_0 (2 fingers)")):
        finger = f"hand_0_finger_{count}"
        memory.add_node(finger, "finger")
        memory.add_edge("hand_0", finger, "has")
        memory.add_edge("world", finger, "RT", pose=Pose())
        folded = fold(memory)
        assert set(folded.nodes) == {"world", "hand_0"} and folded.labels["hand_0"] == expected
    assert folded.edges == [("world", "hand_0", "RT")]


def test_a_body_without_an_arm_is_drawn(stage: Any) -> None:
    stage.memory.add_node("robot", "robot")
    stage.memory.add_node("body", "body")
    stage.memory.add_edge("robot", "body", "has")
    assert set(fold(stage.memory).nodes) == {"robot", "body"}


def test_actions_are_folded_once_they_are_over(stage: Any) -> None:
    memory = stage.memory
    memory.add_node("intention_0", "intention", goal="on(a, b)")
    for number, status in enumerate(("done", "failed", "running", "planned")):
        memory.add_node(f"action_0_{number}", "action", status=status)
        memory.add_edge("intention_0", f"action_0_{number}", "has")
    folded = fold(memory)
    assert set(folded.nodes) == {"intention_0", "action_0_2", "action_0_3"}
    assert folded.labels["intention_0"] == "intention_0 (2 done)"
    memory.update_node("action_0_2", status="done")
    assert fold(memory).labels["intention_0"] == "intention_0 (3 done)"


def test_events_and_edges_that_images_show_are_left_out(stage: Any) -> None:
    memory = stage.memory
    memory.add_node("camera", "camera")
    memory.add_node("cube_3", "cube")
    memory.add_node("event_0", "event", time=1.0)
    memory.add_edge("camera", "cube_3", "sees")
    folded = fold(memory)
    assert set(folded.nodes) == {"camera", "cube_3"} and folded.edges == []


def test_a_circle_of_links_is_drawn(stage: Any) -> None:
    memory = stage.memory
    for name in ("a", "b"):
        memory.add_node(name, "body")
    memory.add_edge("a", "b", "has")
    memory.add_edge("b", "a", "has")
    assert set(fold(memory).nodes) == {"a", "b"}


def test_however_many_nodes_somebody_makes_up_those_of_others_are_drawn() -> None:
    network = LocalNetwork(ManualClock())
    liar, honest = (Memory("g", name, transport=network.connect(name), clock=network.clock) for name in ("liar", "me"))
    for number in range(MOST_NODES):
        liar.add_node(f"a_{number}", "cube")
        for type in ("behind", "left_of", "above", "on", "in"):
            liar.add_edge(f"a_{number}", "a_0", type)
    honest.add_node("world", "world")
    honest.add_node("cube", "cube")
    honest.add_edge("world", "cube", "RT")
    for _ in range(3):
        for memory in (liar, honest):
            memory.flush()
            network.deliver()
            memory.poll()
    folded = fold(liar)
    assert len(folded.nodes) == MOST_NODES and {"world", "cube"} <= folded.nodes.keys()
    assert len(folded.edges) <= MOST_EDGES and ("world", "cube", "RT") in folded.edges
    assert folded.labels["world"] == "world (2 nodes are not drawn)"


@pytest.mark.parametrize("type", ["cube", "table", "body", "gripper"])
def test_however_many_bodies_somebody_makes_up_those_of_others_are_drawn_in_the_scene(type: str) -> None:
    network = LocalNetwork(ManualClock())
    liar, honest = (Memory("g", name, transport=network.connect(name), clock=network.clock) for name in ("liar", "me"))
    honest.add_node("world", "world")
    honest.add_node("z", type, bounds=(-0.1, -0.1, -0.1, 0.1, 0.1, 0.1))
    honest.add_edge("world", "z", "RT", pose=Pose((1.0, 0.0, 0.0)))
    for _ in range(3):
        for memory in (honest, liar):
            memory.flush()
            network.deliver()
            memory.poll()
    for number in range(MOST_NODES):
        liar.add_node(f"a_{number}", type, bounds=(-0.1, -0.1, -0.1, 0.1, 0.1, 0.1))
        liar.add_edge("z" if type == "body" else "world", f"a_{number}", "RT", pose=Pose())
    scene = read_scene(liar)
    drawn = [scene.percepts, scene.tables, scene.parts, scene.links, scene.grippers, scene.frames]
    assert max(map(len, drawn)) <= MOST_NODES
    solids = [*scene.percepts, *scene.tables, *scene.parts]
    assert "z" in {solid.name for solid in solids} and len(scene.links) == (MOST_NODES - 1) * (type == "body")


def test_the_world_is_drawn_however_many_nodes_come_before_it(stage: Any) -> None:
    for number in range(2 * MOST_NODES):
        stage.memory.add_node(f"a_{number:04}", "cube")
    stage.memory.add_node("world", "world")
    labels = fold(stage.memory).labels
    assert len(labels) == MOST_NODES and labels["world"] == f"world ({MOST_NODES + 1} nodes are not drawn)"
