"""Does the whole system keep its rates live, and within how much of the machine? And how soon does a percept change it?

    python -m benchmarks.live                                    # the demo: images, every agent a process of its own
    python -m benchmarks.live full_tower --sensor poses --seconds 20 --json live.json
    python -m benchmarks.live --objects 100 --cameras overhead wrist --shared
    python -m benchmarks.live --day --plot docs/images/live_day.png
    python -m benchmarks.live --images --plot docs/images/live_images.png

Runs a scenario and measures from 3 s after its start on. With `--shared` agents share processes as in `dsr scenario
run`. The rate of an agent is the median and the least of what it told of itself once a second; its processor time comes
from the operating system, children included. What comes from joints and cameras is counted by another replica, that of
the launcher. What the machine was busy with besides is told too: rates mean little beside much of it.

`--day` lives a day instead, compressed and in one process, and tells how much memory that takes, hour by hour
(benchmarks/live/day.py). `--images` tells the processor time of an image by the number of objects in it, and so how
many cores a rate would take (benchmarks/live/images.py).

A scenario takes its seconds, and some 20 s more to start and to be judged. A hundred cubes take a minute more on a busy
machine. A line tells how far it is.
"""

from __future__ import annotations

import argparse
import statistics
import threading
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import psutil
from rich.console import Console
from rich.table import Table

from agents.arm_controller import ArmController
from agents.plant.config import PlantConfig
from agents.scenario.judge.judge import Judge
from agents.scenario.run.runner import Conductor
from agents.scenario.run.staging import PLANT, Run, make_run, staged_system, without
from benchmarks.live import day, images
from benchmarks.live.crowd import write_crowd
from benchmarks.live.hearing import JOINTS, Delays, Ear
from benchmarks.live.processes import Machine, Usage
from benchmarks.progress import progress_on
from benchmarks.report import rows_table
from benchmarks.rows import Row, Spec, judged
from benchmarks.timing import percentile
from dsr.cli.common import new_run_folder
from dsr.runtime.launcher import POLL_PERIOD, Launcher
from dsr.runtime.system import System
from dsr.vocabulary.scenario_start import LEAD

WARM_UP = 3.0
"""s after the start of the scenario that do not count"""
KEPT = 0.98
"""Share of its rate that each agent, joint and camera keeps at least"""
MOST_OF_THE_CORES = 0.6
"""Share of the machine's processor time that the whole system may take"""
SWAP_PERIOD = 4.0
"""s between two swaps in a crowd: an explanation is found meanwhile"""
_IMAGES = 9  # images of each count whose median is told
_MEMORY_PERIOD = 5.0  # s; to add up the pages of a process takes some milliseconds
LAUNCHER = "launcher, judge and this measurement"


@dataclass
class Measured:
    """What came of a run."""

    seconds: float = 0.0
    """s, for which it was measured"""
    rates: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    """Hz, of each agent, one a second"""
    usage: dict[str, Usage] = field(default_factory=lambda: defaultdict(Usage))
    """By agent; of a process that several share, by its first"""
    beside: dict[str, str] = field(default_factory=dict)
    """In whose row the processor time of an agent is told that has no process of its own"""
    heard: dict[str, float] = field(default_factory=dict)
    """How many joint samples and frames came a second"""
    delays: Delays = field(default_factory=Delays)
    others: float = 0.0
    """Cores that were busy with other programs"""
    passed: bool = False

    @property
    def cores(self) -> float:
        """Cores that the whole system took."""
        return sum(usage.spent for usage in self.usage.values()) / self.seconds


def measure(
    run: Run,
    system: System,
    seconds: float,
    *,
    fork: bool = False,
    began: Callable[[], object] = lambda: None,
    tell: Callable[[str], object] = lambda text: None,
) -> Measured:
    """Run a scenario live for at most `seconds`.

    With `fork`, all processes are forks of this one. `began` is called when the start does not count any more. `tell`
    hears once a second how far it is.
    """
    assert run.folder is not None
    found, end = Measured(), min(run.scenario.duration, seconds)
    tell("starting")
    with Launcher(system, run.folder, seed=run.seed, fork=fork) as launcher:
        memory = launcher.memory
        judge = Judge(run.scenario, memory, memory.transport, memory.keys)
        ear = Ear(memory)
        launcher.wait_ready()
        start = launcher.clock.now() + LEAD
        conductor = Conductor(run.scenario, start, judge, memory.transport, memory.keys, lambda agent: None)
        machine: Machine | None = None
        start_of_all = next_look = next_memory = WARM_UP
        while (elapsed := conductor.step(launcher.clock.now())) < end:
            if machine is None and elapsed >= WARM_UP:
                machine, start_of_all = Machine(), elapsed
                ear.begin()
                began()
            if elapsed >= next_look:
                _look(launcher, found, memory=elapsed >= next_memory)
                next_memory += _MEMORY_PERIOD if elapsed >= next_memory else 0.0
                next_look += 1.0
                tell(how_far(elapsed, end, found.rates, system))
            ear.look()
            if conductor.is_over:
                break
            launcher.poll()
            launcher.clock.wait(threading.Event(), POLL_PERIOD)
        if machine is None:
            raise SystemExit(f"nothing was measured: give more than {WARM_UP:g} seconds")
        _look(launcher, found, memory=True)
        found.seconds = elapsed - start_of_all
        found.others = max(0.0, machine.busy() / found.seconds - found.cores)
        found.heard, found.delays = ear.rates(), ear.delays
        ear.close()
        judge.close()
        tell("judging")
        found.passed = judge.result(run.seed, "live", run.sensor, run.policy).passed
    return found


def how_far(elapsed: float, end: float, rates: Mapping[str, Sequence[float]], system: System) -> str:
    """Tell how far a run is (s), and which agent lately kept the least of its rate."""
    text = f"{elapsed:.0f} of {end:.0f} s"
    kept = [
        (lately[-1] / spec.kind.rate_hz, f"; {spec.name} at {lately[-1]:.1f} of {spec.kind.rate_hz:g} Hz")
        for spec in system.agents
        if spec.kind.rate_hz > 0.0 and (lately := rates.get(spec.name))
    ]
    return text + min(kept)[1] if kept else text


def _look(launcher: Launcher, found: Measured, *, memory: bool) -> None:
    """Take note of the rates and of the processes."""
    first_of: dict[int, str] = {}
    for row in launcher.rows():
        if row.heard is not None:
            found.rates[row.agent].append(row.heard.status.rate_hz)
        if row.pid is None:
            continue
        first = first_of.setdefault(row.pid, row.agent)
        if first == row.agent:
            found.usage[first].look(row.pid, memory=memory)
        else:
            found.beside[row.agent] = first
    own = psutil.Process()
    times, usage = own.cpu_times(), found.usage[LAUNCHER]
    usage.last = times.user + times.system
    usage.first = usage.last if usage.first is None else usage.first
    if memory:
        usage.memory.append(own.memory_full_info().pss / 1e6)


def rows_of(found: Measured, system: System) -> list[Row]:
    """What is judged."""
    rows = []
    for spec in system.agents:
        if rates := found.rates.get(spec.name):
            wanted = spec.kind.rate_hz
            rows.append(_kept(f"ticks of {spec.name}", statistics.median(rates), wanted, f"least {min(rates):.1f}"))
    for what, rate in found.heard.items():
        wanted = ArmController.rate_hz if what.startswith(JOINTS) else _camera_hz(system)
        rows.append(_kept(what, rate, wanted, ""))
    share = Spec("share of the cores", "1", MOST_OF_THE_CORES)
    load = f"{found.cores:.2f} of {Machine.cores} cores, others {found.others:.2f}"
    rows.append(judged(share, found.cores / Machine.cores, (), load))
    for name, what, delays in (
        ("percept to the belief that it changes", "written to heard", found.delays.changed),
        ("image to the belief that it changes", "taken to heard", found.delays.seen),
        ("percept elsewhere to the belief there", "the frames that confirm it included", found.delays.followed),
    ):
        for share_of, quantile in (("p50", 0.5), ("p95", 0.95)) if delays else ():
            value = percentile(delays, quantile) * 1e3
            rows.append(judged(Spec(f"{name}, {share_of}", "ms"), value, (), f"{what}; {len(delays)} times"))
    return rows


def _kept(what: str, rate: float, wanted: float, note: str) -> Row:
    spec = Spec(what, "Hz", KEPT * wanted, "higher")
    return judged(spec, rate, (), "; ".join(filter(None, [f"{wanted:g} Hz wanted", note])))


def _camera_hz(system: System) -> float:
    """Frames a second that the plant is configured to give."""
    return msgspec.convert(dict(system.agent(PLANT).config), PlantConfig).camera_hz


def usage_table(found: Measured) -> Table:
    """Processor time and memory of each process."""
    table = Table("process of", "cores", "MB, first", "last", title="processes")
    for name, usage in sorted(found.usage.items()):
        others = [agent for agent, first in found.beside.items() if first == name]
        first, last = (f"{usage.memory[place]:.0f}" if usage.memory else "-" for place in (0, -1))
        table.add_row(", ".join([name, *others]), f"{usage.spent / found.seconds:.2f}", first, last)
    return table


def main() -> None:
    """Measure what the command line asks for."""
    options = _parser().parse_args()
    if options.images:
        images.main(_IMAGES, options.plot)
        return
    if options.day:
        raise SystemExit(day.main(options.hours, options.day_seconds, options.seed, options.plot, options.json))
    folder = new_run_folder("live")
    scenario = options.scenario
    if options.objects:
        scenario = write_crowd(folder, options.objects, options.seconds, SWAP_PERIOD)
    run = make_run(scenario, seed=options.seed, sensor=options.sensor, folder=folder)
    system = _system(run, options)
    with progress_on(Console(stderr=True)) as progress:
        found = measure(run, system, options.seconds, tell=progress.step)
    rows, console = rows_of(found, system), Console()
    console.print(rows_table(rows))
    console.print(usage_table(found))
    met = [row.meets for row in rows if row.meets is not None]
    console.print(
        f"{sum(met)} of {len(met)} targets met over {found.seconds:.0f} s; the scenario passed: {found.passed}"
    )
    if options.json:
        usage = {name: {"cores": one.spent / found.seconds, "mb": one.memory} for name, one in found.usage.items()}
        result: dict[str, Any] = {"rows": rows, "processes": usage, "passed": found.passed}
        options.json.write_bytes(msgspec.json.format(msgspec.json.encode(result)) + b"\n")


def _system(run: Run, options: argparse.Namespace) -> System:
    """What runs, but for the viewer, which is for people."""
    system = without(staged_system(run), "viewer")
    if options.cameras:
        system = system.with_config(PLANT, more_cameras=tuple(options.cameras))
    return system if options.shared else system.apart(*(spec.name for spec in system.agents))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.live", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("scenario", nargs="?", default="towers")
    parser.add_argument("--sensor", choices=("pixels", "poses"), default="pixels")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=60.0, help="at most so long")
    parser.add_argument("--objects", type=int, default=0, help="instead of a scenario, so many cubes that swap places")
    parser.add_argument("--cameras", nargs="+", default=(), help="cameras that deliver, beside the scenario's")
    parser.add_argument("--shared", action="store_true", help="let agents share processes, as the system says")
    parser.add_argument("--day", action="store_true", help="a day, hour by hour, instead")
    parser.add_argument("--hours", type=int, default=24, help="of the day")
    parser.add_argument("--day-seconds", type=float, default=15.0, help="of each hour that are lived")
    parser.add_argument("--images", action="store_true", help="what images cost by how much is in them, instead")
    parser.add_argument("--plot", type=Path, help="draw the day, or the images' cost, into this PNG")
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    return parser


if __name__ == "__main__":
    main()
