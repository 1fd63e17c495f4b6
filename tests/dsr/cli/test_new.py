"""`dsr new`: what it makes works as it is, where nothing but the installed package is."""

from __future__ import annotations

import errno
import importlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

import dsr
from agents.scenario.check.file_check import Findings, look_through
from agents.scenario.judge.result import Result
from agents.scenario.run.runner import run_lockstep
from agents.scenario.run.staging import make_run
from dsr.cli.new import app, check_package_name, make_package
from dsr.errors import ConfigError

ROOT = Path(__file__).parents[3]


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["lab_bot"])
    assert result.exit_code == 0 and "lab_bot/etc/systems/lab_bot.toml" in result.output
    monkeypatch.chdir(tmp_path / "lab_bot")
    monkeypatch.syspath_prepend(tmp_path / "lab_bot")
    yield tmp_path / "lab_bot"
    for name in [name for name in sys.modules if name.partition(".")[0] == "lab_bot"]:
        del sys.modules[name]


def test_no_placeholder_is_left(made: Path) -> None:
    files = [file for file in made.rglob("*") if file.is_file()]
    assert len(files) == 9
    assert not any("my_robot" in str(file) or "my_robot" in file.read_text() for file in files)


def test_the_scenario_is_sound_and_holds(made: Path) -> None:
    assert look_through("lab_bot") == Findings()
    result: Result = run_lockstep(make_run("lab_bot", sensor="pixels", seed=3))
    assert [verdict.text for verdict in result.expectations if not verdict.passed] == []
    assert result.expectations


def test_its_tests_pass(made: Path) -> None:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-o", "addopts=", "tests"]
    result = subprocess.run(command, cwd=made, capture_output=True, text=True, check=False)
    assert result.returncode == 0 and "1 passed" in result.stdout, result.stdout


def test_its_command_says_if_the_system_does_not_run(made: Path) -> None:
    command = importlib.import_module("lab_bot.cli").app
    result = CliRunner().invoke(command, env={"DSR_GRAPH": "kitchen"})
    assert isinstance(result.exception, ConfigError) and "nobody holds graph 'kitchen'" in str(result.exception)
    with dsr.connect("lab_bot", agent="owner", must_exist=False) as memory:
        memory.add_node("table", "table", seen=2)
        assert CliRunner().invoke(command).output == "2 boxes in view\n"


@pytest.mark.parametrize("name", ["Lab", "1lab", "lab-bot", "class", "json", "agents", "dsr", "a" * 41, ""])
def test_names_that_no_package_can_have_are_refused(name: str) -> None:
    with pytest.raises(ConfigError, match="package"):
        check_package_name(name)


@pytest.mark.parametrize("name", ["demo", "ls", "tabletop", "hovering", "tests", "etc"])
def test_names_of_commands_systems_scenarios_and_of_its_own_folders_are_refused(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [place for place in sys.path if Path(place or ".").resolve() != ROOT])
    with pytest.raises(ConfigError, match="; choose another name"):
        check_package_name(name)


@pytest.mark.parametrize("was_there", [True, False])
def test_what_could_not_be_written_whole_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, was_there: bool
) -> None:
    place = tmp_path / "lab_bot"
    if was_there:
        place.mkdir()
    write = Path.write_text

    def full(file: Path, text: str, encoding: str) -> int:
        if file.name == "test_counter.py":
            raise OSError(errno.ENOSPC, "No space left on device", str(file))
        return write(file, text, encoding=encoding)

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(OSError, match="No space left"):
        make_package("lab_bot", place)
    assert place.exists() == was_there and list(tmp_path.rglob("*")) == [place] * was_there


def test_nothing_is_overwritten(made: Path) -> None:
    result = CliRunner().invoke(app, ["other_bot", "--folder", str(made)])
    assert isinstance(result.exception, ConfigError) and "not empty" in str(result.exception)
