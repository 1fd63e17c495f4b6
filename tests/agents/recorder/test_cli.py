"""`dsr record` as a process beside a running graph."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from typer.testing import CliRunner

import dsr
from agents.recorder.cli import app
from agents.replay import ReplayedGraph
from dsr.clock import WALL_CLOCK
from dsr.errors import ConfigError

COMMAND = [sys.executable, "-c", "from agents.recorder.cli import app; app()"]


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "runtime").mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM, None])
def test_the_running_graph_is_recorded_until_told_to_end(tmp_path: Path, ending: signal.Signals | None) -> None:
    folder = tmp_path / "run"
    options = ["--folder", str(folder), *([] if ending else ["--for", "5"])]
    with dsr.connect("scene", agent="owner") as memory:
        memory.add_node("world", "world")
        memory.add_node("cube_3", "cube", mass=0.0)
        with subprocess.Popen(COMMAND + options, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout
            assert "recording graph scene" in process.stdout.readline()
            while not (folder / "recording.mcap").exists():
                WALL_CLOCK.wait(threading.Event(), 0.05)
            for step in range(30):
                memory.update_node("cube_3", mass=float(step))
                WALL_CLOCK.wait(threading.Event(), 0.05)
            if ending:
                process.send_signal(ending)
            output = process.stdout.read()
            assert process.wait(10) == 0
    assert "messages in" in output and "recovered" not in output
    graph = ReplayedGraph(folder)
    found = graph.at(graph.duration)
    assert found.node("cube_3")["mass"] == 29.0 or not ending
    assert "world" in found


def test_without_a_running_graph_it_says_so() -> None:
    with pytest.raises(ConfigError, match="no graph"):
        CliRunner().invoke(app, [], catch_exceptions=False)
    with pytest.raises(ConfigError, match="no graph 'x' runs"):
        CliRunner().invoke(app, ["-g", "x"], catch_exceptions=False)
