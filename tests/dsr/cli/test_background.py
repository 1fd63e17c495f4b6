"""`dsr run --detach`, `dsr logs`, `dsr stop`: a system that needs no terminal."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from dsr.cli.background import start_in_background
from dsr.network.rendezvous import graphs, read_claim

SYSTEMS = Path(__file__).parents[1] / "runtime" / "systems"


def dsr(*arguments: str, beside: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Call the command, in the folder `beside` if that is given."""
    command = [sys.executable, "-m", "dsr.cli", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, cwd=beside)


@pytest.fixture
def detached(tmp_path: Path, private_runtime_dir: Path) -> Iterator[Path]:
    """The folder of a system in the background, which ends with the test."""
    folder = tmp_path / "run"
    result = dsr("run", str(SYSTEMS / "counters.toml"), "--detach", "--folder", str(folder))
    assert result.returncode == 0, result.stderr
    said = f"graph counters, logs and recordings in {folder}; dsr logs -g counters, dsr stop -g counters\n"
    assert result.stdout == said
    yield folder
    if read_claim("counters") is not None:
        assert dsr("stop", "-g", "counters").returncode == 0


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
    whole = dsr("logs", "run", "-n", "1000").stdout.splitlines()
    for most in (1, len(whole) - 1, len(whole), len(whole) + 1, 2 * len(whole) - 1):
        assert dsr("logs", "run", "-n", str(most)).stdout.splitlines() == whole[-most:]
    rows = [json.loads(line) for line in dsr("logs", "run", "--json").stdout.splitlines()]
    assert {"agent": "run", "text": "first: ready"} in rows
    assert {line.partition(":")[0] for line in dsr("logs", "--lines", "1").stdout.splitlines()} <= {
        "first", "second", "run"
    }  # fmt: skip
    command = [sys.executable, "-m", "dsr.cli", "logs", "run", "-n", "1", "--follow"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout and process.stdout.readline() == "run: all agents are ready\n"
        assert dsr("stop").returncode == 0
        assert process.wait(20) == 0


def test_a_system_that_does_not_start_says_why(tmp_path: Path, private_runtime_dir: Path) -> None:
    file = tmp_path / "broken.toml"
    file.write_text('graph = "g"\n[[agent]]\nname = "a"\nclass = "nowhere"\n')
    result = dsr("run", str(file), "-dg", "kitchen", "--folder", str(tmp_path / "run"))
    assert result.returncode == dsr("run", str(file)).returncode == 2
    assert "the system did not start" in result.stderr and "class 'nowhere' cannot be loaded" in result.stderr


def test_a_system_that_could_say_nothing_is_told_with_how_it_ended(tmp_path: Path, private_runtime_dir: Path) -> None:
    """As on a full disk: what the run says is lost, here with standard output and error themselves."""
    mute = tmp_path / "sitecustomize.py"
    mute.write_text(
        "import os\nif 'DSR_DETACHED' in os.environ:\n    full = os.open('/dev/full', os.O_WRONLY)\n"
        "    os.dup2(full, 1)\n    os.dup2(full, 2)\n"
    )
    folder = tmp_path / "run"
    command = [sys.executable, "-m", "dsr.cli", "run", str(SYSTEMS / "counters.toml"), "-d"]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    result = subprocess.run(
        [*command, "--folder", str(folder)], capture_output=True, text=True, timeout=60, check=False, env=environment
    )
    assert result.returncode == 1
    said = f"the system did not start:\nit ended with exit code 1, and nothing could be written to {folder / 'run.log'}"
    assert said in result.stderr
    assert read_claim("counters") is None and graphs() == []


def test_warnings_are_told_whole_before_where_it_runs(detached: Path, tmp_path: Path) -> None:
    result = dsr("run", str(SYSTEMS / "counters.toml"), "--detach", "--folder", str(tmp_path / "second"))
    assert "a system 'counters' is running already; this one is 'counters-2'" in " ".join(result.stderr.split())
    assert result.stdout.startswith("graph counters-2, logs and recordings in ")
    assert result.stdout.endswith("; dsr logs -g counters-2, dsr stop -g counters-2\n")
    assert dsr("stop", "-g", "counters-2").returncode == 0


def test_interrupted_before_it_is_ready_it_leaves_nothing_behind(tmp_path: Path, private_runtime_dir: Path) -> None:
    folder = tmp_path / "run"
    log = folder / "run.log"
    system = str(SYSTEMS / "counters.toml")
    command = [sys.executable, "-m", "dsr.cli", "run", system, "-d", "--folder", str(folder)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        while not log.exists():
            assert process.poll() is None
        process.send_signal(signal.SIGINT)
        assert process.wait(40) == 130
    assert read_claim("counters") is None and graphs() == []


def test_interrupted_while_its_process_is_being_made_it_leaves_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[subprocess.Popen[bytes]] = []
    popen = subprocess.Popen

    def interrupted(*_: object, **__: object) -> subprocess.Popen[bytes]:
        started.append(popen([sys.executable, "-c", "import time; time.sleep(60)"]))
        os.kill(os.getpid(), signal.SIGINT)
        return started[0]

    monkeypatch.setattr(subprocess, "Popen", interrupted)
    with pytest.raises(KeyboardInterrupt):
        start_in_background(tmp_path / "run")
    assert started[0].poll() is not None


def test_logs_of_a_system_that_has_ended_are_those_of_its_last_run(
    tmp_path: Path, private_runtime_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert dsr("logs").stderr == "no graph runs on this machine; start a system: dsr run tabletop\n"
    for _ in range(2):
        started = dsr("run", str(SYSTEMS / "counters.toml"), "--detach")
        folder = started.stdout.split("recordings in ")[1].partition(";")[0]
        assert dsr("stop").returncode == 0
    for options, which in (((), "no graph runs"), (("-g", "counters"), "graph counters does not run")):
        result = dsr("logs", "run", *options, "--follow")
        assert result.returncode == 0
        assert result.stderr == f"{which} on this machine; these are the logs of the last run, in {folder}\n"
        assert f"run: graph counters, logs and recordings in {folder}" in result.stdout
        assert f"run: stopped; logs and recordings are in {folder}" in result.stdout
    assert dsr("logs", "-g", "kitchen").returncode == 2


@pytest.mark.parametrize("command", ["ls", "stop", "logs"])
def test_what_is_left_of_killed_processes_is_removed(command: str, private_runtime_dir: Path, tmp_path: Path) -> None:
    for options in ([], ["-g", "counters"]):
        folder = private_runtime_dir / "dsr" / "counters"
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        (folder / "first-0123.endpoint").write_text("tcp/127.0.0.1:1 memory")
        folder.with_name("counters.launcher").write_text(f"{os.getpid()} {private_runtime_dir / 'run'}")
        result = dsr(command, *options, beside=tmp_path)  # where nothing was run before
        assert result.returncode == 2 and "runs on this machine" in result.stderr
        assert list(folder.parent.iterdir()) == []


def test_a_system_takes_the_name_of_one_that_was_killed(tmp_path: Path, private_runtime_dir: Path) -> None:
    folder = private_runtime_dir / "dsr"
    folder.mkdir(mode=0o700)
    (folder / "counters.launcher").write_text(f"{os.getpid()} {tmp_path}")
    result = dsr("run", str(SYSTEMS / "counters.toml"), "--detach", "--folder", str(tmp_path / "run"))
    assert result.stdout.startswith("graph counters, ")
    assert dsr("stop").returncode == 0
    assert list(folder.iterdir()) == []


def test_what_no_launcher_started_is_not_stopped(memory: object) -> None:
    result = dsr("stop", "--graph", "scene")
    assert result.returncode == 2 and "no `dsr run` started graph 'scene' on this machine" in result.stderr
    for command in ("stop", "logs"):
        result = dsr(command, "--graph", "kitchen")
        assert result.returncode == 2 and "no graph 'kitchen' runs on this machine; running: scene" in result.stderr
