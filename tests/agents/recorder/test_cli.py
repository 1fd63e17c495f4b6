"""`dsr record` as a process beside a running graph."""

from __future__ import annotations

import random
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from typer.testing import CliRunner

import dsr
from agents.recorder.cli import app
from agents.recorder.reader import read_recording
from agents.replay import ReplayedGraph
from agents.segments import segments
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


def last_mass(folder: Path) -> float:
    """The last value of `cube_3` in a recording that is still being written."""
    graph = ReplayedGraph(folder)
    node = graph.at(graph.duration).get_node("cube_3")
    return 0.0 if node is None else float(node["mass"])


def test_a_kill_in_the_middle_of_a_chunk_leaves_all_that_was_flushed(tmp_path: Path) -> None:
    """Whatever could be read before the kill can be read after it, in files that begin with the whole graph."""
    folder = tmp_path / "run"
    options = ["--folder", str(folder), "--rotate-every", "1.5", "--without", "statuses"]
    with dsr.connect("scene", agent="owner") as memory:
        memory.add_node("cube_3", "cube", mass=0.0)
        with subprocess.Popen(COMMAND + options, stdout=subprocess.DEVNULL) as process:
            step, before = 0, 0.0
            while before < 40.0 or len(list(folder.glob("*.mcap"))) < 3:
                step += 1
                memory.update_node("cube_3", mass=float(step))
                WALL_CLOCK.wait(threading.Event(), 0.05)
                if step % 20 == 0 and (folder / "recording-2.mcap").exists():
                    before = last_mass(folder)
            process.kill()
            process.wait(10)
    for file in segments(folder, "recording.mcap")[:-1]:
        assert ReplayedGraph(file).problems == []
    newest = ReplayedGraph(folder)
    assert "cut off" in newest.problems[0]
    assert before <= newest.at(newest.duration).node("cube_3")["mass"] <= step
    assert not any(record.topic.startswith("status/") for record in read_recording(folder))


def test_a_recording_within_limits_removes_the_oldest(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    options = ["--folder", str(folder), "--rotate-every", "1", "--keep-files", "2", "--for", "8"]
    with dsr.connect("scene", agent="owner") as memory:
        memory.add_node("cube_3", "cube", mass=0.0)
        done = subprocess.run(COMMAND + options, capture_output=True, text=True, check=True)
    left = segments(folder, "recording.mcap")
    assert len(left) == 2 and left[0].name != "recording.mcap"
    assert "cube_3" in ReplayedGraph(left[0]).at(0.5)
    assert all(file.name in done.stdout for file in left)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--only", "imges"], "did you mean 'images'"),
        (["--without", "graph"], "streams without graph"),
        (["--keep-files", "2"], "expected rotate_mb or rotate_period"),
    ],
)
def test_options_that_make_no_sense_are_refused_at_once(options: list[str], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        CliRunner().invoke(app, options, catch_exceptions=False)


def test_without_a_running_graph_it_says_so() -> None:
    with pytest.raises(ConfigError, match="no graph"):
        CliRunner().invoke(app, [], catch_exceptions=False)
    with pytest.raises(ConfigError, match="no graph 'x' runs"):
        CliRunner().invoke(app, ["-g", "x"], catch_exceptions=False)


def recording(folder: Path, before: str = "") -> subprocess.Popen[str]:
    """`dsr record` into a folder, after some statements."""
    program = f"{before}\nfrom dsr.cli import start\nstart()"
    command = [sys.executable, "-c", program, "record", "--folder", str(folder), "-g", "scene"]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_it_says_when_the_system_has_gone_and_goes_on_with_the_next_one(tmp_path: Path) -> None:
    with dsr.connect("scene", agent="owner") as memory:
        memory.add_node("world", "world")
        process = recording(tmp_path / "run")
        assert process.stdout and "recording graph scene" in process.stdout.readline()
    with process:
        assert process.stderr
        assert "nobody else is in the graph any more; waiting for somebody" in process.stderr.readline()
        with dsr.connect("scene", agent="owner") as memory:
            assert process.stderr.readline() == "somebody is in the graph again\n"
            memory.add_node("cube_3", "cube")
            assert memory.replica.wait_until(lambda: memory.replica.synchroniser.delivered, 10.0)
            WALL_CLOCK.wait(threading.Event(), 1.5)
            process.send_signal(signal.SIGINT)
            assert process.wait(20) == 0
    graph = ReplayedGraph(tmp_path / "run")
    assert {"world", "cube_3"} <= {node.name for node in graph.at(graph.duration).nodes()}


def test_lost_messages_are_counted_and_make_it_fail(tmp_path: Path) -> None:
    limited = "import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (30_000, 30_000))"
    with dsr.connect("scene", agent="owner") as memory, recording(tmp_path / "run", limited) as process:
        memory.add_node("cube_3", "cube", explanation="")
        assert process.stdout and process.stderr
        assert "recording graph scene" in process.stdout.readline()
        for step in range(60):
            memory.update_node("cube_3", explanation=random.Random(step).randbytes(1000).hex())
            WALL_CLOCK.wait(threading.Event(), 0.05)
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 1
        assert re.search(r"^[1-9]\d* messages were lost: they are not in the recording$", process.stderr.read(), re.M)


def test_a_graph_that_nobody_holds_is_not_recorded(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    program = ["-m", "dsr.cli", "record", "-g", "scene", "--connect", "tcp/127.0.0.1:1", "--folder", str(folder)]
    done = subprocess.run([sys.executable, *program], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr.endswith("nobody holds graph 'scene', or the router tcp/127.0.0.1:1 cannot be reached\n")
    assert done.stdout == "" and not folder.exists()
