"""What one change costs from the call that writes it to the watch of a reader, without a network between them.

    python -m benchmarks.hop --rounds 3000

One process holds both replicas. Each step is told in calls of Python functions and in processor time: other programs
change the time a little, and the calls not at all. A process that just woke up pays for each call ten times as much.
"""

from __future__ import annotations

import argparse
import statistics
import sys
from collections.abc import Callable
from time import thread_time
from types import FrameType
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table

from benchmarks import workload
from dsr.clock import WALL_CLOCK
from dsr.memory import Memory
from dsr.network.local_transport import LocalNetwork

_WARM = 50
"""Changes before the first that counts."""
STEPS = ("written", "sent", "received, until a watch is told")


class Cost(NamedTuple):
    """Of one step of one kind of change."""

    calls: int
    """Of Python functions."""
    time: float
    """Processor time, s, median."""


class _Pair:
    """A writer and a reader that has all content and a watch; messages are handed over by hand."""

    def __init__(self) -> None:
        network = LocalNetwork(WALL_CLOCK)
        self.writer, self.reader = (workload.local_memory(agent, network) for agent in ("writer", "reader"))
        self.writer.replica.synchroniser.nobody_there()
        workload.fill(self.writer)
        self.writer.flush()
        while not self.reader.joined:
            network.deliver()
            for memory in (self.writer, self.reader):
                memory.poll()
        self.watch = self.reader.watch(existing=False)
        self._messages: list[bytes] = []
        listener = network.connect("listener")
        for key in (self.writer.keys.delta(), self.writer.keys.stream()):
            listener.subscribe(key, lambda _key, payload: self._messages.append(payload))
        self._network = network

    def receive(self) -> Callable[[], object]:
        """What the reader does with the message that the writer has just sent."""
        self._network.deliver()
        payload, replica, sender = self._messages.pop(), self.reader.replica, self.writer.replica.graph.rid
        return lambda: replica.synchroniser.receive_delta(sender, payload, WALL_CLOCK.now())


def _attribute(memory: Memory, number: int) -> None:
    memory.update_node(workload.name(number % workload.NODES), order=number)


def _pose(memory: Memory, number: int) -> None:
    pose = workload.pose(number, number + 2.0)
    memory.update_edge("world", workload.name(number % workload.NODES), "RT", pose=pose)


def _node(memory: Memory, number: int) -> None:
    memory.add_node(f"new_{number}", workload.TYPE, order=number)


CHANGES: dict[str, Callable[[Memory, int], None]] = {"attribute": _attribute, "RT": _pose, "new node": _node}


def measure(change: Callable[[Memory, int], None], rounds: int) -> dict[str, Cost]:
    """The cost of each step of one kind of change."""
    pair, times, calls = _Pair(), {step: list[float]() for step in STEPS}, dict[str, int]()
    for number in range(1, rounds + _WARM):
        steps: list[Callable[[], object]] = [lambda: change(pair.writer, number), pair.writer.replica.flush]  # noqa: B023
        for step, work in zip(STEPS, (*steps, None), strict=True):
            act = work or pair.receive()
            if number == _WARM - 1:
                calls[step] = _calls(act)
            else:
                begin = thread_time()
                act()
                times[step].append(thread_time() - begin)
        pair.watch.poll()
    return {step: Cost(calls[step], statistics.median(times[step][_WARM:])) for step in STEPS}


def _calls(act: Callable[[], object]) -> int:
    count = 0

    def profile(_frame: FrameType, event: str, _argument: Any) -> None:
        nonlocal count
        count += event == "call"

    sys.setprofile(profile)
    try:
        act()
    finally:
        sys.setprofile(None)
    return count


def main() -> None:
    """Measure and show."""
    parser = argparse.ArgumentParser(
        "python -m benchmarks.hop", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=3000, help="changes of each kind (default: 3000)")
    rounds = parser.parse_args().rounds
    table = Table("change", "step", "calls", "us", title="one change in a graph of 1000 nodes")
    for name, change in CHANGES.items():
        for step, cost in measure(change, rounds).items():
            table.add_row(name, step, str(cost.calls), f"{cost.time * 1e6:.1f}")
    Console().print(table)


if __name__ == "__main__":
    main()
