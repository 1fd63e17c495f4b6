"""Does the system stay as small as its scene? A day of all agents, compressed, with its size hour by hour.

All agents of the demo run in lockstep in one process, on a clock that is moved by hand. At the beginning of each hour
some seconds are lived with everything that happens in them: percepts, swaps of cubes, explanations, entries of the
timeline, the recording. Then the clock moves on to the next hour, through which nobody ticks. The plant begins anew
each hour, as a scenario has an end; all others live on. What one process holds is the sum of what fourteen would.
"""

from __future__ import annotations

import gc
import json
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import msgspec
import psutil
from rich.console import Console
from rich.table import Table

from agents.scenario.run.staging import PLANT, make_run, staged_system, without
from benchmarks.live.crowd import write_crowd
from dsr.cli.common import new_run_folder
from dsr.runtime.lockstep import Lockstep
from dsr.vocabulary.scenario_start import LEAD, Start, start_key

OBJECTS, SWAP_PERIOD = 4, 4.0
HOUR = 3600.0  # s
SETTLED = 3
"""Hours after which caches are full and summaries have begun: from then on it is judged"""
GROWTH = 0.1
"""Share by which the resident memory may be greater at the end than then: what an allocator leaves in pieces"""


@dataclass(frozen=True)
class Size:
    """How large everything is after some hours."""

    hour: int
    resident_mb: float
    blocks: int
    """Pieces of memory that Python holds."""
    nodes: int
    edges: int
    snapshot_kb: float
    """The whole memory as one message."""


def live(hours: int, seconds: float, seed: int) -> Iterator[Size]:
    """Live so many hours, `seconds` of each; the size after each."""
    folder = new_run_folder("live-day")
    file = write_crowd(folder, OBJECTS, seconds, SWAP_PERIOD)
    run = make_run(file, seed=seed, sensor="poses", folder=folder)
    system = without(staged_system(run), "viewer")
    with Lockstep(system.agents, graph=system.graph, seed=seed) as lockstep:
        begin = lockstep.clock.now()
        for hour in range(1, hours + 1):
            if hour > 1:
                lockstep.kill(PLANT)
                lockstep.restart(PLANT)
            start = Start(lockstep.clock.now() + LEAD)
            lockstep.bus.publish(start_key(lockstep.keys), msgspec.msgpack.encode(start))
            lockstep.run_for(LEAD + seconds)
            yield _size(hour, lockstep)
            lockstep.suspend(max(0.0, begin + hour * HOUR - lockstep.clock.now()))


def _size(hour: int, lockstep: Lockstep) -> Size:
    gc.collect()
    memory = lockstep.memory
    return Size(
        hour, psutil.Process().memory_info().rss / 1e6, sys.getallocatedblocks(), len(memory.nodes()),
        len(memory.edges()), len(memory.snapshot()) / 1e3,
    )  # fmt: skip


def is_bounded(sizes: list[Size]) -> bool:
    """Whether the last hours are no larger than those after the first ones, within `GROWTH`."""
    settled = sizes[min(SETTLED, len(sizes)) - 1]
    return sizes[-1].resident_mb <= (1.0 + GROWTH) * settled.resident_mb


def main(hours: int, seconds: float, seed: int, plot: Path | None, file: Path | None) -> int:
    """Live a day; print it, and draw it. Returns the exit code: 1 if it grew."""
    sizes = []
    for size in live(hours, seconds, seed):
        Console(stderr=True).print(f"hour {size.hour} of {hours}: {size.resident_mb:.0f} MB, {size.nodes} nodes")
        sizes.append(size)
    bounded = is_bounded(sizes)
    Console().print(_table(sizes))
    Console().print(f"bounded after hour {SETTLED}: {'yes' if bounded else 'NO'}")
    if file:
        file.write_text(json.dumps([asdict(size) for size in sizes], indent=1) + "\n", encoding="utf-8")
    if plot:
        draw(sizes, plot)
    return 0 if bounded else 1


def _table(sizes: list[Size]) -> Table:
    table = Table(title="the whole system in one process")
    for heading in ("hour", "resident MB", "blocks", "nodes", "edges", "snapshot KB"):
        table.add_column(heading, justify="right")
    for size in sizes:
        table.add_row(
            str(size.hour), f"{size.resident_mb:.0f}", str(size.blocks), str(size.nodes), str(size.edges),
            f"{size.snapshot_kb:.0f}",
        )  # fmt: skip
    return table


def draw(sizes: list[Size], file: Path) -> None:
    """Draw the curves into a PNG."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    panels = (("resident_mb", "resident, MB"), ("blocks", "blocks of Python"), ("nodes", "nodes"),
              ("snapshot_kb", "snapshot, KB"))  # fmt: skip
    figure, axes = plt.subplots(len(panels), 1, figsize=(8, 9), sharex=True)
    for (name, title), axis in zip(panels, axes, strict=True):
        axis.plot([size.hour for size in sizes], [getattr(size, name) for size in sizes], "o-", color="#c8102e")
        axis.set_ylabel(title)
        axis.set_ylim(0, 1.15 * axis.get_ylim()[1])
        axis.grid(alpha=0.3)
    axes[-1].set_xlabel("simulated hours")
    figure.savefig(file, bbox_inches="tight", dpi=110)
    plt.close(figure)
