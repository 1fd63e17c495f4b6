"""The whole system in lockstep builds two towers from a mission: plant, arm, percepts, belief, planner."""

from __future__ import annotations

from pathlib import Path

import pytest

from agents.scenario.judge.result import Result
from agents.scenario.run.runner import run_lockstep
from agents.scenario.run.staging import make_run

SCENE = """
name = "two_towers"
title = "Two towers from four cubes"
duration = {duration}
settle = 4.0
[mission]
goal = "on(cube_3,cube_4) & on(cube_6,cube_5)"
"""
CUBE = """
[[object]]
name = "cube_{number}"
marker_id = {number}
position = [{x}, {y}, 0.02]
"""
EXPECTED = """
[[expect]]
check = "true_relations"
present = [["cube_3", "cube_4"], ["cube_6", "cube_5"], ["cube_4", "table"], ["cube_5", "table"]]
[[expect]]
check = "edges"
present = [["cube_3", "cube_4"], ["cube_6", "cube_5"], ["cube_4", "table"], ["cube_5", "table"]]
[[expect]]
check = "mission"
[[expect]]
check = "belief_error"
"""
CUBES = {3: (0.42, 0.08), 4: (0.30, 0.08), 5: (0.30, -0.08), 6: (0.42, -0.08)}


def play(folder: Path, duration: float = 45.0, seed: int = 0) -> Result:
    file = folder / "two_towers.toml"
    cubes = "".join(CUBE.format(number=number, x=x, y=y) for number, (x, y) in CUBES.items())
    file.write_text(SCENE.format(duration=duration) + cubes + EXPECTED, encoding="utf-8")
    return run_lockstep(make_run(file, sensor="poses", seed=seed))


@pytest.mark.parametrize("seed", [0, 1])
def test_two_towers_are_built_at_the_first_attempt(tmp_path: Path, seed: int) -> None:
    result = play(tmp_path, seed=seed)
    assert result.passed, [(finding.text, finding.actual) for finding in result.expectations if not finding.passed]
    assert result.metrics.get("replans", 0) == 0


def test_two_runs_of_one_seed_are_equal_although_the_solver_is_a_process(tmp_path: Path) -> None:
    assert play(tmp_path, 12.0).metrics == play(tmp_path, 12.0).metrics
