"""`dsr save`, `dsr load`, `dsr convert` and `dsr run --load` on running graphs."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from dsr import ConfigError, Memory
from dsr.persistence.content import GraphContent
from dsr.persistence.files import read_graph

ROOT = Path(__file__).parents[3]
BREAKFAST = ROOT / "etc" / "graphs" / "breakfast.json"
KITCHEN = ROOT / "tests" / "dsr" / "persistence" / "kitchen.cortex.json"
SYSTEMS = ROOT / "tests" / "dsr" / "runtime" / "systems"


def test_what_is_saved_is_what_runs_and_is_the_same_each_time(
    memory: Memory, cli: Callable[..., str], tmp_path: Path
) -> None:
    first, second = tmp_path / "1.json", tmp_path / "2.json"
    assert "saved 4 nodes, 5 edges" in cli("save", str(first))
    cli("save", str(second))
    assert first.read_bytes() == second.read_bytes()
    content, now = read_graph(first), GraphContent.of(memory)
    assert (content.graph, content.nodes, content.edges) == ("scene", now.nodes, now.edges)


def test_what_is_loaded_is_there_when_the_command_ends(memory: Memory, cli: Callable[..., str]) -> None:
    assert "loaded 5 nodes, 6 edges into graph scene" in cli("load", str(BREAKFAST))
    assert memory.node("cup_1")["fill_level"] == 0.5
    assert memory.transform("world", "plate_1").t == pytest.approx((0.5, -0.2, 0.71))
    assert "cube_3" in memory


def test_loading_can_replace_everything(memory: Memory, cli: Callable[..., str], tmp_path: Path) -> None:
    cli("save", str(tmp_path / "before.json"))
    cli("load", str(BREAKFAST), "--replace")
    assert "cube_3" not in memory and "cup_1" in memory
    cli("load", str(tmp_path / "before.json"), "--replace")
    cli("save", str(tmp_path / "after.json"))
    assert (tmp_path / "after.json").read_bytes() == (tmp_path / "before.json").read_bytes()


@pytest.mark.parametrize("command", ["save", "load"])
def test_nothing_is_saved_or_loaded_where_nobody_is(cli: Callable[..., str], tmp_path: Path, command: str) -> None:
    file = tmp_path / "scene.json"
    file.write_bytes(BREAKFAST.read_bytes())
    with pytest.raises(ConfigError, match=r"nobody holds graph 'nowhere', or the router tcp/127.0.0.1:1 cannot"):
        cli(command, str(file), "--graph", "nowhere", "--connect", "tcp/127.0.0.1:1")
    assert file.read_bytes() == BREAKFAST.read_bytes()


def test_a_wrong_file_changes_nothing(memory: Memory, cli: Callable[..., str], tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.json"
    wrong.write_text(BREAKFAST.read_text().replace('"plate_1", "dst"', '"plate", "dst"'))
    with pytest.raises(ConfigError, match=r"wrong.json:31:13: edges\[5\].src: no node 'plate' in this file"):
        cli("load", str(wrong))
    assert "cup_1" not in memory


def test_files_of_cortex_are_loaded_and_saved(memory: Memory, cli: Callable[..., str], tmp_path: Path) -> None:
    cli("load", str(KITCHEN), "--replace")
    assert memory.node("Viriato_robot")["port"] == 12238
    cli("save", str(tmp_path / "out.json"), "--format", "cortex")
    symbols = json.loads((tmp_path / "out.json").read_text())["DSRModel"]["symbols"]
    assert symbols["200"]["name"] == "Viriato robot"


def test_files_are_converted_without_a_running_graph(cli: Callable[..., str], tmp_path: Path) -> None:
    ours, theirs = tmp_path / "ours.json", tmp_path / "theirs.json"
    assert "wrote 4 nodes, 5 edges" in cli("convert", str(KITCHEN), str(ours))
    cli("convert", str(ours), str(theirs), "--format", "cortex")
    assert json.loads(theirs.read_text())["DSRModel"]["symbols"].keys() == {"100", "200", "204", str(2**64 - 1)}


def test_a_system_starts_with_the_content_of_a_file(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "dsr.cli"]
    options = ["--load", str(BREAKFAST), "--graph", "kitchen", "--folder", str(tmp_path / "run")]
    with subprocess.Popen(
        [*command, "run", str(SYSTEMS / "counters.toml"), *options], stdout=subprocess.PIPE, text=True
    ) as system:
        lines = iter(system.stdout.readline, "") if system.stdout else iter(())
        assert "graph kitchen" in next(lines)
        assert any("first: ready" in line for line in lines)
        subprocess.run([*command, "save", str(tmp_path / "now.json")], check=True, timeout=60)
        system.terminate()
        assert system.wait(20) == 0
    assert read_graph(tmp_path / "now.json").nodes["cup_1"] == read_graph(BREAKFAST).nodes["cup_1"]
    assert "cube_1" in read_graph(tmp_path / "now.json").nodes


def test_a_system_that_is_refused_leaves_no_run_folder(tmp_path: Path) -> None:
    (tmp_path / "state").write_text("no folder")
    command = [sys.executable, "-m", "dsr.cli", "run", str(SYSTEMS / "counters.toml"), "--state", "state"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, cwd=tmp_path)
    assert (result.returncode, result.stderr) == (2, "state folder state cannot be used: it is no folder\n")
    assert not list((tmp_path / "runs").iterdir())


def test_a_system_does_not_start_with_a_wrong_file(tmp_path: Path) -> None:
    (tmp_path / "wrong.json").write_text("{")
    command = [sys.executable, "-m", "dsr.cli", "run", str(SYSTEMS / "counters.toml"), "--load"]
    result = subprocess.run(
        [*command, str(tmp_path / "wrong.json")], capture_output=True, text=True, timeout=60, check=False, cwd=tmp_path
    )
    assert result.returncode == 2
    assert "wrong.json:1:2: not valid JSON" in result.stderr
    assert not (tmp_path / "runs").exists()
