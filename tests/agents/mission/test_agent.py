"""The mission: one intention, once its things are believed to be somewhere."""

from __future__ import annotations

from typing import Any

import pytest

from agents.mission import Mission
from dsr import ConfigError, Pose
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec

GOAL = "on(cube_3,cube_4)"


def start(**config: Any) -> Lockstep:
    lockstep = Lockstep([AgentSpec("mission", Mission, config)], strict=True)
    lockstep.memory.add_node("world", "world")
    for name in ("cube_3", "cube_4"):
        lockstep.memory.add_node(name, "cube")
    return lockstep


def believe(lockstep: Lockstep, *names: str) -> None:
    for name in names:
        lockstep.memory.add_edge("world", name, "Virtual_RT", pose=Pose())


def test_the_intention_comes_when_all_things_are_believed() -> None:
    with start(goal=GOAL, maintain=True, priority=2) as lockstep:
        believe(lockstep, "cube_3")
        lockstep.run_for(1.0)
        assert lockstep.memory.nodes("intention") == []
        believe(lockstep, "cube_4")
        lockstep.run_for(1.0)
        [intention] = lockstep.memory.nodes("intention")
        expected = {"goal": GOAL, "maintain": True, "priority": 2, "status": "wanted"}
        assert (intention.name, dict(intention)) == ("intention_0", expected)
        assert lockstep.memory.get_edge("mind", "intention_0", "has") is not None


def test_it_comes_once_only_even_after_it_was_removed() -> None:
    with start(goal=GOAL) as lockstep:
        believe(lockstep, "cube_3", "cube_4")
        lockstep.run_for(1.0)
        lockstep.memory.remove_node("intention_0")
        lockstep.run_for(2.0)
        assert lockstep.memory.nodes("intention") == []


def test_a_restart_finds_what_was_written() -> None:
    with start(goal=GOAL) as lockstep:
        believe(lockstep, "cube_3", "cube_4")
        lockstep.run_for(1.0)
        lockstep.kill("mission")
        lockstep.restart("mission")
        lockstep.run_for(1.0)
        assert len(lockstep.memory.nodes("intention")) == 1


def test_the_delay_is_kept() -> None:
    with start(goal=GOAL, delay=2.0) as lockstep:
        believe(lockstep, "cube_3", "cube_4")
        lockstep.run_for(1.9)
        assert lockstep.memory.nodes("intention") == []
        lockstep.run_for(0.6)
        assert len(lockstep.memory.nodes("intention")) == 1


def test_without_a_goal_nothing_happens() -> None:
    with start(goal=" ") as lockstep:
        lockstep.run_for(1.0)
        assert lockstep.memory.nodes("intention") == [] and "mind" not in lockstep.memory


def test_a_wrong_goal_is_a_wrong_configuration() -> None:
    with pytest.raises(ConfigError, match="did you mean 'on'"):
        start(goal="onn(cube_3,cube_4)")
