"""`dsr run --detach`, `dsr logs`, `dsr stop`: a system that needs no terminal."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from dsr.network.rendezvous import graphs, read_claim

SYSTEMS = Path(__file__).parents[1] / "runtime" / "systems"


def dsr(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "dsr.cli.main", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


@pytest.fixture
def detached(tmp_path: Path, private_runtime_dir: Path) -> Path:
    folder = tmp_path / "run"
    result = dsr("run", str(SYSTEMS / "counters.toml"), "--detach", "--folder", str(folder))
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith("graph counters, logs and recordings in ") and "dsr stop" in result.stdout
    return folder


def test_it_goes_on_until_it_is_stopped(detached: Path) -> None:
    claim = read_claim("counters")
    assert claim is not None and claim.folder == detached
    assert dsr("ls").returncode == 0
    result = dsr("stop")
    assert result.returncode == 0 and "graph counters has ended" in result.stdout
    assert read_claim("counters") is None and graphs() == []
    assert "no graph runs" in dsr("stop").stderr


def test_logs_are_shown_and_followed_to_the_end(detached: Path) -> None:
    assert "run: first: ready" in dsr("logs", "run").stdout
    assert "no log of 'frist'" in dsr("logs", "frist").stderr
    rows = [json.loads(line) for line in dsr("logs", "run", "--json").stdout.splitlines()]
    assert {"agent": "run", "text": "first: ready"} in rows
    assert {line.partition(":")[0] for line in dsr("logs", "--lines", "1").stdout.splitlines()} <= {
        "first", "second", "run"
    }  # fmt: skip
    command = [sys.executable, "-m", "dsr.cli.main", "logs", "run", "-n", "1", "--follow"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout and process.stdout.readline() == "run: all agents are ready\n"
        assert dsr("stop").returncode == 0
        assert process.wait(20) == 0


def test_a_system_that_does_not_start_says_why(tmp_path: Path, private_runtime_dir: Path) -> None:
    file = tmp_path / "broken.toml"
    file.write_text('graph = "g"\n[[agent]]\nname = "a"\nclass = "nowhere"\n')
    result = dsr("run", str(file), "-dg", "kitchen", "--folder", str(tmp_path / "run"))
    assert result.returncode == 1
    assert "the system did not start" in result.stderr and "class 'nowhere' cannot be loaded" in result.stderr


def test_what_no_launcher_started_is_not_stopped(memory: object) -> None:
    result = dsr("stop", "--graph", "scene")
    assert result.returncode == 2 and "no `dsr run` started graph 'scene' on this machine" in result.stderr
