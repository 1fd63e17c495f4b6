"""An agent as a process: command line, exit codes, logs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import dsr
from dsr.errors import ConfigError
from dsr.runtime.agent_process import read_config
from dsr.runtime.logs import LogRecord, decode_log

SYSTEMS = Path(__file__).parent / "systems"
ROOT = Path(__file__).parents[3]


@contextmanager
def agent(kind: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A toy agent's process, killed at the end if need be."""
    command = [sys.executable, str(SYSTEMS / f"toy_{kind}.py"), *arguments]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stderr=pipe, stdout=pipe, text=True, env=environment) as process:
        yield process
        process.kill()


def outcome(kind: str, *arguments: str) -> tuple[int, str]:
    """Exit code and standard error of an agent that ends by itself."""
    with agent(kind, *arguments) as process:
        _, errors = process.communicate(timeout=60)
    return process.returncode, errors


def test_help_tells_what_it_reads_writes_and_can_be_configured_with() -> None:
    with agent("counter", "--help") as process:
        text, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    parts = ("Counts its ticks", "20 times a second", "writes nodes: cube", "writes attributes: mass", "step = 1.0")
    assert all(part in text for part in parts)
    assert """--config '{"node":"cube_1"}'""" in text


def test_it_joins_the_only_running_graph_and_ends_well_on_sigterm() -> None:
    with dsr.connect("kitchen", agent="owner") as memory, agent("counter", "--name", "c7") as process:
        change = memory.watch(node_type="cube", attribute="mass").next(timeout=30)
        assert change is not None and change.name == "cube_1"
        assert any(rid.startswith("c7-") for rid in memory.peers)
        process.send_signal(signal.SIGTERM)
        assert process.wait(20) == 0


def test_without_a_running_graph_it_says_what_to_do() -> None:
    code, errors = outcome("counter")
    assert code == 2
    assert "no graph runs on this machine; name the one to begin with --graph" in errors


@pytest.mark.parametrize(
    ("config", "expected"),
    [
        ('{"nod": "a"}', "unknown field 'nod'; did you mean 'node'?"),
        ('{"step": "far"}', "step: expected `float`"),
        ("{", "--config: expected a JSON object"),
        ("@none.json", "none.json: cannot be read"),
    ],
)
def test_a_wrong_configuration_ends_it_with_exit_code_2(config: str, expected: str) -> None:
    code, errors = outcome("counter", "--graph", "kitchen", "--config", config)
    assert code == 2
    assert expected in errors and "Traceback" not in errors


def test_a_failing_set_up_ends_it_with_exit_code_1_and_its_logs_go_over_the_bus_too() -> None:
    records: list[LogRecord] = []
    with dsr.connect("kitchen", agent="owner") as memory:
        memory.transport.subscribe(memory.keys.log(), lambda key, payload: records.append(decode_log(payload)))
        code, errors = outcome("broken", "--graph", "kitchen")
    assert code == 1
    assert errors.count("Traceback") == 1
    assert "set-up failed: RuntimeError: the motor does not answer" in errors
    assert [(record.level, record.agent) for record in records] == [("ERROR", "broken")]
    assert "the motor does not answer" in records[0].text


def test_a_configuration_comes_from_text_json_or_toml(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('{"step": 2}')
    (tmp_path / "a.toml").write_text("step = 2")
    assert read_config('{"step": 2}') == read_config(f"@{tmp_path}/a.json") == read_config(f"@{tmp_path}/a.toml")
    (tmp_path / "b.toml").write_text("step = \n")
    with pytest.raises(ConfigError, match=r"b\.toml:1: not valid TOML"):
        read_config(f"@{tmp_path}/b.toml")
