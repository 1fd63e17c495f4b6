"""Agents are configured for the scenario and the run."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from agents.scenario.format.scenario import find_scenario, scenario_files
from agents.scenario.run.staging import Policy, make_run, staged_system
from dsr.errors import ConfigError


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


def test_hands_are_found_by_colour_if_the_run_says_so():
    system = staged_system(make_run("hand_carries", hands="colour"))
    assert system.agent("hand_tracker").config["finder"] == "colour"
    assert "finder" not in staged_system(make_run("hand_carries")).agent("hand_tracker").config


def test_hands_are_not_found_by_colour_where_the_run_asks_for_a_model_that_is_not_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(ConfigError, match="no model file"):
        staged_system(make_run("hand_carries", hands="model"))


def test_a_way_to_find_hands_is_refused_where_no_hand_would_be_looked_for():
    with pytest.raises(ConfigError, match="expected the sensor pixels, not poses"):
        staged_system(make_run("hand_carries", hands="colour", sensor="poses"))
    with pytest.raises(ConfigError, match="no agent 'hand_tracker' in the system 'tabletop'"):
        staged_system(make_run("hovering", hands="colour"))


AGENT = """
from dsr.agent import Agent


class Idler(Agent):
    name = "idler"

    def tick(self, now: float) -> None:
        pass
"""
OWN_SYSTEM = """
graph = "own"
[[agent]]
name = "{name}"
class = "own_idler:Idler"
"""
SCENARIO = """
name = "own"
title = "With a system of its own"
duration = 5.0
system = "{system}"
"""


def write_scenario(folder: Path, system: str, name: str = "idler") -> Path:
    """A scenario beside a folder `systems` with a system and its agent."""
    (folder / "systems").mkdir()
    (folder / "systems" / "own_idler.py").write_text(AGENT)
    (folder / "systems" / "mine.toml").write_text(OWN_SYSTEM.format(name=name))
    (folder / "systems" / "broken.toml").write_text("graph = 'own'\n[[agent]]\nname = 3\n")
    file = folder / "own.toml"
    file.write_text(SCENARIO.format(system=system))
    return file


def test_a_system_may_lie_beside_the_scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("sys.path", list(sys.path))
    file = write_scenario(tmp_path, "systems/mine.toml")
    monkeypatch.chdir("/")
    run = make_run(file)
    system = staged_system(run)
    assert [spec.name for spec in system.agents] == ["idler"] and system.folder == tmp_path / "systems"


def test_a_recording_tells_where_the_system_lies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("sys.path", list(sys.path))
    file = write_scenario(tmp_path, "systems/mine.toml")
    with (tmp_path / "systems" / "mine.toml").open("a") as system:
        system.write('[[agent]]\nname = "recorder"\nclass = "agents.recorder:Recorder"\n')
    config = staged_system(make_run(file, folder=tmp_path / "run")).agent("recorder").config
    assert config["about"]["system"] == str(tmp_path / "systems" / "mine.toml")
    config = staged_system(make_run("hovering", folder=tmp_path / "run")).agent("recorder").config
    assert config["about"]["system"] == "tabletop"


@pytest.mark.parametrize(
    ("system", "message"),
    [
        ("systems/yours.toml", "own.toml:5: system: .*systems/yours.toml.*No such file"),
        ("systems/broken.toml", "own.toml:5: system: .*systems/broken.toml:3: .*name"),
        ("systems", "own.toml:5: system: unknown system 'systems'; valid: .*tabletop.*, or a path ending in '.toml'"),
        ("tabeltop", "own.toml:5: system: unknown system 'tabeltop'; did you mean 'tabletop'?"),
    ],
)
def test_a_system_that_is_not_there_or_none_is_told(tmp_path: Path, system: str, message: str):
    with pytest.raises(ConfigError, match=message):
        make_run(write_scenario(tmp_path, system))


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


def test_an_agent_that_is_killed_shares_no_process(tmp_path: Path):
    """No other agent dies with it; the others share as ever."""
    file = tmp_path / "kills.toml"
    text = find_scenario("hovering_kill").read_text(encoding="utf-8")
    file.write_text(text.replace('agent = "simulation_handler"', 'agent = "surprise"'), encoding="utf-8")
    shared = {spec.process for spec in staged_system(make_run("hovering")).agents if spec.name == "surprise"}
    assert shared == {"shared"}
    processes = staged_system(make_run(file)).processes()
    assert [spec.name for spec in processes["surprise"]] == ["surprise"]
    assert len(processes["shared"]) > 1


def test_a_mission_without_the_solver_is_refused_before_anything_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "up_fast_downward", None)
    staged_system(make_run("hovering"))
    with pytest.raises(ConfigError, match=r"'towers' has a mission for 'planner': .*\[planning\]'"):
        staged_system(make_run("towers"))


@pytest.mark.parametrize("command", [["demo"], ["scenario", "sweep", "towers", "--seeds", "0"]])
def test_commands_refuse_it_and_leave_nothing(command: list[str], tmp_path: Path) -> None:
    program = "import sys\nsys.modules['up_fast_downward'] = None\nfrom dsr.cli import start\nstart()"
    done = subprocess.run(
        [sys.executable, "-c", program, *command], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 2 and done.stderr.endswith("run: pip install 'dsr-memory[planning]'\n")
    assert done.stdout == "" and list(tmp_path.glob("runs/*")) == []
