"""`dsr tell` of a recording at a time, of a saved graph, and of a running system."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import dsr
from agents.replay.tell_cli import app
from dsr import Pose
from dsr.cli.common import console
from dsr.persistence.content import GraphContent
from dsr.persistence.files import write_graph
from dsr.timeline import Chronicle


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "runtime").mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))
    monkeypatch.setattr(console, "width", 200)


def run(*arguments: str) -> Any:
    return CliRunner().invoke(app, list(arguments), catch_exceptions=False)


def test_a_recording_is_told_as_of_a_time(hovering: Path) -> None:
    early, late = (run(str(hovering), "--at", at, "--json").stdout for at in ("1", "6"))
    assert json.loads(early) != json.loads(late)
    text = run(str(hovering), "--at", "6", "--since", "0").stdout
    assert "Where things are\n  cube_" in text and "\nWhat happened\n" in text
    assert "\n  5.7 s ago, cube_3 appeared.\n" in text


def test_only_what_is_about_a_name_and_lately(hovering: Path) -> None:
    told = json.loads(run(str(hovering), "--about", "cube_3", "--since", "-0.01", "--json").stdout)
    assert told and all("cube_3" in one["names"] for one in told)
    assert {one["subject"] for one in told} <= {"place", "holding", "surprise"}


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--at", "9999"], r"--at 9999: expected 0 to \d+\.\d s, where the recording ends"),
        (["--at", "2", "--since", "3"], r"--since 3: expected at most \d+\.\d, of which is told"),
        (["--graph", "kitchen"], "a file is one graph"),
        (["--about", "cub_3"], "there is no 'cub_3'; did you mean 'cube_3'"),
        (["--person", "sally"], "there is no person 'sally'"),
    ],
)
def test_what_a_recording_cannot_tell(hovering: Path, options: list[str], expected: str) -> None:
    with pytest.raises(dsr.ConfigError, match=expected):
        run(str(hovering), *options)


def fill(memory: dsr.Memory, now: float) -> None:
    memory.add_node("world", "world")
    memory.add_node("table", "table", size=(1.0, 1.0, 0.04))
    memory.add_edge("world", "table", "RT", pose=Pose())
    memory.add_node("cup", "cup", perceived=True, last_seen=now)
    memory.add_edge("world", "cup", "Virtual_RT", pose=Pose((0.1, 0.2, 0.05)))
    memory.add_edge("cup", "table", "on")


def test_a_saved_graph_is_told_as_of_its_newest_time(tmp_path: Path) -> None:
    file = tmp_path / "kitchen.json"
    with dsr.connect("kitchen", agent="me", must_exist=False) as memory:
        fill(memory, 5000.0)
        memory.add_node("ball", "ball", perceived=False, last_seen=4990.0)
        Chronicle(memory, "me").happened("Pick", ("ball", "hand"), 4991.0, confidence=0.5)
        write_graph(GraphContent.of(memory), file)
    text = run(str(file)).stdout
    assert "  cup rests on table, at x 0.10 m, y 0.20 m." in text
    assert "  9.0 s ago, probably (0.50), hand picked ball up." in text
    for option, expected in (("--at", "a saved graph is of one moment"), ("--since", "a system has no beginning")):
        with pytest.raises(dsr.ConfigError, match=expected):
            run(str(file), option, "3")


def test_a_running_system_is_told_as_of_now_and_from_a_persons_view() -> None:
    with dsr.connect("kitchen", agent="me", must_exist=False) as memory:
        now = memory.clock.now()
        fill(memory, now)
        memory.add_node("sally", "person", perceived=True, last_seen=now)
        result = run("--json")
        assert json.loads(result.stdout)[0]["text"] == "cup rests on table, at x 0.10 m, y 0.20 m."
        assert "no timeline is there" in run().stderr
        memory.create_world("view_of_sally")
        assert "sally has never seen cup." in run("--as", "sally").stdout
        with pytest.raises(dsr.ConfigError, match="--at is a time of a recording"):
            run("--at", "3")
        with pytest.raises(dsr.ConfigError, match="--since 3: expected seconds before now"):
            run("--since", "3")
    with pytest.raises(dsr.ConfigError, match="no graph"):
        run()
