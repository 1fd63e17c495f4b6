"""Late join as a curve: many newcomers at once to a graph of up to a million nodes, while its holder goes on writing.

    python -m benchmarks.late_join --nodes 1000 --nodes 10000 --newcomers 2 --newcomers 8 --json join.json --plots .

Each measurement starts a holder and newcomers in processes of their own, on Zenoh. The holder writes one attribute
every 10 ms, and the duration of each write is noted. The newcomers begin at the same moment; their interpreters run.
"""

from __future__ import annotations

import argparse
import json
import resource
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

import dsr
from benchmarks import workload
from benchmarks.timing import monotonic, sleep
from benchmarks.workers import BenchmarkError, Worker

SIZES = (1000, 10_000, 100_000)
NEWCOMERS = (2, 8)
PERIOD = 0.01
"""s between two writes of the holder."""
QUIET = 2.0
"""s for which the holder writes before the newcomers begin, to compare with."""
PATIENCE = 600.0
"""s until a newcomer without any progress gives up, or the whole measurement does."""


@dataclass(frozen=True)
class Point:
    """One measurement."""

    nodes: int
    newcomers: int
    complete_s: list[float]
    """From `dsr.connect` until all is there, of each newcomer."""
    worst_write_ms: float
    """Longest write of the holder while they joined."""
    worst_write_before_ms: float
    """And before they came."""
    holder_mb: float
    """Greatest resident memory."""
    newcomer_mb: float
    """The greatest of any newcomer."""


def measure(nodes: int, newcomers: int) -> Point:
    """Let `newcomers` join a graph of `nodes` at once."""
    graph = f"late-{nodes}-{newcomers}"
    with Worker(_hold, graph, nodes) as holder:
        holder.receive(PATIENCE)
        workers = [Worker(_join, graph, number, nodes) for number in range(newcomers)]
        try:
            for worker in workers:
                worker.receive(PATIENCE)
            sleep(QUIET)
            before = float(holder.ask("worst"))
            for worker in workers:
                worker.send("go")
            joined = [worker.receive(PATIENCE) for worker in workers]
            worst = float(holder.ask("worst"))
            memory = float(holder.ask("memory"))
        finally:
            for worker in workers:
                worker.close()
    times, sizes = [seconds for seconds, _ in joined], [size for _, size in joined]
    return Point(nodes, newcomers, sorted(times), worst * 1e3, before * 1e3, memory, max(sizes))


def _hold(connection: Connection, graph: str, nodes: int) -> None:
    """Hold the content and write all the time; tell the longest write since the last question."""
    with dsr.connect(graph, agent="holder") as memory:
        workload.fill(memory, nodes, edges=False)
        connection.send("ready")
        number = 0
        worst = 0.0
        while True:
            begin = monotonic()
            memory.update_node(workload.name(number % nodes), order=number)
            worst = max(worst, monotonic() - begin)
            number += 1
            sleep(PERIOD)
            if not connection.poll():
                continue
            try:
                asked = connection.recv()
            except EOFError:
                return
            connection.send(worst if asked == "worst" else _resident())
            worst = 0.0


def _join(connection: Connection, graph: str, number: int, nodes: int) -> None:
    connection.send("ready")
    connection.recv()
    start = monotonic()
    with dsr.connect(graph, agent=f"newcomer{number}", timeout=PATIENCE) as memory:
        taken = monotonic() - start
        if not workload.is_complete(memory, nodes, edges=False):
            raise BenchmarkError(f"joined with {len(memory.nodes())} of {nodes} nodes")
        connection.send((taken, _resident()))
        connection.poll(PATIENCE)


def _resident() -> float:
    """Greatest resident memory of this process, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def plot(points: list[Point], folder: Path) -> None:
    """Write `late_join.png`: time to complete, worst write and memory over the number of nodes."""
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(3, 1, figsize=(8, 10), sharex=True)
    for count in sorted({point.newcomers for point in points}):
        line = sorted((p for p in points if p.newcomers == count), key=lambda point: point.nodes)
        sizes, label = [p.nodes for p in line], f"{count} newcomers"
        axes[0].loglog(sizes, [p.complete_s[-1] for p in line], "o-", label=label)
        axes[1].loglog(sizes, [p.worst_write_ms for p in line], "o-", label=label)
        axes[2].loglog(sizes, [p.newcomer_mb for p in line], "o-", label=label)
    for axis, name in zip(axes, ("last one complete, s", "longest write, ms", "newcomer, MB"), strict=True):
        axis.set_ylabel(name)
        axis.grid(visible=True, alpha=0.3)
    axes[0].legend()
    axes[2].set_xlabel("nodes of five attributes")
    figure.tight_layout()
    figure.savefig(folder / "late_join.png", dpi=110)


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(
        "python -m benchmarks.late_join", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--nodes", type=int, action="append", help=f"of the graph; repeatable (default: {SIZES})")
    parser.add_argument("--newcomers", type=int, action="append", help=f"likewise (default: {NEWCOMERS})")
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    parser.add_argument("--plots", type=Path, help="also write late_join.png into this folder")
    options = parser.parse_args()
    points = []
    console, table = Console(), Table(title="late join")
    for heading in ("nodes", "newcomers", "first s", "last s", "write ms", "before ms", "holder MB", "newcomer MB"):
        table.add_column(heading, justify="right")
    for nodes in options.nodes or SIZES:
        for newcomers in options.newcomers or NEWCOMERS:
            points.append(point := measure(nodes, newcomers))
            console.print(point)
            table.add_row(*map(str, _cells(point)))
    console.print(table)
    if options.json:
        options.json.write_text(json.dumps([asdict(point) for point in points], indent=1), encoding="utf-8")
    if options.plots:
        plot(points, options.plots)


def _cells(point: Point) -> list[Any]:
    return [
        point.nodes, point.newcomers, f"{point.complete_s[0]:.2f}", f"{point.complete_s[-1]:.2f}",
        f"{point.worst_write_ms:.1f}", f"{point.worst_write_before_ms:.1f}", f"{point.holder_mb:.0f}",
        f"{point.newcomer_mb:.0f}",
    ]  # fmt: skip


if __name__ == "__main__":
    main()
