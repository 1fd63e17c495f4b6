"""Systems as processes over Zenoh: start, ready, restart, stop; nothing is left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from dsr import ManualClock, WallClock
from dsr.errors import AgentError
from dsr.network.rendezvous import claim_file, graphs, lock_claim
from dsr.runtime.launched import Program
from dsr.runtime.launcher import Launcher
from dsr.runtime.supervised import Supervised
from dsr.runtime.system import AgentSpec, System, load_class, load_system

SYSTEMS = Path(__file__).parent / "systems"
TWINS = """
from dsr import Access, Agent, main

class One(Agent):
    writes = Access(nodes=("cube",))

    def setup(self):
        self.memory.add_node(f"cube_{type(self).__name__.lower()}", "cube")

class Two(One):
    pass

if __name__ == "__main__":
    main(One)
"""


@pytest.fixture(autouse=True)
def _nothing_left(private_runtime_dir: Path) -> Iterator[None]:
    """After each test the runtime folder must be empty."""
    yield
    assert [path.name for path in (private_runtime_dir / "dsr").rglob("*")] == []


def wait_for(condition: Callable[[], object], seconds: float = 30.0) -> None:
    """Poll until `condition` holds; the limit is only there to fail rather than hang."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.02)


def is_alive(pid: int) -> bool:
    """Whether a process runs (a zombie does not)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def members_of(group: int) -> list[int]:
    """Running processes of a process group."""
    pids = [int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit()]
    return [pid for pid in pids if is_alive(pid) and _group_of(pid) == group]


def _group_of(pid: int) -> int | None:
    try:
        return os.getpgid(pid)
    except ProcessLookupError:
        return None


def one(name: str, **fields: object) -> System:
    """A system of one toy agent."""
    kind = load_class(f"toy_{name}:{name.capitalize()}", SYSTEMS)
    return System(name, (AgentSpec(name, kind, program=f"toy_{name}:{name.capitalize()}", **fields),), SYSTEMS)  # type: ignore[arg-type]


def test_two_classes_of_one_module_are_two_agents(tmp_path: Path) -> None:
    """Each process runs the class that its table names, whatever `python -m` of that module would run."""
    file = tmp_path / "twins.toml"
    tables = "".join(
        f'[[agent]]\nname = "{name}"\nclass = "toy_twins:{name.capitalize()}"\n' for name in ("one", "two")
    )
    file.write_text(f'graph = "twins"\n{tables}')
    (tmp_path / "toy_twins.py").write_text(TWINS)
    with Launcher(load_system(file), tmp_path / "run") as launcher:
        launcher.wait_ready()
        wait_for(lambda: "cube_one" in launcher.memory and "cube_two" in launcher.memory)


def test_agents_become_ready_work_together_and_stop(tmp_path: Path) -> None:
    seen: list[list[str]] = []
    with Launcher(load_system(SYSTEMS / "counters.toml"), tmp_path / "run") as launcher:
        launcher.wait_ready(lambda rows: seen.append([row.state for row in rows]))
        rows = launcher.rows()
        assert [row.agent for row in rows] == ["first", "second"]
        assert all(row.is_ready and row.heard is not None for row in rows)
        wait_for(lambda: "cube_1" in launcher.memory and "cube_2" in launcher.memory)
        wait_for(lambda: launcher.memory.node("cube_2")["mass"] > launcher.memory.node("cube_1")["mass"] > 0)
        pids = [row.pid for row in rows]
    assert seen[0] == ["starting", "starting"]
    assert not any(is_alive(pid) for pid in pids if pid)
    assert graphs() == []
    assert "ready" not in [row.state for row in launcher.rows()]


def test_an_agent_killed_with_9_is_started_again_and_the_others_do_not_notice(tmp_path: Path) -> None:
    with Launcher(load_system(SYSTEMS / "counters.toml"), tmp_path) as launcher:
        launcher.wait_ready()
        first, second = launcher.rows()
        assert first.pid and second.pid
        wait_for(lambda: "cube_1" in launcher.memory and launcher.memory.node("cube_1")["mass"] > 0)
        counted = launcher.memory.node("cube_1")["mass"]
        os.kill(first.pid, signal.SIGKILL)
        wait_for(lambda: (launcher.poll(), launcher.rows()[0].restarts)[1] == 1)
        launcher.wait_ready()
        again, other = launcher.rows()
        assert again.pid != first.pid
        assert (other.pid, other.restarts) == (second.pid, 0)
        assert launcher.memory.node("cube_1")["mass"] >= counted  # it found its node as it had left it
        wait_for(lambda: launcher.memory.node("cube_1")["mass"] > counted)


def test_a_second_system_of_the_same_name_gets_a_name_of_its_own(tmp_path: Path) -> None:
    system = load_system(SYSTEMS / "counters.toml").without("second")
    with Launcher(system, tmp_path / "a") as a, Launcher(system, tmp_path / "b") as b:
        assert (a.graph, b.graph) == ("counters", "counters-2")
        a.wait_ready()
        b.wait_ready()
        a.memory.add_node("world", "world")
        wait_for(lambda: b.memory.node("cube_1")["mass"] > 3)
        assert "world" not in b.memory


def test_an_agent_that_cannot_start_is_reported_with_its_log(tmp_path: Path) -> None:
    system = one("broken", restart=False)
    with Launcher(system, tmp_path) as launcher, pytest.raises(AgentError, match="the motor does not answer"):
        launcher.wait_ready()


def test_a_time_limit_ends_the_waiting_for_one_that_crashes_again_and_again(tmp_path: Path) -> None:
    system = one("broken", ready_timeout=3.0)
    with Launcher(system, tmp_path) as launcher, pytest.raises(AgentError, match=r"not ready within 3 s.*restarts"):
        launcher.wait_ready()


def test_time_in_which_a_process_waits_for_a_processor_does_not_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dsr.runtime.launcher.longest_waited", lambda pid: 60.0)
    with Launcher(one("counter", ready_timeout=0.01), tmp_path) as launcher:
        launcher.wait_ready()
    monkeypatch.setattr("dsr.runtime.launcher.longest_waited", lambda pid: 0.0)
    with (
        Launcher(one("counter", ready_timeout=0.01), tmp_path) as launcher,
        pytest.raises(AgentError, match=r"not ready within 0.01 s \(state"),
    ):
        launcher.wait_ready()


def test_one_that_seldom_ticks_is_heard_all_the_same(tmp_path: Path) -> None:
    with Launcher(one("sleepy"), tmp_path) as launcher:
        launcher.wait_ready()
        first = launcher.rows()[0].heard
        assert first is not None
        wait_for(lambda: (heard := launcher.rows()[0].heard) is not None and heard.at > first.at)


def test_one_that_does_not_stop_is_killed_with_its_children(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dsr.runtime.launcher.STOP_PATIENCE", 0.5)
    with Launcher(one("deaf"), tmp_path) as launcher:
        launcher.wait_ready()
        group = launcher.rows()[0].pid
        assert group is not None and len(members_of(group)) == 2
    wait_for(lambda: members_of(group) == [])


def test_running_ends_when_asked(tmp_path: Path) -> None:
    stop = threading.Event()
    with Launcher(load_system(SYSTEMS / "counters.toml"), tmp_path) as launcher:
        launcher.wait_ready()
        launcher.run(stop, lambda rows: stop.set())
    assert stop.is_set()


LAUNCH = """
import sys, threading
from pathlib import Path
from dsr.runtime.launched import Program
from dsr.runtime.launcher import Launcher
from dsr.runtime.system import load_system
with Launcher(load_system(sys.argv[1]), Path(sys.argv[2])) as launcher:
    launcher.wait_ready()
    print(*[row.pid for row in launcher.rows()], flush=True)
    launcher.run(threading.Event())
"""


def test_agents_end_when_their_launcher_is_killed_with_9(tmp_path: Path) -> None:
    command = [sys.executable, "-c", LAUNCH, str(SYSTEMS / "counters.toml"), str(tmp_path / "run")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as launcher:
        assert launcher.stdout is not None
        pids = [int(word) for word in launcher.stdout.readline().split()]
        assert len(pids) == 2 and all(is_alive(pid) for pid in pids)
        launcher.kill()
    wait_for(lambda: not any(is_alive(pid) for pid in pids) and graphs() == [])
    assert list((tmp_path / "dsr").iterdir()) == []


def test_an_agent_that_cannot_end_in_an_orderly_way_ends_with_its_children_when_the_launcher_is_gone(
    tmp_path: Path,
) -> None:
    system = tmp_path / "deaf.toml"
    system.write_text('graph = "deaf"\n[[agent]]\nname = "deaf"\nclass = "toy_deaf:Deaf"\n')
    for module in SYSTEMS.glob("toy_*.py"):
        (tmp_path / module.name).symlink_to(module)
    with subprocess.Popen(
        [sys.executable, "-c", LAUNCH, str(system), str(tmp_path / "run")], stdout=subprocess.PIPE, text=True
    ) as launcher:
        assert launcher.stdout is not None
        group = int(launcher.stdout.readline())
        assert len(members_of(group)) == 2
        launcher.kill()
    wait_for(lambda: members_of(group) == [] and graphs() == [])
    assert list((tmp_path / "dsr").iterdir()) == []  # what the launcher left was removed by who looked for graphs


def test_the_back_off_doubles_up_to_its_limit_and_a_success_is_final(tmp_path: Path) -> None:
    clock = ManualClock()
    program = Program([sys.executable, "-c", "exit(3)"], tmp_path / "log", os.environ)
    process = Supervised(program, clock=clock)
    process.start()
    waits = []
    for _ in range(7):
        wait_for(lambda: (process.poll(), process.pid is None)[1])
        before = clock.now()
        while process.pid is None:
            clock.advance(0.1)
            process.poll()
        waits.append(round(clock.now() - before, 1))
    process.kill()
    assert waits == pytest.approx([0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0], abs=0.11)
    assert process.exit_code in (3, -signal.SIGKILL)


@pytest.mark.parametrize("code", [0, 2])
def test_what_ended_well_or_was_wrongly_configured_is_not_started_again(tmp_path: Path, code: int) -> None:
    program = Program([sys.executable, "-c", f"exit({code})"], tmp_path / "log", os.environ)
    process = Supervised(program, clock=WallClock())
    process.start()
    wait_for(lambda: (process.poll(), process.ended)[1])
    assert (process.exit_code, process.pid, process.restarts) == (code, None, 0)


def test_who_looks_for_graphs_never_keeps_a_launcher_from_its_name(tmp_path: Path) -> None:
    """Looking whether a claim is a leftover locks it for a moment, and may remove it just before it is locked."""
    looking = "from dsr.network.rendezvous import graphs, read_claim\nwhile True: graphs(), read_claim('x')"
    with subprocess.Popen([sys.executable, "-c", looking]) as process:
        for _ in range(3000):
            lock = lock_claim("x")
            assert lock is not None
            lock.write("1 /x")
            lock.close()
            claim_file("x").unlink(missing_ok=True)
        process.kill()
