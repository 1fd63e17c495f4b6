"""What a system costs that stands idle: processes, memory, processor time, and time until its agents are ready.

    python -m benchmarks.cost
    python -m benchmarks.cost hands --seconds 20
    python -m benchmarks.cost --python .venv/bin/python /work/before/.venv/bin/python --runs 3

Starts `dsr run SYSTEM` and waits until its agents are ready, as whoever types the command does. Then nothing happens
for a while. Memory is what the kernel tells in `smaps_rollup`: PSS counts a page that n processes share as an nth in
each of them, USS only pages that nobody shares. Processor time is that of a process with all its threads. Processes
that an agent starts, such as those that simulate hypotheses, count as its own.

Several interpreters, each of an environment of its own, are measured in turns: a busy machine disturbs all alike.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import signal
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import psutil
from rich.console import Console
from rich.table import Table

from benchmarks.session import private_runtime
from benchmarks.timing import monotonic, sleep
from dsr.clock import WALL_CLOCK
from dsr.connecting import open_transport
from dsr.memory import new_rid
from dsr.network.keys import Keys
from dsr.runtime.status import StatusBoard

GRAPH = "benchmark_cost"
_MB = 1e6
_HEARD = 2.5
"""s in which each agent tells its status at least twice."""
_SETTLED = 3.0
"""s after the agents are ready, from which on nothing of the start is left to do."""
_ENDED = 15.0
"""s in which a system has ended."""


@dataclass
class Process:
    """What one process costs, with those that it started."""

    agents: list[str]
    processes: int
    threads: int
    pss: float
    """MB"""
    uss: float
    """MB"""
    cores: float
    """s of processor time a second"""


@dataclass
class Cost:
    """What one run of a system costs."""

    ready: float
    """s from the command until the last agent was ready"""
    ready_work: float
    """s of processor time until then, of all processes"""
    agents: int
    processes: list[Process] = field(default_factory=list)

    def total(self, name: str) -> float:
        """Sum of a field over all processes."""
        return float(sum(getattr(process, name) for process in self.processes))


def measure(python: str, system: str, seconds: float) -> Cost:
    """Run a system with an interpreter, and leave it idle for `seconds`."""
    with tempfile.TemporaryDirectory() as folder, private_runtime(), _running(python, system, Path(folder)) as run:
        started = monotonic()
        names = _wait_ready(run)
        root = psutil.Process(run.pid)
        cost = Cost(monotonic() - started, sum(_work(process) for process in _family(root)), len(names))
        by_pid = _agents_by_pid()
        sleep(_SETTLED)
        groups = {child.pid: _family(child) for child in root.children()}
        before, begun = {pid: _works(group) for pid, group in groups.items()}, monotonic()
        own = _work(root)
        sleep(seconds)
        elapsed = monotonic() - begun
        cost.processes.append(_process(["dsr run"], [root], (_work(root) - own) / elapsed))
        for pid, group in groups.items():
            spent = sum(work - before[pid].get(one, 0.0) for one, work in _works(group).items())
            cost.processes.append(_process(by_pid.get(pid, [str(pid)]), group, spent / elapsed))
    return cost


@contextlib.contextmanager
def _running(python: str, system: str, folder: Path) -> Iterator[subprocess.Popen[str]]:
    """`dsr run` of the environment of `python`; it has ended when the context is left."""
    command = [python, "-P", "-m", "dsr.cli", "run", system, "--graph", GRAPH, "--folder", str(folder)]
    run = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        yield run
    finally:
        run.send_signal(signal.SIGINT)
        try:
            run.communicate(timeout=_ENDED)
        finally:
            run.kill()


def _wait_ready(run: subprocess.Popen[str]) -> list[str]:
    """The names of the agents when all are ready, by what `dsr run` says of them."""
    states: dict[str, str] = {}
    said = []
    for line in run.stdout or ():
        said.append(line)
        name, _, state = line.strip().partition(": ")
        if state.split(" ")[0] in ("starting", "ready", "degraded"):
            states[name] = state
        if line.startswith("all agents are ready"):
            return sorted(states)
    raise RuntimeError(f"the system did not start:\n{''.join(said)}")


def _agents_by_pid() -> dict[int, list[str]]:
    """The agents that each process runs, by the statuses that they tell."""
    transport, registration = open_transport(GRAPH, new_rid("benchmark"))
    with contextlib.closing(transport), contextlib.closing(registration):
        board = StatusBoard(transport, Keys(GRAPH), WALL_CLOCK)
        sleep(_HEARD)
        found: dict[int, list[str]] = {}
        for name in board.agents():
            if heard := board.get(name):
                found.setdefault(heard.status.pid, []).append(name)
        board.close()
    return found


def _family(process: psutil.Process) -> list[psutil.Process]:
    return [process, *process.children(recursive=True)]


def _works(group: list[psutil.Process]) -> dict[int, float]:
    return {process.pid: _work(process) for process in group}


def _work(process: psutil.Process) -> float:
    """Seconds of processor time that a process has taken, with all its threads."""
    with contextlib.suppress(psutil.Error):
        times = process.cpu_times()
        return float(times.user + times.system)
    return 0.0


def _process(agents: list[str], group: list[psutil.Process], cores: float) -> Process:
    sizes = [_sizes(process.pid) for process in group]
    threads = sum(process.num_threads() for process in group if process.is_running())
    return Process(agents, len(group), threads, sum(pss for pss, _ in sizes), sum(uss for _, uss in sizes), cores)


def _sizes(pid: int) -> tuple[float, float]:
    """PSS and USS of a process, MB."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines()[1:]
    fields = {name: float(rest.split()[0]) for name, _, rest in (line.partition(":") for line in lines)}
    return fields["Pss"] * 1024 / _MB, (fields["Private_Clean"] + fields["Private_Dirty"]) * 1024 / _MB


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser("python -m benchmarks.cost", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("system", nargs="?", default="tabletop")
    parser.add_argument("--seconds", type=float, default=20.0, help="of standing idle; default: %(default)g")
    parser.add_argument("--runs", type=int, default=1, help="of each interpreter; medians are shown")
    parser.add_argument("--python", nargs="+", default=[sys.executable], metavar="FILE", help="interpreters to compare")
    parser.add_argument("--json", type=Path, help="also write the figures of all runs to this file")
    options = parser.parse_args()
    console = Console()
    costs: dict[str, list[Cost]] = {python: [] for python in options.python}
    for _ in range(options.runs):
        for python, found in costs.items():
            found.append(measure(str(Path(python).absolute()), options.system, options.seconds))
    for python, found in costs.items():
        console.print(_details(python, found[-1]))
    console.print(_summary(costs))
    if options.json:
        text = json.dumps({python: [msgspec.to_builtins(cost) for cost in found] for python, found in costs.items()})
        options.json.write_text(text + "\n", encoding="utf-8")


def _details(python: str, cost: Cost) -> Table:
    """The processes of one run."""
    table = Table("agents", "processes", "threads", "PSS MB", "USS MB", "cores", title=python)
    for process in sorted(cost.processes, key=lambda process: -process.pss):
        sizes = f"{process.pss:.0f}", f"{process.uss:.0f}"
        table.add_row(
            ", ".join(process.agents), str(process.processes), str(process.threads), *sizes, f"{process.cores:.3f}"
        )
    return table


def _summary(costs: dict[str, list[Cost]]) -> Table:
    """Medians of all runs."""
    table = Table("", *(f"{number}: {python}" for number, python in enumerate(costs, 1)))
    rows: dict[str, Callable[[Cost], float]] = {
        "agents": lambda cost: cost.agents,
        "processes": lambda cost: cost.total("processes"),
        "threads": lambda cost: cost.total("threads"),
        "PSS, MB": lambda cost: cost.total("pss"),
        "USS, MB": lambda cost: cost.total("uss"),
        "cores while idle": lambda cost: cost.total("cores"),
        "s to ready": lambda cost: cost.ready,
        "s to ready, per agent": lambda cost: cost.ready / cost.agents,
        "s of processor time to ready": lambda cost: cost.ready_work,
        "s of processor time to ready, per agent": lambda cost: cost.ready_work / cost.agents,
    }
    for name, figure in rows.items():
        table.add_row(name, *(f"{statistics.median(figure(cost) for cost in found):.4g}" for found in costs.values()))
    return table


if __name__ == "__main__":
    main()
