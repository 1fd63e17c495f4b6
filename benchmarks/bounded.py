"""Does the memory stay as small as its content? A week of a robot's life, compressed, with its size hour by hour.

    python -m benchmarks.bounded --json bounded.json --plot bounded.png

Three replicas on a network in memory and a clock that is moved by hand. Of each simulated hour some seconds are lived
at full rate: 50 Hz poses, attributes, nodes and edges that come and go, a partition and its healing, and, if wanted,
agents that are killed and come back as new replicas; the rest of the hour passes without events. Exit 0 only if the
state is as large in the last hour as in the second.
"""

from __future__ import annotations

import argparse
import gc
import json
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import psutil
from rich.console import Console
from rich.progress import track
from rich.table import Table

from dsr import LocalNetwork, ManualClock, Memory, Pose

HOURS = 7 * 24
RATE_HZ = 50
EDGES = 4
CYCLED = 10
"""Nodes that come and go each second, with an edge each."""
RECREATED, CYCLES = 100, 1000
_WIDENING = 24
"""Bytes by which the counters of a node or edge (six with two attributes) widen in a message as they grow."""
_PER_REPLICA = 40
"""Bytes of an entry of the context."""


@dataclass(frozen=True)
class Size:
    """How large everything is after some time."""

    hour: float
    state_bytes: int
    """The whole state as one message."""
    entries: int
    """Nodes and edges that the state holds."""
    context_ranges: int
    """Replicas and gaps that the causal context tells apart."""
    waiting: int
    """Writes and edges that wait for something."""
    blocks: int
    """Pieces of memory that Python holds."""
    resident_bytes: int


class Life:
    """Three replicas, of which the last may be killed and come back."""

    def __init__(self) -> None:
        self.clock = ManualClock()
        self.network = LocalNetwork(self.clock)
        self._starts = 0
        self.memories = [self._start(name) for name in ("arm", "estimator", "planner")]
        self._ticks = 0
        arm = self.memories[0]
        for name in ("world", *(f"body_{index}" for index in range(EDGES))):
            arm.add_node(name, "body")
        for index in range(EDGES):
            arm.add_edge("world", f"body_{index}", "RT", pose=self._pose(index))
        self.pass_time(2.0)

    def _start(self, name: str) -> Memory:
        self._starts += 1
        rid = f"{name}-{self._starts:08x}"
        return Memory("g", name, transport=self.network.connect(name), clock=self.clock, rid=rid)

    def _pose(self, index: int) -> Pose:
        return Pose((0.001 * (self._ticks % 1000), 0.1 * index, 0.0), stamp=self.clock.now())

    def restart(self) -> None:
        """Kill the last replica without a goodbye and start another one in its place."""
        self.memories[-1].transport.close()
        self.memories[-1] = self._start("planner")
        self.pass_time(2.0)

    def exchange(self) -> None:
        """Deliver and merge what was sent."""
        for memory in self.memories:
            memory.flush()
        self.network.deliver()
        for memory in self.memories:
            memory.poll()

    def pass_time(self, seconds: float, step: float = 0.1) -> None:
        """Nothing happens but the exchange of messages."""
        for _ in range(round(seconds / step)):
            self.clock.advance(step)
            self.exchange()

    def busy_second(self) -> None:
        """One second at full rate."""
        arm, estimator, planner = self.memories
        names = [f"thing_{index}" for index in range(CYCLED)]
        for name in names:
            planner.add_node(name, "cube", mass=0.1)
            planner.add_edge("world", name, "on", since=self.clock.now())
        for tick in range(RATE_HZ):
            self._ticks += 1
            self.clock.advance(1.0 / RATE_HZ)
            with arm.batch():
                for index in range(EDGES):
                    arm.update_edge("world", f"body_{index}", "RT", pose=self._pose(index))
            if "body_0" in estimator:
                estimator.update_node("body_0", seen=self._ticks, note=f"{tick:02d}")
            self.exchange()
        for name in names:
            planner.remove_node(name)
        self.exchange()

    def partition(self) -> None:
        """Two seconds in which each replica writes on its own; then all meet again."""
        self.network.partition(*([memory.agent] for memory in self.memories))
        self.busy_second()
        self.memories[0].add_node("doubly", "cube", seen=1)
        self.memories[1].add_node("doubly", "box", seen=2)
        self.pass_time(1.0)
        self.network.heal()
        self.pass_time(3.0)
        self.memories[0].remove_node("doubly")
        self.pass_time(1.0)

    def size(self, hour: float) -> Size:
        """How large everything is now; of the replica where it is largest."""
        stores = [memory._graph.store for memory in self.memories]
        gc.collect()
        return Size(
            hour,
            max(len(memory.snapshot()) for memory in self.memories),
            max(len(store.entries) for store in stores),
            max(len(list(store.context.ranges())) for store in stores),
            sum(len(store._waiting) for store in stores) + sum(len(m._graph._unattached) for m in self.memories),
            sys.getallocatedblocks(),
            psutil.Process().memory_info().rss,
        )


def live(hours: int, seconds: int, *, restarts: bool) -> Iterator[Size]:
    """A life of `hours`, of each `seconds` at full rate; its size after each."""
    life = Life()
    for hour in range(1, hours + 1):
        for _ in range(seconds):
            life.busy_second()
        life.partition()
        if restarts:
            life.restart()
        life.clock.advance(3600.0 - seconds)
        life.pass_time(5.0)
        yield life.size(float(hour))


def recreate(nodes: int, cycles: int) -> tuple[Size, Size]:
    """The size after the first and after the last cycle of deleting and creating the same nodes."""
    life = Life()
    sizes = []
    for cycle in range(cycles):
        for index in range(nodes):
            life.memories[0].add_node(f"n{index}", "cube", mass=float(cycle), seen=cycle)
        life.exchange()
        if cycle in (0, cycles - 1):
            life.pass_time(3.0)
            sizes.append(life.size(float(cycle + 1)))
        for index in range(nodes):
            life.memories[0].remove_node(f"n{index}")
        life.exchange()
    return sizes[0], sizes[1]


def is_flat(first: Size, last: Size, replicas: int = 0) -> bool:
    """Whether the state and the context have not grown, but for an entry for each of so many new replicas."""
    return (
        last.entries == first.entries
        and last.state_bytes <= first.state_bytes + _WIDENING * first.entries + _PER_REPLICA * replicas
        and last.context_ranges <= first.context_ranges + replicas
        and last.waiting == 0
    )


def main() -> None:
    """Live as the command line asks; print what it came to; exit 1 if something grew."""
    options = _parser().parse_args()
    curves: dict[str, list[Size]] = {}
    for name in ("week", "week with a restart each hour"):
        sizes = live(options.hours, options.seconds, restarts="restart" in name)
        curves[name] = list(track(sizes, name, total=options.hours, console=Console(stderr=True)))
    curves[f"{RECREATED} nodes, {options.cycles} times"] = list(recreate(RECREATED, options.cycles))
    flat = {
        name: is_flat(sizes[min(1, len(sizes) - 2)], sizes[-1], options.hours if "restart" in name else 0)
        for name, sizes in curves.items()
    }
    Console().print(_table(curves, flat))
    if options.json:
        data = {name: {"flat": flat[name], "sizes": [asdict(size) for size in sizes]} for name, sizes in curves.items()}
        options.json.write_text(json.dumps(data, indent=1), encoding="utf-8")
    if options.plot:
        _plot(curves, options.plot)
    raise SystemExit(0 if all(flat.values()) else 1)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m benchmarks.bounded", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--hours", type=int, default=HOURS, help=f"to live, at least 2 (default: {HOURS}, a week)")
    parser.add_argument("--seconds", type=int, default=20, help="of each hour at full rate (default: 20)")
    parser.add_argument("--cycles", type=int, default=CYCLES, help=f"of deleting and creating (default: {CYCLES})")
    parser.add_argument("--json", type=Path, help="write all sizes to this file")
    parser.add_argument("--plot", type=Path, help="draw the curves into this PNG")
    return parser


def _table(curves: dict[str, list[Size]], flat: dict[str, bool]) -> Table:
    table = Table(title="Size at the beginning and at the end")
    for heading in ("", "bytes", "entries", "context", "waiting", "blocks", "MB", "flat"):
        table.add_column(heading, justify="right" if heading else "left", no_wrap=True)
    for name, sizes in curves.items():
        first, last = sizes[min(1, len(sizes) - 2)], sizes[-1]
        changes = [f"{before} -> {after}" for before, after in zip(_cells(first), _cells(last), strict=True)]
        table.add_row(name, *changes, "yes" if flat[name] else "[red]NO[/red]")
    return table


def _cells(size: Size) -> tuple[int, ...]:
    return (
        size.state_bytes, size.entries, size.context_ranges, size.waiting, size.blocks, size.resident_bytes // 10**6
    )  # fmt: skip


def _plot(curves: dict[str, list[Size]], file: Path) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    panels = (("state_bytes", "state, bytes"), ("entries", "nodes and edges"), ("context_ranges", "context, ranges"),
              ("blocks", "Python memory blocks"), ("resident_bytes", "resident, bytes"))  # fmt: skip
    figure, axes = plt.subplots(len(panels), 1, figsize=(9, 12), sharex=True)
    for (field, title), ax in zip(panels, axes, strict=True):
        for name, sizes in curves.items():
            if len(sizes) > 2:
                ax.plot([size.hour for size in sizes], [getattr(size, field) for size in sizes], label=name)
        ax.set_ylabel(title)
        ax.set_ylim(0, 1.15 * ax.get_ylim()[1])
        ax.grid(alpha=0.3)
    axes[0].legend()
    axes[-1].set_xlabel("simulated hours")
    figure.savefig(file, bbox_inches="tight", dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    main()
