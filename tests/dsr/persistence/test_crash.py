"""Real processes killed with 9 while they write: at most one second of writes is lost, and the system goes on."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from dsr import Memory, StateKeeper
from dsr.network.rendezvous import graphs
from dsr.runtime.launcher import Launcher
from dsr.runtime.system import load_system
from tests.dsr.conftest import Net

ROOT = Path(__file__).parents[3]
WRITERS = Path(__file__).parent / "systems" / "writers.toml"
AGENTS = ("first", "second")
PATIENCE = 20.0  # s

LAUNCH = """
import sys, threading
from pathlib import Path
from dsr.runtime.launcher import Launcher
from dsr.runtime.system import load_system
with Launcher(load_system(sys.argv[1]), Path(sys.argv[2]), state=Path(sys.argv[3])) as launcher:
    launcher.wait_ready()
    print(*[row.pid for row in launcher.rows()], flush=True)
    launcher.run(threading.Event())
"""


@pytest.fixture(autouse=True)
def _importable(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    yield


def run_and_kill(folder: Path, state: Path, seconds: float) -> float:
    """Let the system write for a while and kill all its processes at once; when that was."""
    command = [sys.executable, "-c", LAUNCH, str(WRITERS), str(folder), str(state)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as launcher:
        assert launcher.stdout is not None
        pids = [int(word) for word in launcher.stdout.readline().split()]
        assert len(pids) == len(AGENTS)
        time.sleep(seconds)
        killed = time.monotonic()
        for pid in (launcher.pid, *pids):
            os.kill(pid, signal.SIGKILL)
    return killed


def count_until(folder: Path, agent: str, moment: float) -> int:
    """How far an agent had counted by then."""
    lines = (folder / f"{agent}.written").read_text().splitlines()
    return max(int(count) for count, at in (line.split() for line in lines) if float(at) <= moment)


def restored(net: Net, state: Path, **_: Any) -> tuple[Memory, StateKeeper]:
    memory = net.join("observer")
    return memory, StateKeeper(memory, state, threaded=False)


def assert_lost_at_most(memory: Memory, folder: Path, killed: float, seconds: float) -> None:
    for agent in AGENTS:
        least, most = count_until(folder, agent, killed - seconds), count_until(folder, agent, killed)
        assert most > 20
        pose = memory.edge("world", f"cube_{agent}", "RT").pose
        for count in (memory.node(f"cube_{agent}")["seen"], pose.t[0]):
            assert least <= count <= most + 1
        balls = {
            int(node.name.rsplit("_", 1)[1]) for node in memory.nodes("ball") if node.name.startswith(f"ball_{agent}")
        }
        assert least - 10 < min(balls) and max(balls) - min(balls) <= 10


def test_when_everything_is_killed_at_most_a_second_of_writes_is_lost(net: Net, tmp_path: Path) -> None:
    folder, state = tmp_path / "run", tmp_path / "state"
    for round_ in range(3):
        killed = run_and_kill(folder, state, 2.0 + 0.3 * round_)
        memory, keeper = restored(Net(), state)
        assert_lost_at_most(memory, folder, killed, 1.0)
        keeper.abandon()
    gone = time.monotonic() + PATIENCE
    while graphs() and time.monotonic() < gone:  # killed processes need a moment to end
        time.sleep(0.05)
    assert graphs() == []


def test_a_system_that_is_stopped_loses_nothing_and_goes_on(net: Net, tmp_path: Path) -> None:
    folder, state = tmp_path / "run", tmp_path / "state"
    for expected in (False, True):
        with Launcher(load_system(WRITERS), folder, state=state) as launcher:
            assert launcher.restored is expected
            launcher.wait_ready()
            time.sleep(0.5)
    memory, _ = restored(net, state)
    for agent in AGENTS:
        assert memory.node(f"cube_{agent}")["seen"] == count_until(folder, agent, time.monotonic())


def test_the_first_content_is_loaded_once(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "dsr.cli"]
    graph = ROOT / "etc" / "graphs" / "breakfast.json"
    options = ["--load", str(graph), "--state", str(tmp_path / "state"), "--folder", str(tmp_path / "run")]

    def run(*lines: str) -> None:
        with subprocess.Popen([*command, "run", str(WRITERS), *options], stdout=subprocess.PIPE, text=True) as system:
            assert system.stdout is not None
            said = ""
            while "second: ready" not in said or "first: ready" not in said:
                said += system.stdout.readline()
            assert all(line in said for line in lines)
            system.terminate()
            assert system.wait(30) == 0

    run("graph writers")
    run("graph writers", "breakfast.json is not loaded")
    memory, _ = restored(Net(), tmp_path / "state")
    assert memory.node("cup_1")["fill_level"] == 0.5
