"""The command `dsr soak`: its exit code, its JSON file and its answers to wrong input."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.soak.cli import app
from dsr.errors import ConfigError


def run(*arguments: str) -> int:
    return CliRunner().invoke(app, arguments, catch_exceptions=False).exit_code


def test_a_soak_of_8_s_writes_its_result(tmp_path: Path) -> None:
    file = tmp_path / "soak.json"
    assert run("--seconds", "8", "--longest", "1", "--json-file", str(file)) == 0
    result = json.loads(file.read_text())
    assert {"writes", "lost", "diverged", "heal_s_max", "blocked_s_max", "faults"} <= result.keys()
    assert result["writes"] > 100 and result["lost"] == result["diverged"] == 0 and result["faults"]


def test_races_write_their_result(tmp_path: Path) -> None:
    file = tmp_path / "races.json"
    assert run("--races", "2", "--json-file", str(file)) == 0
    assert json.loads(file.read_text())["create"]["equal"] == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--fault", "cutt"], "did you mean 'cut'"),
        (["--fault", "hub", "--machines", "1"], "needs --machines 2"),
        (["--json-file", "/proc/none/x.json"], "cannot be written"),
    ],
)
def test_wrong_input_is_refused_before_anything_starts(arguments: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        run(*arguments)
