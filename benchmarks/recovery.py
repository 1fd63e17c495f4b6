"""How soon a simulation handler that was killed explains what happened meanwhile, on machines that are ever busier.

    python -m benchmarks.recovery --burners 0 --burners 4 --burners 8 --json recovery.json

Every agent is a process of its own. While so many other processes burn the processors, the handler is killed, and two
cubes are put elsewhere before it is ready again. The limit: all is explained 3 s after it is ready.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from pathlib import Path

from rich.console import Console
from rich.table import Table

from agents.scenario.run.report import ProgressBar
from agents.scenario.run.runner import run_live
from agents.scenario.run.staging import make_run
from agents.scenario.run.story import Line, Topic
from benchmarks.workers import BenchmarkError, Worker, all_of
from dsr.files.private_files import write_json

BURNERS = (0, 4, 8)
LIMIT = 3.0
"""s from ready to explained."""
_SCENE = """\
name = "handler_killed"
title = "The simulation handler is killed, and two cubes are put elsewhere meanwhile"
system = "reasoner"
duration = 60.0
settle = 8.0
camera = { position = [-0.9, 0.0, 1.5], look_at = [0.0, 0.0, 0.72] }
robot = { model = "none" }
table = { size = [0.8, 1.2, 0.04], position = [0.0, 0.0, 0.72] }
random = { position = 0.02 }
[[object]]
name = "cube_1"
marker_id = 1
position = [0.0, 0.1, 0.74]
[[object]]
name = "cube_2"
marker_id = 2
position = [0.0, -0.1, 0.74]
[[event]]
at = 12.0
do = "kill"
agent = "simulation_handler"
[[event]]
at = 12.5
do = "place"
object = "cube_1"
position = [0.15, 0.1, 0.74]
[[event]]
at = 13.0
do = "place"
object = "cube_2"
position = [0.1, -0.25, 0.74]
[[expect]]
check = "belief_error"
tolerance = 0.005
[[expect]]
check = "surprising"
"""
_KILL = 12.0
"""s after the start."""


@dataclass(frozen=True)
class Point:
    """One measurement."""

    burners: int
    seed: int
    load: float
    """Processes that wanted to run, averaged over the last minute, at the end."""
    ready_s: float
    """From the kill until the agent was ready again."""
    explained_s: float
    """From then until the last explanation was in the memory; negative if that was before."""
    right: bool
    """Whether in the end both beliefs are within 5 mm of the truth, and nothing is surprising."""


class _Listener(ProgressBar):
    """Notes when the last explanation came."""

    explained = float("nan")

    def happened(self, elapsed: float, line: Line) -> None:
        """See `Observer`."""
        super().happened(elapsed, line)
        if line.topic is Topic.EXPLANATION and elapsed > _KILL:
            self.explained = elapsed


def measure(burners: int, seed: int, console: Console) -> Point:
    """Kill the handler while so many processes burn the processors. Raises `BenchmarkError`."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "handler_killed.toml"
        file.write_text(_SCENE, encoding="utf-8")
        run = make_run(file, seed=seed, sensor="poses", folder=Path(folder) / "run")
        with all_of(Worker(_burn) for _ in range(burners)), _Listener(run.scenario, console) as listener:
            result = run_live(run, listener)
            load = os.getloadavg()[0]
    if "restart_max_s" not in result.metrics:
        raise BenchmarkError(f"with {burners} burners the simulation handler was never ready again")
    ready = result.metrics["restart_max_s"]
    return Point(burners, seed, load, ready, listener.explained - _KILL - ready, result.passed)


def _burn(connection: Connection) -> None:
    """Compute until the other end closes."""
    while not connection.poll():
        sum(range(100_000))


def main() -> None:
    """Measure what the command line asks for; the exit code is 1 if any was late or wrong."""
    parser = argparse.ArgumentParser(
        "python -m benchmarks.recovery", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--burners", type=int, action="append", help=f"processes; repeatable (default: {BURNERS})")
    parser.add_argument("--seed", type=int, action="append", help="where the cubes start; repeatable (default: 0)")
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    options = parser.parse_args()
    console, table, points = Console(), Table(title=f"recovery; limit: explained {LIMIT:g} s after ready"), []
    for heading in ("burners", "seed", "load", "ready s", "explained s", "right"):
        table.add_column(heading, justify="right")
    for burners in options.burners or BURNERS:
        for seed in options.seed or [0]:
            points.append(point := measure(burners, seed, console))
            cells = [f"{point.load:.1f}", f"{point.ready_s:.1f}", f"{point.explained_s:.1f}", str(point.right)]
            table.add_row(str(burners), str(seed), *cells)
    console.print(table)
    if options.json:
        write_json([asdict(point) for point in points], options.json)
    raise SystemExit(0 if all(point.explained_s <= LIMIT and point.right for point in points) else 1)


if __name__ == "__main__":
    main()
