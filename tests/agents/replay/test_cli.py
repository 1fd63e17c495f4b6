"""`dsr replay` as a process, followed and controlled over the network."""

from __future__ import annotations

import contextlib
import os
import pty
import re
import signal
import subprocess
import sys
import termios
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from typer.testing import CliRunner

import dsr
from agents.recorder.index import RecordingIndex
from agents.replay import ReplayedGraph
from agents.replay.cli import app
from agents.replay.control import Command, PlayState, parse_command, replayed_time, send
from agents.replay.session import split_keys
from agents.replay.timeline_cli import app as timeline_app
from dsr.clock import WALL_CLOCK
from dsr.errors import ConfigError
from dsr.network.keys import Keys
from dsr.network.rendezvous import graphs
from dsr.timeline import Chronicle
from dsr.vocabulary.replayed import Replayed, decode_replayed, replayed_key
from tests.agents.replay.conftest import state


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "runtime").mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))


@contextmanager
def replaying(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-c", "from agents.replay.cli import app; app()", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout
        assert "graph replay" in process.stdout.readline()
        yield process
        process.kill()


def test_a_replay_is_followed_controlled_and_leaves_nothing_behind(counted: Path) -> None:
    with replaying(str(counted), "--pause-at", "2.5", "--speed", "max", "--stay") as process:
        with dsr.connect("replay", agent="audience") as memory:
            for time in (9.5, 3.25, 0.0, 11.0, 6.0):
                found = send(memory.transport, memory.keys, Command("seek", time))
                assert found.time == pytest.approx(time) and not found.error
                expected = state(ReplayedGraph(counted).at(time))
                wait_until(lambda expected=expected: state(memory) == expected)
            assert send(memory.transport, memory.keys, Command("speed", 4.0)).speed == 4.0
            assert send(memory.transport, memory.keys, Command("resume")).playing
            wait_until(lambda: send(memory.transport, memory.keys, Command("state")).ended)
        process.send_signal(signal.SIGINT)
        assert process.wait(10) == 130
    assert graphs() == []


def test_a_replay_tells_the_time_in_the_recording(counted: Path) -> None:
    told: list[Replayed] = []
    with replaying(str(counted), "--from", "2.5", "--pause-at", "3.5", "--speed", "max", "--stay"), dsr.connect(
        "replay", agent="audience"
    ) as memory:
        memory.transport.subscribe(
            replayed_key(memory.keys), lambda _, payload: told.append(decode_replayed(payload))
        )
        wait_until(lambda: told and told[-1].stamp - told[-1].begin == pytest.approx(3.5))
    assert told[-1].begin == ReplayedGraph(counted).index.begin


def test_a_window_needs_a_display(counted: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    outcome = CliRunner().invoke(app, [str(counted), "--view"])
    assert isinstance(outcome.exception, ConfigError) and "dsr view --serve -g replay" in str(outcome.exception)


def wait_until(condition: object) -> None:
    end = WALL_CLOCK.monotonic() + 20.0
    while not condition():  # type: ignore[operator]
        assert WALL_CLOCK.monotonic() < end
        WALL_CLOCK.wait(threading.Event(), 0.02)


def test_it_ends_by_itself_and_a_second_of_the_name_is_refused(counted: Path) -> None:
    with replaying(str(counted), "--speed", "8") as process:
        with pytest.raises(ConfigError, match="runs already"):
            CliRunner().invoke(app, [str(counted)], catch_exceptions=False)
        assert process.wait(20) == 0


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ([], "which recording"),
        (["nothing.mcap"], "cannot be read"),
        (["pyproject.toml"], "no MCAP file"),
        (["--control", "jump"], "expected pause"),
        (["--control", "seek"], "expected pause"),
        (["--control", "seek far"], "expected pause"),
        (["--control", "pause now"], "expected pause"),
        (["--control", "speed -1"], "expected a positive number"),
        (["--control", "pause"], "no graph 'replay' runs"),
    ],
)
def test_wrong_input_is_told(arguments: list[str], expected: str) -> None:
    with pytest.raises(dsr.DsrError, match=expected):
        CliRunner().invoke(app, arguments, catch_exceptions=False)


@pytest.mark.parametrize("times", [["--from", "1000"], ["--from", "0.2", "--until", "0.1"]])
def test_a_beginning_after_the_end_is_told(counted: Path, times: list[str]) -> None:
    with pytest.raises(ConfigError, match=f"--from {times[1]}: expected at most"):
        CliRunner().invoke(app, [str(counted), *times], catch_exceptions=False)


@pytest.mark.parametrize("speed", ["0", "-1", "nan", "fast"])
def test_a_wrong_speed_is_told(counted: Path, speed: str) -> None:
    with pytest.raises(ConfigError, match="expected a positive number"):
        CliRunner().invoke(app, [str(counted), "--speed", speed], catch_exceptions=False)


def test_commands_are_read() -> None:
    assert parse_command("seek 12.5") == Command("seek", 12.5)
    assert parse_command(" speed max ") == Command("speed", float("inf"))
    assert parse_command("pause") == Command("pause")


@pytest.mark.parametrize("payload", [b"", b"\xff", b"\x81\xa2do\xa4seek", b"\x81\xa2do\xa5dance"])
def test_nonsense_on_the_service_is_refused_and_does_no_harm(counted: Path, payload: bytes) -> None:
    with replaying(str(counted), "--pause-at", "1"), dsr.connect("replay", agent="vandal") as memory:
        replies: list[bytes] = []
        done = threading.Event()
        key = Keys("replay").service("replay")
        memory.transport.request(key, payload, lambda _, reply: replies.append(reply), done.set, 5.0)
        assert done.wait(10.0) and b"command to a replay" in replies[0]
        assert send(memory.transport, memory.keys, Command("seek", 5.0)).time == pytest.approx(5.0, abs=1.0)


def test_the_timeline_of_a_replay_counts_from_where_that_is(counted: Path) -> None:
    with replaying(str(counted), "--pause-at", "2"), dsr.connect("replay", agent="reader") as memory:
        wait_until(lambda: not send(memory.transport, memory.keys, Command("state")).playing)
        played = replayed_time(memory.transport, memory.keys)
        begin = RecordingIndex(counted).begin
        assert played == pytest.approx(begin + 2.0, abs=0.5)
        entry = Chronicle(memory).happened("Spill", ("cube_3",), begin + 1.0)
        assert entry in memory
        shown = CliRunner().invoke(timeline_app, ["-g", "replay", "--kind", "Spill"], catch_exceptions=False).stdout
        assert re.search(r"-[01]\.\d\d +Spill", shown)
    with dsr.connect("scene", agent="reader") as memory:
        assert replayed_time(memory.transport, memory.keys) is None


def test_keys_of_a_terminal_are_told_apart() -> None:
    assert list(split_keys(" \x1b[C\x1b[Dq\x1b[Ax")) == ["space", "right", "left", "q", "up", "x"]


def test_keys_of_a_terminal_pause_jump_and_quit(counted: Path) -> None:
    terminal, inside = pty.openpty()
    before = termios.tcgetattr(inside)
    command = [sys.executable, "-c", "from agents.replay.cli import app; app()", str(counted), "--speed", "0.5"]
    with subprocess.Popen(command, stdin=inside, stdout=inside, stderr=inside) as process:
        shown = bytearray()
        reader = threading.Thread(target=lambda: read_all(terminal, shown), daemon=True)
        reader.start()
        wait_until(lambda: "▶" in shown.decode(errors="ignore"))
        with dsr.connect("replay", agent="audience") as memory:

            def found() -> PlayState:
                return send(memory.transport, memory.keys, Command("state"))

            os.write(terminal, b" ")
            wait_until(lambda: not found().playing)
            paused_at = found().time
            os.write(terminal, b"\x1b[C")
            wait_until(lambda: found().time == pytest.approx(paused_at + 5.0))
            os.write(terminal, b"\x1b[A")
            wait_until(lambda: found().speed == 1.0)
        os.write(terminal, b"q")
        assert process.wait(10) == 0
        assert termios.tcgetattr(inside) == before
    os.close(inside)
    os.close(terminal)


def read_all(terminal: int, into: bytearray) -> None:
    with contextlib.suppress(OSError):
        while data := os.read(terminal, 4096):
            into.extend(data)
