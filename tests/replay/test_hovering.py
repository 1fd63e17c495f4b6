"""The built-in hovering scenarios in lockstep: expectations hold, runs repeat."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from agents.scenario.format.expectations import Windowed
from agents.scenario.judge.result import Result
from agents.scenario.run import runner
from agents.scenario.run.runner import run_lockstep
from agents.scenario.run.staging import Run, make_run

COUNTS = ["hovering_1", "hovering", "hovering_8", "hovering_20", "hovering_touching", "hovering_wrist"]
STACKS = ["hovering_stack_2", "hovering_stack_3", "hovering_unseen_2", "hovering_unseen_3"]
WATCHED = 5.0
"""s that are judged here, of the 30 s in the files"""


def shortened(name: str, **options: Any) -> Run:
    """The run with an earlier end; nothing happens after `settle` in the scenarios that this is used for."""
    run = make_run(name, **options)
    scenario = msgspec.structs.replace(run.scenario, duration=run.scenario.settle + WATCHED)
    return msgspec.structs.replace(run, scenario=scenario)


def failures(result: Result) -> list[str]:
    return [f"{verdict.text}: {verdict.actual}" for verdict in result.expectations if not verdict.passed]


@pytest.mark.parametrize("name", COUNTS + STACKS)
def test_percepts_hover_and_beliefs_rest(name: str):
    result = run_lockstep(shortened(name, seed=1, sensor="poses"))
    assert failures(result) == []
    assert result.passed


def test_in_rendered_images_too():
    run = make_run("hovering", seed=2)
    scenario = msgspec.structs.replace(run.scenario, settle=3.0, duration=6.0)
    result = run_lockstep(msgspec.structs.replace(run, scenario=scenario))
    assert failures(result) == []
    assert result.metrics["objects_perceived"] == 4
    for cube in ("cube_3", "cube_4", "cube_5", "cube_6"):
        assert result.metrics[f"percept_error_{cube}_m"] > 0.004
        assert result.metrics[f"belief_error_{cube}_m"] < 0.002


@pytest.mark.parametrize("name", ["hovering_blackout", "hovering_kill"])
def test_beliefs_outlive_a_covered_camera_and_a_killed_simulator(name: str):
    assert failures(run_lockstep(make_run(name, seed=1, sensor="poses"))) == []


@pytest.mark.parametrize("sensor", ["poses", "pixels"])
def test_two_runs_of_a_seed_are_equal(sensor: str):
    first, again = (run_lockstep(_brief(shortened("hovering_1", seed=5, sensor=sensor))) for _ in range(2))
    assert first == again
    assert first.metrics["samples"] > 15


def test_two_seeds_differ():
    first, other = (run_lockstep(_brief(shortened("hovering_1", seed=s, sensor="poses"))) for s in (5, 6))
    assert first.metrics != other.metrics


def _brief(run: Run) -> Run:
    """Two seconds of it, without expectations."""
    scenario = msgspec.structs.replace(run.scenario, settle=1.0, duration=2.0, expectations=[])
    return msgspec.structs.replace(run, scenario=scenario)


def test_the_judge_notices_when_the_belief_is_switched_off(monkeypatch: pytest.MonkeyPatch):
    run = _brief(shortened("hovering_1", seed=1, sensor="poses"))
    windowed = [check for check in make_run("hovering_1").scenario.expectations if isinstance(check, Windowed)]
    scenario = msgspec.structs.replace(run.scenario, expectations=windowed)
    staged = runner.staged_system
    monkeypatch.setattr(runner, "staged_system", lambda run: staged(run).without("simulation_handler"))
    result = run_lockstep(msgspec.structs.replace(run, scenario=scenario))
    assert len(failures(result)) == len(windowed) == 3
