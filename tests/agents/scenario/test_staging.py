"""Agents are configured for the scenario and the run."""

from __future__ import annotations

from pathlib import Path

import pytest

from agents.scenario.format import scenario_files
from agents.scenario.staging import Policy, make_run, staged_system


def test_the_mission_is_told_to_its_agent_and_the_policy_to_the_belief():
    system = staged_system(make_run("full_tower", sensor="poses", policy="algorithm1"))
    mission = system.agent("mission").config
    assert mission["goal"] == "on(cube_3, cube_4) & on(cube_6, cube_5)" and mission["maintain"] is True
    assert system.agent("simulation_handler").config["policy"] == "algorithm1"
    assert system.agent("plant").config["sensor"] == "poses"


def test_the_published_policy_is_a_reasoner_of_its_own():
    config = staged_system(make_run("hovering", policy="published")).agent("simulation_handler").config
    assert config["reasoner"] == "published" and "policy" not in config


def test_without_a_mission_nobody_asks_for_anything():
    system = staged_system(make_run("cubes_swapped"))
    assert "mission" not in {agent.name for agent in system.agents}
    assert "policy" not in system.agent("simulation_handler").config


@pytest.mark.parametrize("policy", ["hypotheses", "algorithm1", "published"])
def test_all_policies_are_known_to_the_belief(policy: Policy, tmp_path: Path):
    staged_system(make_run("blackout_put", policy=policy, folder=tmp_path))


def test_the_scenarios_of_expectation_violation_are_there_and_differ_by_seed():
    wanted = {
        *("full_tower", "simulation_error", "tower_disassembly", "three_cube_tower"),
        *("tower_moved_while_building", "cubes_swapped", "cube_removed", "blackout_put", "tower_toppled"),
        *("cube_rotated", "false_percept", "scale_tower_5", "scale_20_cubes", "three_in_a_row"),
    }
    assert wanted <= set(scenario_files())
    for name in wanted:
        scenario = make_run(name).scenario
        assert scenario.random.position > 0.0 and scenario.random.yaw > 0.0, name
        assert any(not event.by_runner for event in scenario.events), name
