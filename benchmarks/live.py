"""Does the whole system keep its rates live? Ticks and percepts a second, and processor time, of each agent.

    python -m benchmarks.live
    python -m benchmarks.live full_tower --sensor poses --seconds 20 --json live.json

Runs a scenario with every agent a process of its own, and measures from 3 s after the start on. With `--shared` agents
share processes as in `dsr scenario run`; the cores of such a process stand in the row of its first agent. The rate of
an agent is the median and the least of what it told of itself once a second; its share of a core comes from the
operating system, children included. Percepts are counted per object while it is perceived: frames in which it was
found, over the time in which it was.
"""

from __future__ import annotations

import argparse
import itertools
import json
import statistics
import threading
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil
from rich.console import Console
from rich.table import Table

from agents.scenario.judge.judge import Judge
from agents.scenario.run.runner import Conductor
from agents.scenario.run.staging import Run, make_run, staged_system, without
from dsr.cli.common import new_run_folder
from dsr.memory import Memory
from dsr.runtime.launcher import POLL_PERIOD, Launcher
from dsr.vocabulary.scenario_start import LEAD

WARM_UP = 3.0
"""s after the start of the scenario that do not count"""
_GAP = 0.5  # s between two percepts from which on an object was out of sight
TARGETS = {"simulation_handler": 20.0, "scene_estimator": 20.0, "surprise": 20.0}
"""Hz, that the agents' classes promise"""


@dataclass
class Samples:
    """What was measured of one agent."""

    rates: list[float] = field(default_factory=list)
    """Hz, one a second"""
    first: float | None = None
    """s of processor time when the measurement began"""
    last: float = 0.0
    """s, at its end"""
    beside: str = ""
    """The agent in whose row the processor time of the process is told; empty for its own"""


class Meter:
    """Collects rates and processor times of the agents of a launcher."""

    def __init__(self, launcher: Launcher) -> None:
        self._launcher = launcher
        self._watch = launcher.memory.watch(edge_type="RT", existing=False)
        self._stamps: dict[str, list[float]] = defaultdict(list)
        self._next = 0.0
        self.agents: dict[str, Samples] = defaultdict(Samples)

    def sample(self, now: float) -> None:
        """Look at the percepts; once a second also at the processes."""
        cameras = {node.name for node in self._launcher.memory.nodes("camera")}
        for change in self._watch.poll():
            edge = self._launcher.memory.get_edge(change.src, change.dst, "RT") if change.src in cameras else None
            if edge is not None:
                self._note(edge.dst, edge.pose.stamp)
        if now < self._next:
            return
        self._next = now + 1.0
        first_of: dict[int, str] = {}
        for row in self._launcher.rows():
            samples = self.agents[row.agent]
            if row.heard is not None:
                samples.rates.append(row.heard.status.rate_hz)
            if row.pid is None:
                continue
            first = first_of.setdefault(row.pid, row.agent)
            samples.beside = "" if first == row.agent else first
            if not samples.beside:
                samples.last = processor_time(row.pid)
                samples.first = samples.last if samples.first is None else samples.first

    def _note(self, name: str, stamp: float) -> None:
        if not self._stamps[name] or stamp > self._stamps[name][-1]:
            self._stamps[name].append(stamp)

    def percepts_hz(self) -> float:
        """Percepts a second of an object while it is seen, over all objects."""
        gaps = [b - a for stamps in self._stamps.values() for a, b in itertools.pairwise(stamps)]
        seen = [gap for gap in gaps if gap < _GAP]
        return len(seen) / sum(seen) if seen else 0.0


def processor_time(pid: int) -> float:
    """Seconds of processor time of a process and its children."""
    try:
        process = psutil.Process(pid)
        times = [part.cpu_times() for part in (process, *process.children(recursive=True))]
    except psutil.Error:
        return 0.0
    return float(sum(time.user + time.system for time in times))


def measure(run: Run, seconds: float, *, shared: bool) -> tuple[Meter, float, bool]:
    """Run a scenario live for at most `seconds`; what was measured, over how many seconds, and whether it passed."""
    assert run.folder is not None
    system = without(staged_system(run), "viewer")
    system = system if shared else system.apart(*(spec.name for spec in system.agents))
    with Launcher(system, run.folder, seed=run.seed) as launcher:
        memory: Memory = launcher.memory
        judge = Judge(run.scenario, memory, memory.transport, memory.keys)
        launcher.wait_ready()
        start = launcher.clock.now() + LEAD
        conductor = Conductor(run.scenario, start, judge, memory.transport, memory.keys, lambda agent: None)
        meter = Meter(launcher)
        while (elapsed := conductor.step(launcher.clock.now())) < min(run.scenario.duration, seconds):
            if elapsed >= WARM_UP:
                meter.sample(elapsed)
            if conductor.is_over:
                break
            launcher.poll()
            launcher.clock.wait(threading.Event(), POLL_PERIOD)
        judge.close()
        return meter, elapsed - WARM_UP, judge.result(run.seed, "live", run.sensor, run.policy).passed


def main() -> None:
    """Measure what the command line asks for and print a row for each agent."""
    options = _parser().parse_args()
    run = make_run(options.scenario, seed=options.seed, sensor=options.sensor, folder=new_run_folder("live"))
    meter, seconds, passed = measure(run, options.seconds, shared=options.shared)
    rows = [
        {
            "agent": name,
            "rate_hz_median": statistics.median(samples.rates) if samples.rates else None,
            "rate_hz_least": min(samples.rates, default=None),
            "target_hz": TARGETS.get(name),
            "cores": (samples.last - (samples.first or 0.0)) / max(seconds - 1.0, 1.0),
            "beside": samples.beside,
        }
        for name, samples in sorted(meter.agents.items())
    ]
    table = Table("agent", "rate Hz, median / least", "target Hz", "cores")
    for row in rows:
        rate = "-" if row["rate_hz_median"] is None else f"{row['rate_hz_median']:.1f} / {row['rate_hz_least']:.1f}"
        cores = f"with {row['beside']}" if row["beside"] else f"{row['cores']:.2f}"
        table.add_row(str(row["agent"]), rate, str(row["target_hz"] or "-"), cores)
    console = Console()
    console.print(table)
    total = sum(float(str(row["cores"])) for row in rows)
    console.print(f"{total:.2f} cores in all, over {seconds:.0f} s; percepts of an object in view: "
                  f"{meter.percepts_hz():.1f} a second (target 10); passed: {passed}")  # fmt: skip
    if options.json:
        result: dict[str, Any] = {"agents": rows, "percepts_hz": meter.percepts_hz(), "passed": passed}
        options.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.live", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("scenario", nargs="?", default="full_tower")
    parser.add_argument("--sensor", choices=("pixels", "poses"), default="pixels")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=120.0, help="at most so long")
    parser.add_argument("--shared", action="store_true", help="let agents share processes, as the system says")
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    return parser


if __name__ == "__main__":
    main()
