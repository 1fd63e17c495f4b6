"""`dsr security` and a whole secured system: made, run, looked into, restarted, listening on loopback only."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
from typer.testing import CliRunner

import dsr
from dsr.cli.common import console
from dsr.cli.main import app
from dsr.connecting import SECURITY
from dsr.network import rendezvous
from dsr.runtime.launcher import Launcher
from dsr.runtime.system import load_system
from dsr.security.authority import SecurityFolder
from dsr.security.policy import Grant, read_policy
from tests.dsr.security.test_secured_network import eventually

SYSTEMS = Path(__file__).parents[1] / "runtime" / "systems"
Cli = Callable[..., Any]


@pytest.fixture
def cli(monkeypatch: pytest.MonkeyPatch) -> Cli:
    """Runs a command in this process."""
    monkeypatch.setattr(console, "width", 160)
    return lambda *arguments: CliRunner().invoke(app, ["security", *map(str, arguments)])


@pytest.fixture
def folder(cli: Cli, tmp_path: Path) -> Path:
    """Made for the system of two counters."""
    result = cli("init", tmp_path / "keys", "--system", SYSTEMS / "counters.toml", "--viewer", "alice")
    assert result.exit_code == 0, result.output
    return tmp_path / "keys"


def test_init_makes_a_certificate_for_everybody_in_the_system(folder: Path, cli: Cli) -> None:
    shown = json.loads(cli("show", folder, "--json").output)
    assert [row["agent"] for row in shown] == ["first", "second", "launcher", "dsr", "halt", "confirm", "alice"]
    assert shown[0]["nodes"] == list(load_system(SYSTEMS / "counters.toml").agents[0].kind.writes.nodes)
    assert all(row["problem"] is None and row["until"] for row in shown)
    text = cli("show", folder).output
    assert "read only" in text and "trusted" in text


def test_a_zenoh_configuration_of_each_can_be_used_elsewhere(folder: Path) -> None:
    script = "import sys, zenoh; print(zenoh.Config.from_file(sys.argv[1]).get_json('access_control/enabled'))"
    for name in read_policy(folder / "policy.json").agents:
        command = [sys.executable, "-c", script, str(SecurityFolder(folder).configuration(name))]
        assert subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout == "true\n"


def test_agents_are_added_and_renewed(folder: Path, cli: Cli) -> None:
    def grant() -> Grant:
        return read_policy(folder / "policy.json").grant("counter")

    assert cli("add", folder, "counter", "--writes", "node:table", "--writes", "attribute:seen").exit_code == 0
    assert grant() == Grant(nodes=("table",), attributes=("seen",))
    before = (folder / "agents" / "counter.pem").read_bytes()
    assert cli("add", folder, "counter", "--renew", "--days", "7").exit_code == 0
    assert grant() == Grant(nodes=("table",), attributes=("seen",))
    assert (folder / "agents" / "counter.pem").read_bytes() != before
    assert cli("add", folder, "counter", "--renew", "--class", "agents.plant:Plant").exit_code == 0
    assert "truth" in grant().publishes
    assert cli("add", folder, "bob", "--read-only").exit_code == 0
    assert "counter" in (folder / "agents" / "first.json5").read_text()


@pytest.mark.parametrize(
    "arguments, message",
    [
        (("init", "{folder}"), "not empty"),
        (("init", "{folder}2", "--system", "nothing"), "unknown system"),
        (("init", "{folder}2", "--agent", "arm", "--agent", "arm-left"), "followed by '-'"),
        (("init", "{folder}2", "--host", "a b"), "host 'a b'"),
        (("add", "{folder}", "first"), "--renew"),
        (("add", "{folder}", "stranger", "--renew"), "not there yet"),
        (("add", "{folder}", "../evil"), "agent name"),
        (("add", "{folder}", "x", "--writes", "cube"), "expected node:NAME"),
        (("add", "{folder}", "x", "--writes", "key:d/first-1"), "publishes"),
        (("add", "{folder}", "x", "--read-only", "--writes", "node:cube"), "read-only, but may do more"),
        (("show", "{folder}2"), "dsr security init"),
    ],
)
def test_wrong_input_is_refused_and_changes_nothing(
    folder: Path, cli: Cli, arguments: tuple[str, ...], message: str
) -> None:
    before = sorted((file, file.read_bytes()) for file in folder.rglob("*.*"))
    result = cli(*(text.format(folder=folder) for text in arguments))
    assert isinstance(result.exception, dsr.ConfigError) and message in str(result.exception)
    assert sorted((file, file.read_bytes()) for file in folder.rglob("*.*")) == before
    assert not Path(f"{folder}2").exists()


def test_show_tells_which_certificate_cannot_be_used(folder: Path, cli: Cli) -> None:
    (folder / "agents" / "second.pem").unlink()
    result = cli("show", folder, "--json")
    assert result.exit_code == 1
    problems = {row["agent"]: row["problem"] for row in json.loads(result.output)}
    assert "second.pem" in problems.pop("second") and not any(problems.values())


def run_dsr(*arguments: str, folder: Path) -> str:
    command = [sys.executable, "-m", "dsr.cli", *arguments]
    environment = {**os.environ, SECURITY: str(folder)}
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, env=environment)
    assert result.returncode == 0, result.stderr
    return result.stdout


def foreign_sockets(pid: int) -> list[Any]:
    """Sockets of a process and its children that somebody on another machine can reach."""
    processes = [psutil.Process(pid), *psutil.Process(pid).children(recursive=True)]
    sockets = [socket for process in processes for socket in process.net_connections("inet")]
    listening = [socket for socket in sockets if socket.status in (psutil.CONN_LISTEN, psutil.CONN_NONE)]
    assert listening, "nothing listens: the search is broken"
    return [socket for socket in listening if socket.laddr.ip not in ("127.0.0.1", "::1")]


@pytest.fixture
def watcher(folder: Path) -> Iterator[Callable[[], subprocess.Popen[str]]]:
    started: list[subprocess.Popen[str]] = []

    def start() -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "dsr.cli", "watch", "--security", str(folder)]
        started.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.communicate()


def test_a_secured_system_works_restarts_and_is_looked_into(
    folder: Path, tmp_path: Path, watcher: Callable[[], subprocess.Popen[str]]
) -> None:
    with Launcher(load_system(SYSTEMS / "counters.toml"), tmp_path / "run", security=folder) as launcher:
        launcher.wait_ready()
        assert len(rendezvous.endpoints("counters")) == 3
        assert all(endpoint.startswith("tls/") for endpoint in rendezvous.endpoints("counters"))
        assert "cube_2" in {row["name"] for row in json.loads(run_dsr("ls", "--json", folder=folder))}
        output = watcher().stdout
        assert output is not None and "cube" in output.readline()
        assert foreign_sockets(os.getpid()) == []

        pid = launcher.rows()[0].pid
        assert pid is not None
        os.kill(pid, signal.SIGKILL)
        assert eventually(lambda: launcher.poll() or (launcher.rows()[0].restarts == 1 and launcher.rows()[0].is_ready))
        count = launcher.memory.node("cube_2")
        before = dict(count)
        assert eventually(lambda: dict(count) != before)
        with pytest.raises(dsr.ConfigError, match="is secured"):
            dsr.connect("counters", agent="first")


def test_agents_of_a_secured_graph_share_no_process(folder: Path, tmp_path: Path) -> None:
    """Who can read the memory of a process has the keys of all agents in it."""
    system = load_system(SYSTEMS / "counters.toml")
    together = dataclasses.replace(
        system, agents=tuple(dataclasses.replace(spec, process="both") for spec in system.agents)
    )
    with Launcher(together, tmp_path / "run", security=folder) as launcher:
        launcher.wait_ready()
        first, second = launcher.rows()
        assert first.pid != second.pid


def test_a_hub_connects_secured_machines(keys: SecurityFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two runtime folders stand for two machines: their processes meet in the hub only."""
    endpoint = f"tls/127.0.0.1:{rendezvous.free_port()}"
    command = [sys.executable, "-m", "dsr.cli", "hub", "--listen", endpoint, "--security", str(keys.path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as hub, contextlib.ExitStack() as stack:
        stack.callback(hub.kill)
        assert hub.stdout is not None and endpoint in hub.stdout.readline()
        memories = []
        for agent in ("launcher", "arm", "scene"):
            place = tmp_path / agent
            place.mkdir(mode=0o700)
            monkeypatch.setenv("XDG_RUNTIME_DIR", str(place))
            memory = dsr.connect("g", agent=agent, connect=[endpoint], security=keys.path)
            memories.append(stack.enter_context(memory))
        memories[1].add_node("gen3", "arm")
        memories[2].add_node("cube", "cube")
        for memory in memories:
            assert eventually(lambda memory=memory: {node.name for node in memory.nodes()} == {"gen3", "cube"})
            assert len(memory.peers) == 2


def test_a_hub_needs_the_certificate_of_a_relay(folder: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "dsr.cli", "hub", "--security", str(folder)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 2 and "'hub' has no certificate" in result.stderr


def test_without_security_too_everything_listens_on_loopback_only(tmp_path: Path) -> None:
    with Launcher(load_system(SYSTEMS / "counters.toml"), tmp_path / "run") as launcher:
        launcher.wait_ready()
        assert foreign_sockets(os.getpid()) == []
