"""Agents that share a process over Zenoh: each fails, restarts and logs for itself; a crash of the process hits all."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from dsr.errors import ConfigError
from dsr.network.rendezvous import graphs
from dsr.runtime.launcher import Launcher
from dsr.runtime.system import load_system
from tests.dsr.runtime.test_launcher import LAUNCH, is_alive, wait_for

SYSTEMS = Path(__file__).parent / "systems"
TABLE = """
[[agent]]
name = "{name}"
class = "{kind}"
{more}
"""


@pytest.fixture(autouse=True)
def _nothing_left(private_runtime_dir: Path) -> Iterator[None]:
    """After each test the runtime folder must be empty."""
    yield
    assert [path.name for path in (private_runtime_dir / "dsr").rglob("*")] == []


def write_system(folder: Path, *tables: tuple[str, str], kind: str = "toy_mates:Mate") -> Path:
    """The file of a system with an agent for each (name, further lines of its table)."""
    for module in SYSTEMS.glob("toy_*.py"):
        (folder / module.name).symlink_to(module)
    file = folder / "mates.toml"
    config = f'[agent.config]\nfolder = "{folder}"\n' if kind == "toy_mates:Mate" else ""
    text = "".join(TABLE.format(name=name, kind=kind, more=f"{more}\n{config}") for name, more in tables)
    file.write_text('graph = "mates"\n' + text)
    return file


@pytest.fixture
def mates(tmp_path: Path) -> Iterator[Launcher]:
    """Two agents in one process, and a third one in its own, all at work."""
    file = write_system(tmp_path, ("ann", ""), ("bob", ""), ("cid", 'process = "cid"'))
    with Launcher(load_system(file), tmp_path / "run") as launcher:
        launcher.wait_ready()
        wait_for(lambda: all(name in launcher.memory for name in ("ann", "bob", "cid")))
        yield launcher


def counted(launcher: Launcher, name: str) -> float:
    return float(launcher.memory.node(name)["mass"])


def goes_on(launcher: Launcher, name: str) -> None:
    """Wait until an agent has ticked again."""
    before = counted(launcher, name)
    wait_for(lambda: (launcher.poll(), counted(launcher, name) > before)[1])


def log_of(launcher: Launcher, name: str) -> str:
    return (launcher.folder / f"{name}.log").read_text()


def test_agents_of_one_process_have_one_pid_and_each_a_row_a_replica_and_a_log(mates: Launcher, tmp_path: Path) -> None:
    ann, bob, cid = mates.rows()
    assert ann.pid == bob.pid != cid.pid
    assert [row.agent for row in (ann, bob, cid)] == ["ann", "bob", "cid"]
    assert ann.heard and bob.heard and ann.heard.status.rid != bob.heard.status.rid
    for name in ("ann", "bob"):
        (tmp_path / f"{name}.order").write_text("talk")
        wait_for(lambda name=name: f"said by {name} in another logger" in log_of(mates, name))
    assert "bob" not in log_of(mates, "ann") and "ann" not in log_of(mates, "bob")
    assert log_of(mates, "shared") == ""


def test_what_the_thread_of_an_agents_memory_says_is_in_the_log_of_the_agent(mates: Launcher) -> None:
    """A malformed message is noticed by a thread of the transport, in each memory of the process."""
    mates.memory.transport.publish(mates.memory.keys.delta("ann-00000000"), b"nonsense")
    wait_for(lambda: "ann-00000000" in log_of(mates, "ann") and "ann-00000000" in log_of(mates, "bob"))
    assert log_of(mates, "shared") == ""


@pytest.mark.parametrize("order", ["fail", "exit", "exit with a text"])
def test_an_agent_that_fails_is_started_again_and_its_mate_does_not_notice(
    mates: Launcher, tmp_path: Path, order: str
) -> None:
    pid = mates.rows()[0].pid
    (tmp_path / "ann.order").write_text(order)
    wait_for(lambda: (mates.poll(), mates.rows()[0].restarts)[1] == 1)
    mates.wait_ready()
    ann, bob, _ = mates.rows()
    assert (ann.pid, bob.pid, bob.restarts) == (pid, pid, 0)
    assert ann.heard and ann.heard.status.restarts == 1
    goes_on(mates, "ann")
    goes_on(mates, "bob")
    assert ("it hurts" in log_of(mates, "ann")) == (order == "fail")
    assert ("ERROR   ann: ann is fed up" in log_of(mates, "ann")) == (order == "exit with a text")
    assert "it hurts" not in log_of(mates, "bob")


@pytest.mark.parametrize("how", ["kill", "crash", "leave"])
def test_a_crash_of_the_process_has_all_its_agents_started_again_and_no_other(
    mates: Launcher, tmp_path: Path, how: str, caplog: pytest.LogCaptureFixture
) -> None:
    """Whoever ends the process in passing (`os._exit(0)`) has not ended its mates in good order."""
    pid = mates.rows()[0].pid
    assert pid is not None
    if how == "kill":
        os.kill(pid, signal.SIGKILL)
    else:
        (tmp_path / "bob.order").write_text(how)
    wait_for(lambda: (mates.poll(), [row.restarts for row in mates.rows()])[1] == [1, 1, 0])
    mates.wait_ready()
    ann, bob, cid = mates.rows()
    assert ann.pid == bob.pid and ann.pid not in (pid, cid.pid)
    for name in ("ann", "bob", "cid"):
        goes_on(mates, name)
    with_what = {"kill": "signal 9", "crash": "signal 11", "leave": "exit code 0"}[how]
    assert f"process shared ended with {with_what}, and with it ann, bob" in caplog.messages
    assert [message.split()[1] for message in caplog.messages if " ended with " in message] == ["shared", "ann", "bob"]


def test_only_the_agent_that_did_not_stop_is_named_where_its_process_is_killed(
    mates: Launcher, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "bob.order").write_text("block")
    wait_for(lambda: "bob is told to block" in log_of(mates, "bob"))
    pid = mates.rows()[1].pid
    mates.stop()
    assert [message for message in caplog.messages if "stop" in message] == ["agent bob did not stop and was killed"]
    assert pid is not None and not is_alive(pid)


def test_one_that_cannot_be_set_up_is_reported_with_its_log_and_its_mates_end_too(tmp_path: Path) -> None:
    file = write_system(tmp_path, ("broken", 'process = "both"\nrestart = false'), kind="toy_broken:Broken")
    text = file.read_text() + TABLE.format(name="counter", kind="toy_counter:Counter", more='process = "both"')
    file.write_text(text)
    with Launcher(load_system(file), tmp_path / "run") as launcher:
        pid = launcher.rows()[1].pid
        assert pid == launcher.rows()[0].pid is not None
        wait_for(
            lambda: (launcher.poll(), launcher.rows()[0].state == "ended", launcher.rows()[1].is_ready)[1:] == (1, 1)
        )
        assert launcher.rows()[0].pid is None
    assert not is_alive(pid)
    assert "the motor does not answer" in log_of(launcher, "broken")


def test_a_process_all_of_whose_agents_have_ended_goes_with_the_launcher(tmp_path: Path) -> None:
    file = write_system(tmp_path, ("ann", "restart = false"), ("bob", "restart = false"))
    with Launcher(load_system(file), tmp_path / "run") as launcher:
        launcher.wait_ready()
        pid = launcher.rows()[0].pid
        assert pid is not None
        for name in ("ann", "bob"):
            (tmp_path / f"{name}.order").write_text("exit")
        wait_for(lambda: (launcher.poll(), [row.state for row in launcher.rows()])[1] == ["ended", "ended"])
        assert launcher.rows()[0].last_error == "exit code 3"
        assert is_alive(pid)
    assert not is_alive(pid)


def test_a_shared_process_ends_when_its_launcher_is_killed_with_9(tmp_path: Path) -> None:
    file = write_system(tmp_path, ("ann", ""), ("bob", ""))
    command = [sys.executable, "-c", LAUNCH, str(file), str(tmp_path / "run")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as launcher:
        assert launcher.stdout is not None
        ann, bob = (int(word) for word in launcher.stdout.readline().split())
        assert ann == bob and is_alive(ann)
        launcher.kill()
    wait_for(lambda: not is_alive(ann) and graphs() == [])


def test_what_no_system_can_mean_is_refused(tmp_path: Path) -> None:
    file = write_system(tmp_path, ("ann", ""), ("bob", 'process = "ann"'), ("cid", 'process = "ann"'))
    with pytest.raises(ConfigError, match="process 'ann', which bob, cid share, has the name of an agent"):
        load_system(file)
    file.write_text(file.read_text().replace('"ann"\n[agent.config]', '"a/b"\n[agent.config]', 1))
    with pytest.raises(ConfigError, match=r"mates.toml:\d+: process name 'a/b': expected 1 to 64"):
        load_system(file)
    for name, more in (("run", ""), ("bob", 'process = "run"')):
        file.write_text('graph = "mates"\n' + TABLE.format(name=name, kind="toy_counter:Counter", more=more))
        with pytest.raises(ConfigError, match="no agent and no process can be called 'run'"):
            load_system(file)


def test_an_agent_shares_by_its_class_by_the_file_or_not_at_all(tmp_path: Path) -> None:
    file = write_system(tmp_path, ("ann", ""), ("bob", 'process = "two"'), ("cid", ""), ("dan", 'process = "dan"'))
    system = load_system(file)
    shared = {process: [spec.name for spec in specs] for process, specs in system.processes().items()}
    assert shared == {"shared": ["ann", "cid"], "two": ["bob"], "dan": ["dan"]}
    apart = system.apart("ann").processes()
    assert {process: len(specs) for process, specs in apart.items()} == {"ann": 1, "two": 1, "shared": 1, "dan": 1}
    with pytest.raises(ConfigError, match="no agent 'an'; did you mean"):
        system.apart("an")
    counters = load_system(SYSTEMS / "counters.toml").processes()
    assert list(counters) == ["first", "second"], "who does not say that it may share does not"
