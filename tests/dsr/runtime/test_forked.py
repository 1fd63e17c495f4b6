"""Processes that are forked ahead: what they run is as in a process of its own, and none is left behind."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

pytestmark = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="only Linux tells the threads")
TOLD = '''
"""Tells about the process in which it runs."""

import atexit, json, logging, os, signal, sys


def main() -> int:
    print(json.dumps({
        "pid": os.getpid(),
        "arguments": sys.argv[1:],
        "environment": dict(os.environ),
        "input": sys.stdin.read(),
        "leads": os.getsid(0) == os.getpid() == os.getpgrp(),
        "name": open("/proc/self/comm").read().strip(),
        "main": sys.modules["__main__"].__spec__.name,
        "signals": [str(signal.getsignal(n)) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)],
        "handlers": len(logging.root.handlers),
        "level": logging.root.level,
        "blocked": sorted(signal.pthread_sigmask(signal.SIG_BLOCK, [])),
        "loaded": "colorsys" in sys.modules,
        "files": sorted(n for n in range(3, 64) if os.path.exists(f"/proc/self/fd/{n}")),
        "path": sys.path,
    }))
    print("also said", file=sys.stderr)
    atexit.register(print, "at the end")
    if sys.argv[-1] == "fail":
        raise ValueError("as asked")
    if sys.argv[-1] == "exit":
        sys.exit("in words")
    return 7


if __name__ == "__main__":
    sys.exit(main())
'''
BEGIN = """
import colorsys, logging, os, signal, sys
from dsr.runtime.forked import PYTHON, fork_ahead
from dsr.runtime.launched import Program
logging.basicConfig(level=logging.DEBUG)
os.set_inheritable(os.open(os.devnull, os.O_RDONLY), True)
signal.signal(signal.SIGTERM, lambda *_: None)
ahead = fork_ahead({count})
assert len(ahead) == {count}, len(ahead)
"""


Begin = Callable[..., str]


@pytest.fixture
def begin(tmp_path: Path) -> Begin:
    """Runs code after forks in a process of its own, which ends with a code; returns what it printed."""
    (tmp_path / "told.py").write_text(TOLD)

    def run(count: int, code: str, ends: int = 0) -> str:
        text = BEGIN.format(count=count) + textwrap.dedent(code)
        environment = {**os.environ, "PYTHONPATH": str(tmp_path), "OPENBLAS_NUM_THREADS": "1"}
        done = subprocess.run(
            [sys.executable, "-c", text], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False,
            timeout=60,
        )  # fmt: skip
        assert done.returncode == ends, done.stderr
        return done.stdout

    return run


RUN = """
import time
from pathlib import Path
def run(ahead, log, *arguments):
    program = Program([*PYTHON, "told", *arguments], Path(log), {**os.environ, "COLOUR": "blue"}, ahead)
    reading, writing = os.pipe()
    program.start(3, ["more"] if not arguments else [], [writing])
    os.close(writing)
    program.write(b"ordered")
    program._process.stdin.close()
    while (code := program.exit_code()) is None:
        time.sleep(0.01)
    return code
"""


def test_a_fork_runs_a_module_as_a_new_interpreter_does(begin: Begin, tmp_path: Path) -> None:
    codes = begin(1, RUN + 'print(run(ahead, "forked.log"), len(ahead), run([], "anew.log"))')
    assert codes.split() == ["7", "0", "7"]
    told, other = (json.loads((tmp_path / name).read_text().splitlines()[0]) for name in ("forked.log", "anew.log"))
    assert (tmp_path / "forked.log").read_text().endswith("also said\nat the end\n")
    assert told.pop("loaded") and not other.pop("loaded")  # libraries are there already
    assert (told.pop("main"), other.pop("main")) == ("told", "told")
    assert told.pop("name") == "forked" and other.pop("name").startswith("python")
    assert told.pop("pid") != other.pop("pid")
    assert len(told.pop("files")) == len(other.pop("files")) == 1  # the one that was passed on
    assert told == other
    assert told["environment"]["DSR_LAUNCHED"] == "3"
    assert told["environment"]["COLOUR"] == "blue"


def test_failures_are_told_in_the_log_with_their_exit_codes(begin: Begin, tmp_path: Path) -> None:
    codes = begin(2, RUN + 'print(run(ahead, "fail.log", "fail"), run(ahead, "exit.log", "exit"))')
    assert codes.split() == ["1", "1"]
    assert "ValueError: as asked" in (tmp_path / "fail.log").read_text()
    assert (tmp_path / "fail.log").read_text().endswith("at the end\n")
    assert "in words" in (tmp_path / "exit.log").read_text()


def test_forks_that_get_no_order_end_when_they_are_dismissed_or_their_parent_is_killed(begin: Begin) -> None:
    told = begin(
        3,
        """
        ahead.pop().dismiss()
        print(*(one.pid for one in ahead), flush=True)
        os.kill(os.getpid(), signal.SIGKILL)
        """,
        ends=-signal.SIGKILL,
    )
    assert len(told.split()) == 2
    assert all(_ends(int(pid)) for pid in told.split())


def test_a_process_with_threads_is_not_forked() -> None:
    code = """
import threading
from dsr.runtime.forked import fork_ahead
stop = threading.Event()
threading.Thread(target=stop.wait).start()
print(len(fork_ahead(2)))
stop.set()
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert run.stdout.split() == ["0"]


def test_dsr_run_forks_its_agents_restarts_them_anew_and_leaves_none(tmp_path: Path) -> None:
    system = Path(__file__).parent / "systems" / "counters.toml"
    command = [sys.executable, "-P", "-m", "dsr.cli", "run", str(system), "--graph", f"forked{os.getpid()}"]
    with subprocess.Popen([*command, "--folder", str(tmp_path)], stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        said = iter(run.stdout)
        assert any("all agents are ready" in line for line in said)
        agents = psutil.Process(run.pid).children()
        assert agents
        assert all(agent.cmdline() == psutil.Process(run.pid).cmdline() for agent in agents)  # by that, forks are told
        assert all(os.getsid(agent.pid) == agent.pid for agent in agents)
        killed = agents[0]
        killed.kill()
        assert any(line.rstrip().endswith(": ready") for line in said)
        anew = [agent for agent in psutil.Process(run.pid).children() if agent not in agents]
        assert [agent.cmdline()[1:3] for agent in anew] == [["-P", "-m"]]
        run.send_signal(signal.SIGINT)
        run.communicate(timeout=30)
    assert run.returncode == 0
    assert not any(agent.is_running() for agent in [*agents, *anew])


def _ends(pid: int) -> bool:
    """Whether a process ends; the limit is only there to fail rather than hang."""
    for _ in range(500):
        if not psutil.pid_exists(pid) or psutil.Process(pid).status() == psutil.STATUS_ZOMBIE:
            return True
        time.sleep(0.02)
    return False
