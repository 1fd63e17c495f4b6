"""The command line as a whole: errors, exit codes, commands of other packages."""

from __future__ import annotations

import itertools
import signal
import subprocess
import sys
from pathlib import Path

import pytest

SYSTEMS = Path(__file__).parents[1] / "runtime" / "systems"


def dsr(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "dsr.cli", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_an_error_is_one_line_and_no_traceback() -> None:
    result = dsr("ls", "--graph", "kitchen")
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr == "no graph 'kitchen' runs on this machine; running: none\n"


def test_debug_shows_the_traceback() -> None:
    assert "Traceback" in dsr("--debug", "ls").stderr


def test_help_names_the_commands() -> None:
    result = dsr("--help")
    assert result.returncode == 0
    assert all(f" {command} " in result.stdout for command in ("run", "ls", "show", "tree", "watch", "top", "doctor"))


@pytest.mark.parametrize("line", ["view runs/mine", "replay runs/mine more", "demo towers twice"])
def test_words_that_a_command_does_not_take_are_no_commands(line: str) -> None:
    result = dsr(*line.split())
    assert result.returncode == 2
    assert "Got unexpected extra argument" in result.stderr and "No such command" not in result.stderr


def test_a_wrong_system_file_is_told_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text('graph = "g"\n[[agent]]\nname = "a"\nclas = "x:Y"\n')
    result = dsr("run", str(file))
    assert result.returncode == 2
    assert f"{file}:4: unknown field 'clas' in agent[0]; did you mean 'class'?" in result.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_run_starts_a_system_and_stops_it_on_a_signal(
    tmp_path: Path, private_runtime_dir: Path, number: signal.Signals
) -> None:
    command = [sys.executable, "-m", "dsr.cli", "run", str(SYSTEMS / "counters.toml"), "--folder", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        lines = iter(process.stdout.readline, "")
        assert "graph counters" in next(lines)
        states = set(itertools.takewhile(lambda line: line != "all agents are ready", map(str.strip, lines)))
        ready = {"first: ready", "second: ready"}
        assert ready <= states <= ready | {"first: starting", "second: starting"}  # not all are seen starting
        process.send_signal(number)
        assert process.wait(20) == 0
    assert list((private_runtime_dir / "dsr").iterdir()) == []
    assert {file.name for file in tmp_path.glob("*.log")} == {"first.log", "second.log"}


def test_with_nohup_it_outlives_its_terminal(tmp_path: Path, private_runtime_dir: Path) -> None:
    command = ["nohup", sys.executable, "-m", "dsr.cli", "run", str(SYSTEMS / "counters.toml")]
    with subprocess.Popen([*command, "--folder", str(tmp_path)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        states = [next(iter(process.stdout.readline, "")) for _ in range(5)]
        assert "second: ready" in " ".join(states)
        process.send_signal(signal.SIGHUP)
        process.send_signal(signal.SIGHUP)
        assert dsr("ls", "--graph", "counters").returncode == 0
        process.send_signal(signal.SIGTERM)
        assert process.wait(20) == 0


def test_a_folder_that_cannot_be_made_is_told_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    result = dsr("run", str(SYSTEMS / "counters.toml"), "--folder", str(tmp_path / "file" / "run"))
    assert result.returncode == 1
    assert result.stderr == f"{tmp_path / 'file' / 'run'}: Not a directory\n"


def test_run_fails_if_an_agent_cannot_be_started(tmp_path: Path) -> None:
    file = tmp_path / "broken.toml"
    file.write_text('graph = "g"\n[[agent]]\nname = "broken"\nclass = "toy_broken:Broken"\nrestart = false\n')
    for module in ("toy_broken.py", "toy_agents.py"):
        (tmp_path / module).symlink_to(SYSTEMS / module)
    result = dsr("run", str(file), "--folder", str(tmp_path / "run"))
    assert result.returncode == 1
    assert "the motor does not answer" in result.stderr


def test_run_says_that_all_agents_have_ended(tmp_path: Path) -> None:
    (tmp_path / "toy_brief.py").write_text(
        "import sys\n\nfrom dsr import Agent\n\n\nclass Brief(Agent):\n    ticks = 0\n\n"
        "    def tick(self, now):\n        self.ticks += 1\n        if self.ticks > 3:\n            sys.exit(0)\n"
    )
    file = tmp_path / "brief.toml"
    file.write_text('graph = "g"\n[[agent]]\nname = "brief"\nclass = "toy_brief:Brief"\n')
    result = dsr("run", str(file), "--folder", str(tmp_path / "run"))
    assert result.returncode == 1
    assert "all agents are ready\n" in result.stdout
    assert result.stderr.endswith(f"all agents have ended by themselves; their logs are in {tmp_path / 'run'}\n")


def test_a_second_system_of_that_name_says_which_name_it_takes(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "dsr.cli", "run", str(SYSTEMS / "counters.toml"), "--folder"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([*command, str(tmp_path / "a")], **pipes) as a:  # type: ignore[call-overload]
        assert "graph counters," in a.stdout.readline()
        with subprocess.Popen([*command, str(tmp_path / "b")], **pipes) as b:  # type: ignore[call-overload]
            assert "graph counters-2," in b.stdout.readline()
            b.terminate()
            assert "a system 'counters' is running already; this one is 'counters-2'" in b.stderr.read()
        a.terminate()
