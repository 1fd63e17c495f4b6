"""The scene set-up: what is known beforehand is there, and nothing that is there is touched."""

from __future__ import annotations

from pathlib import Path

import pytest

from agents.scene_setup import SceneSetup
from dsr import LocalNetwork, ManualClock, Memory, Pose
from dsr.agent import make_agent
from dsr.errors import ConfigError
from dsr.graph.access import WriteGuard
from dsr.network.keys import Keys

SCENE = """
name = "scene"
title = "Two cubes, one of them known"
duration = 10.0
[table]
size = [1.0, 0.8, 0.03]
position = [0.4, 0.0, 0.1]
friction = 0.4
[[object]]
name = "cube_3"
marker_id = 3
size = [0.05, 0.05, 0.05]
mass = 0.2
known = true
position = [0.42, 0.08, 0.125]
[[object]]
name = "cube_4"
position = [0.30, 0.08, 0.12]
"""


@pytest.fixture
def memory() -> Memory:
    clock = ManualClock()
    transport = LocalNetwork(clock).connect("scene_setup")
    return Memory(
        "test", "scene_setup", transport=transport, clock=clock, guard=WriteGuard("scene_setup", SceneSetup.writes)
    )


@pytest.fixture
def scene(tmp_path: Path) -> str:
    file = tmp_path / "scene.toml"
    file.write_text(SCENE, encoding="utf-8")
    return str(file)


def set_up(memory: Memory, scenario: str) -> None:
    agent = make_agent(
        SceneSetup,
        name="scene_setup",
        config={"scenario": scenario},
        bus=memory.transport,
        keys=Keys("test"),
        clock=memory.clock,
        memory=memory,
    )
    agent.setup()
    agent.tick(memory.clock.now())


def test_table_stands_in_the_world(memory: Memory, scene: str) -> None:
    set_up(memory, scene)
    assert memory.transform("world", "table") == Pose((0.4, 0.0, 0.1))
    assert (memory.node("table")["size"], memory.node("table")["friction"]) == ((1.0, 0.8, 0.03), 0.4)


def test_known_objects_are_there_without_a_pose_and_others_are_not(memory: Memory, scene: str) -> None:
    set_up(memory, scene)
    cube = memory.node("cube_3")
    assert dict(cube) == {"size": (0.05, 0.05, 0.05), "mass": 0.2, "friction": 0.6, "marker_id": 3}
    assert memory.edges(dst="cube_3") == []
    assert "cube_4" not in memory


def test_what_rolls_says_how_easily(memory: Memory) -> None:
    set_up(memory, "c_pour")
    assert memory.node("ball")["rolling_friction"] == 0.002
    assert memory.node("table")["friction"] == 1.0
    assert "rolling_friction" not in memory.node("blue")


def test_without_a_scenario_there_is_a_table(memory: Memory) -> None:
    set_up(memory, "")
    assert [node.name for node in memory.nodes()] == ["world", "table"]


def test_setting_up_again_changes_nothing(memory: Memory, scene: str) -> None:
    set_up(memory, scene)
    memory.update_node("cube_3", mass=0.3)
    memory.update_edge("world", "table", "RT", pose=Pose((0.5, 0.0, 0.1)))
    watch = memory.watch(existing=False)
    set_up(memory, scene)
    assert watch.poll() == []


def test_unknown_scenario_is_a_configuration_error(memory: Memory) -> None:
    with pytest.raises(ConfigError, match="unknown scenario 'hoverin'; did you mean 'hovering'"):
        set_up(memory, "hoverin")
