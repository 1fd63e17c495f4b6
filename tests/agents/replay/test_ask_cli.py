"""`dsr ask` of a recording and of a running system: text, JSON, exit codes, and what-if questions."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import pytest
from typer.testing import CliRunner

import dsr
from agents.replay.ask_cli import app
from dsr import Pose
from dsr.cli.common import console
from dsr.vocabulary.what_if import SERVICE, Answer, encode_answer


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "runtime").mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))
    monkeypatch.setattr(console, "width", 200)


def run(*arguments: str) -> Any:
    return CliRunner().invoke(app, list(arguments), catch_exceptions=False)


def test_a_recording_answers_as_of_a_time(hovering: Path) -> None:
    result = run("where is cube_3?", str(hovering), "--at", "6", "--evidence")
    assert result.exit_code == 0
    lines = result.stdout.splitlines()
    assert lines[0] == "cube_3 rests on table, at x 0.36 m, y 0.00 m."
    assert lines[1].strip() == f"perceived: {lines[0]}" and any("position_deviation_m" in line for line in lines)
    found = json.loads(run("where was cube_3 at 3 s", str(hovering), "--json").stdout)
    assert found["names"] == ["table"] and found["evidence"][0]["evidence"]["kind"] == "on"


def test_what_is_not_understood_is_told_and_the_exit_code_is_1(hovering: Path) -> None:
    result = run("where is cube_3 # today", str(hovering))
    assert result.exit_code == 1
    assert result.stdout.splitlines()[0] == "'# today' is not understood there."
    assert result.stdout.count("understood: ") == 3


def test_nobody_to_ask() -> None:
    with pytest.raises(dsr.ConfigError, match="no graph"):
        run()


def test_a_recording_cannot_be_simulated(hovering: Path) -> None:
    assert "a file cannot be simulated" in run("what if cube_3 were removed?", str(hovering)).stdout


def test_a_running_system_is_asked_and_simulates() -> None:
    with dsr.connect("kitchen", agent="me", must_exist=False) as memory:
        for name, kind in (("world", "world"), ("cup", "cup"), ("plate", "box")):
            memory.add_node(name, kind)
        memory.add_edge("world", "cup", "Virtual_RT", pose=Pose((0.1, 0.2, 0.05)))
        memory.add_edge("cup", "plate", "on", source="contact")
        fallen = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
        found = Answer(seconds=1.0, at_rest=True, poses={"cup": fallen}, moved={"cup": 0.5}, on_floor=("cup",))
        service = memory.transport.serve(memory.keys.service(SERVICE), lambda *_: encode_answer(found))
        text = run("what if plate were removed?").stdout
        service.close()
        assert text == "cup would rest on the floor then, 0.50 m from where it is now.\n"
        assert "where is the cup?" in run().stdout
        assert "where is the cup?" in json.loads(run("--json").stdout)
        assert msgspec.json.decode(run("is the cup on the plate?", "--json").stdout)["verdict"] is True
