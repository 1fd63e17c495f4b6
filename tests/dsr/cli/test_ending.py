"""Signals and closed pipes end a command quietly, with one exit code, at whatever moment they come."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from dsr import Memory
from dsr.cli.interrupts import INTERRUPTED
from dsr.cli.streams import READER_LEFT
from dsr.clock import WALL_CLOCK
from dsr.network import rendezvous
from dsr.network.keys import agent_of

_PROGRAM = """
import os, signal, sys
from dsr.cli import start

after, begun = int(sys.argv.pop(1)), 0

def count(event, _):
    global begun
    if event == "import":
        begun += 1
        if begun == after:
            os.kill(os.getpid(), signal.SIGINT)

sys.addaudithook(count)
try:
    start()
finally:
    if not after:
        os.write(2, f"{begun}\\n".encode())
"""
"""A command that gets Ctrl-C as its import number N begins, and for N = 0 tells how many there are."""


def interrupted(number: int, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", _PROGRAM, str(number), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize("arguments", [["ls", "-g", "scene"], ["watch", "-g", "scene"], ["scenario", "list"]])
def test_ctrl_c_at_any_import_ends_a_command_quietly(arguments: list[str], memory: Memory) -> None:
    count = 400 if arguments[0] == "watch" else int(interrupted(0, *arguments).stderr)
    for number in {1, 2, *range(count // 7, count, count // 7), count - 1}:
        result = interrupted(number, *arguments)
        assert (result.returncode, result.stdout, result.stderr) == (INTERRUPTED, "", ""), number


def test_a_closed_pipe_ends_a_command_quietly(memory: Memory) -> None:
    for arguments in (["ls", "-g", "scene"], ["ls", "-g", "scene", "--json"], ["--help"], ["watch", "-g", "scene"]):
        reading, writing = os.pipe()
        os.close(reading)
        command = [sys.executable, "-m", "dsr.cli", *arguments]
        result = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, timeout=60, check=False)
        os.close(writing)
        assert (result.returncode, result.stderr) == (READER_LEFT, b""), arguments


def test_a_system_whose_output_nobody_reads_any_more_is_stopped(tmp_path: Path, private_runtime_dir: Path) -> None:
    system = Path(__file__).parents[1] / "runtime" / "systems" / "counters.toml"
    command = [sys.executable, "-m", "dsr.cli", "run", str(system), "--folder", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stderr is not None
        assert b"graph counters" in process.stdout.readline()
        process.stdout.close()
        assert process.wait(60) == READER_LEFT
        assert process.stderr.read() == b""
    assert list((private_runtime_dir / "dsr").iterdir()) == []


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_a_system_runs_and_stops_without_standard_streams(
    closed: str, tmp_path: Path, private_runtime_dir: Path
) -> None:
    system = Path(__file__).parents[1] / "runtime" / "systems" / "counters.toml"
    command = f"exec {sys.executable} -m dsr.cli run {system} --folder {tmp_path} {closed}"
    with subprocess.Popen(["bash", "-c", command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        while not {"first", "second"} <= {agent_of(member.rid) for member in rendezvous.members("counters")}:
            assert process.poll() is None
            WALL_CLOCK.wait(threading.Event(), 0.05)
        process.send_signal(signal.SIGINT)
        assert process.wait(60) in (0, INTERRUPTED)  # the latter while it starts
    assert list((private_runtime_dir / "dsr").iterdir()) == []


def test_a_system_stops_in_good_order_although_ends_of_children_are_ignored(
    tmp_path: Path, private_runtime_dir: Path
) -> None:
    system = Path(__file__).parents[1] / "runtime" / "systems" / "counters.toml"
    program = "import signal; signal.signal(signal.SIGCHLD, signal.SIG_IGN); from dsr.cli import start; start()"
    command = [sys.executable, "-c", program, "run", str(system), "--folder", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stderr is not None
        assert any("all agents are ready" in line for line in process.stdout)
        process.send_signal(signal.SIGINT)
        assert (process.wait(60), process.stderr.read()) == (0, "")


def test_signals_that_are_ignored_stay_so() -> None:
    program = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)\n" + _PROGRAM
    command = [sys.executable, "-c", program, "50", "--version"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 0
    assert result.stdout.startswith("dsr ")
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
