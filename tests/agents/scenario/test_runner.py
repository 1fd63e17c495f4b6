"""Runs in lockstep: start, kills, repeatability; with small stand-ins for the agents."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import msgspec
import numpy as np
import pytest

from agents.scenario.format.scenario import parse_scenario
from agents.scenario.judge.result import Result
from agents.scenario.run import runner
from agents.scenario.run.runner import run_lockstep
from agents.scenario.run.staging import Run
from agents.viewer.agent import Viewer
from dsr.agent import Access, Agent
from dsr.errors import AgentError
from dsr.math3d.transforms import Pose
from dsr.runtime.system import AgentSpec, System
from dsr.vocabulary.scenario_start import Start, start_key

SCENARIO = """
name = "short"
title = "One cube"
duration = 4.0
settle = 1.0

[[object]]
name = "cube_1"
marker_id = 1
position = [0.3, 0.0, 0.02]

[[event]]
at = 1.5
do = "kill"
agent = "simulation_handler"

[[expect]]
check = "belief_closer_than_percept"

[[expect]]
check = "recovered"
agent = "simulation_handler"
within = 2.0
"""
TRUE = (0.3, 0.0, 0.02, 0.0, 0.0, 0.0, 1.0)


class StandInPlant(Agent):
    """Tells the truth, and what start it heard."""

    name = "plant"
    rate_hz = 20.0
    uses_memory = False
    starts: ClassVar[list[float]] = []
    fulfilled: ClassVar[dict[int, float]] = {}
    """Conditions of events: how long after the start they come true."""

    def setup(self) -> None:
        self.starts.clear()
        self.bus.subscribe(start_key(self.keys), self._on_start)

    def tick(self, now: float) -> None:
        since = now - self.starts[0] if self.starts else -1.0
        moves = {number: (time, time) for number, time in self.fulfilled.items() if time <= since}
        truth = {"stamp": now, "objects": {"cube_1": TRUE}, "moves": moves}
        self.bus.publish(self.keys.truth(), msgspec.msgpack.encode(truth))

    def _on_start(self, key: str, payload: bytes) -> None:
        self.starts.append(msgspec.msgpack.decode(payload, type=Start).stamp)


class Believer(Agent):
    """Sees the cube 10 mm too high with noise, believes it where it is."""

    name = "simulation_handler"
    rate_hz = 10.0
    writes = Access(nodes=("world", "cube"), edges=("RT", "Virtual_RT"), attributes=("perceived",))

    def setup(self) -> None:
        self.random = np.random.default_rng(self.seed)

    def tick(self, now: float) -> None:
        x, y, z = np.array(TRUE[:3]) + self.random.normal(0, 0.001, 3)
        self.memory.add_node("world", "world")
        self.memory.add_node("cube_1", "cube", perceived=True)
        self.memory.add_edge("world", "cube_1", "RT", pose=Pose((x, y, z + 0.01), stamp=now))
        self.memory.add_edge("world", "cube_1", "Virtual_RT", pose=Pose((x, y, 0.02), stamp=now))


class Broken(Agent):
    """Never has a good tick."""

    name = "broken"

    def tick(self, now: float) -> None:
        raise RuntimeError("no hope")


@pytest.fixture
def agents(monkeypatch: pytest.MonkeyPatch) -> list[AgentSpec]:
    specs = [AgentSpec(kind.name, kind) for kind in (StandInPlant, Believer)]
    monkeypatch.setattr(runner, "staged_system", lambda run: System("test", tuple(specs)))
    return specs


def play(seed: int = 0) -> Result:
    return run_lockstep(Run(scenario=parse_scenario(SCENARIO), file=Path("short.toml"), seed=seed))


@pytest.mark.usefixtures("agents")
def test_a_run_is_judged_and_repeatable():
    first, again, other = play(1), play(1), play(2)
    assert first == again
    assert first.passed and first.mode == "lockstep" and first.seed == 1
    assert first.metrics["percept_error_cube_1_m"] == pytest.approx(0.01, abs=0.001)
    assert first.metrics["belief_error_cube_1_m"] != other.metrics["belief_error_cube_1_m"]
    assert first.metrics["samples"] == 61


def test_the_viewer_runs_along_and_changes_nothing(agents: list[AgentSpec], tmp_path: Path):
    agents.append(AgentSpec("viewer", Viewer, config={"folder": str(tmp_path), "awaits_start": True}))
    seen = run_lockstep(Run(scenario=parse_scenario(SCENARIO), file=Path("short.toml"), seed=1, viewer=True))
    assert (tmp_path / "recording.rrd").stat().st_size > 10_000
    assert seen == play(1)


@pytest.mark.usefixtures("agents")
def test_the_start_is_told_repeatedly_and_lies_ahead():
    play()
    assert len(set(StandInPlant.starts)) == 1
    assert len(StandInPlant.starts) >= 4


@pytest.mark.usefixtures("agents")
def test_a_killed_agent_is_started_again():
    recovered = play().expectations[1]
    assert recovered.passed
    assert recovered.actual == "ready after 1.0 s"


@pytest.mark.usefixtures("agents")
def test_an_agent_is_killed_once_when_the_plant_says_that_the_condition_holds(monkeypatch: pytest.MonkeyPatch):
    text = SCENARIO.replace("at = 1.5", "when = 'resting(cube_1)'")
    waiting = run_lockstep(Run(scenario=parse_scenario(text), file=Path("short.toml")))
    assert waiting.expectations[1].actual == "event 1 (kill) has not begun"
    assert "event 1 (kill) has not begun" in waiting.notes
    monkeypatch.setattr(StandInPlant, "fulfilled", {1: 2.0})
    killed = run_lockstep(Run(scenario=parse_scenario(text), file=Path("short.toml")))
    assert killed.expectations[1].passed and killed.notes == []
    assert killed.expectations[1].actual == "ready after 1.1 s", "0.05 s until it is known, 1 s until it is restarted"


@pytest.mark.usefixtures("agents")
def test_what_is_being_restarted_or_does_not_run_in_lockstep_cannot_be_killed():
    kills = "".join(
        f"[[event]]\nat = {at}\ndo = 'kill'\nagent = '{agent}'\n"
        for at, agent in ((1.8, "simulation_handler"), (1.9, "viewer"), (2.7, "simulation_handler"))
    )
    result = run_lockstep(Run(scenario=parse_scenario(SCENARIO + kills), file=Path("short.toml")))
    assert result.expectations[1].actual == "ready after 1.0 s"


def test_an_agent_that_never_gets_ready_is_named(agents: list[AgentSpec]):
    agents.append(AgentSpec("broken", Broken))
    with pytest.raises(AgentError, match="agent 'broken': 25 ticks failed"):
        play()


def test_an_observer_follows_the_time(agents: list[AgentSpec]):
    seen: list[float] = []

    class Observer(runner.Silent):
        def running(self, elapsed: float) -> None:
            seen.append(elapsed)

    run_lockstep(Run(scenario=parse_scenario(SCENARIO), file=Path("short.toml")), Observer())
    assert seen == sorted(seen)
    assert seen[0] < 0 and seen[-1] >= 4.0
