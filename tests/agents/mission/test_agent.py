"""The mission: one intention at the start."""

from __future__ import annotations

from typing import Any

import pytest

from agents.mission import Mission
from dsr import ConfigError
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.status import State
from dsr.runtime.system import AgentSpec

GOAL = "on(cube_3,cube_4)"


def start(**config: Any) -> Lockstep:
    return Lockstep([AgentSpec("mission", Mission, config)], strict=True)


def test_the_intention_comes_at_once_whatever_is_believed() -> None:
    with start(goal=GOAL, maintain=True, priority=2) as lockstep:
        lockstep.run_for(0.5)
        [intention] = lockstep.memory.nodes("intention")
        expected = {"goal": GOAL, "maintain": True, "priority": 2, "status": "wanted"}
        assert (intention.name, dict(intention)) == ("intention_0", expected)
        assert lockstep.memory.get_edge("mind", "intention_0", "has") is not None


def test_without_a_planner_its_status_says_so_until_the_intention_is_over() -> None:
    with start(goal=GOAL) as lockstep:
        lockstep.run_for(1.0)
        status = lockstep.runner("mission").status()
        nobody = "no agent 'planner' runs, which would pursue it"
        assert (status.state, status.last_error) == (State.DEGRADED, nobody)
        lockstep.memory.update_node("intention_0", status="reached")
        lockstep.run_for(1.0)
        assert lockstep.runner("mission").status().state is State.READY


def test_it_comes_once_only_even_after_it_was_removed() -> None:
    with start(goal=GOAL) as lockstep:
        lockstep.run_for(1.0)
        lockstep.memory.remove_node("intention_0")
        lockstep.run_for(2.0)
        assert lockstep.memory.nodes("intention") == []


def test_a_restart_finds_what_was_written() -> None:
    with start(goal=GOAL) as lockstep:
        lockstep.run_for(1.0)
        lockstep.kill("mission")
        lockstep.restart("mission")
        lockstep.run_for(1.0)
        assert len(lockstep.memory.nodes("intention")) == 1


def test_the_delay_is_kept() -> None:
    with start(goal=GOAL, delay=2.0) as lockstep:
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
