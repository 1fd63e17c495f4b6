"""The process that a soak test starts many of: it joins a graph, writes, and obeys its standard input.

A command is a JSON object a line, `{"do": NAME, ...}`; each is answered by one line. The process ends with its input.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from benchmarks.soak import races
from benchmarks.soak.journal import JournalWriter
from benchmarks.soak.workload import Workload
from dsr.clock import WALL_CLOCK, WallClock
from dsr.connecting import connect
from dsr.errors import DsrError
from dsr.graph.elements import Edge, Node
from dsr.math3d.transforms import Pose
from dsr.memory import Memory

_PAUSE = threading.Event()


class ShiftedClock(WallClock):
    """The machine's clock, set wrong by `shift` s."""

    def __init__(self, shift: float) -> None:
        self._shift = shift

    def now(self) -> float:
        """Seconds since the Unix epoch, and the shift."""
        return super().now() + self._shift


class Writer:
    """Performs a workload in a thread of its own, at a rate that may change."""

    def __init__(self, workload: Workload) -> None:
        self._workload = workload
        self._wanted = threading.Condition()
        self._busy = threading.Lock()
        self._rate: float | None = None
        self.failure = ""
        """Why it stopped writing by itself."""
        threading.Thread(target=self._run, name="writer", daemon=True).start()

    def run(self, rate: float) -> None:
        """Perform `rate` steps/s from now on; as many as possible if 0."""
        with self._wanted:
            self._rate = rate
            self._wanted.notify()

    def pause(self) -> None:
        """Return when no write is under way and none will begin."""
        self._rate = None
        with self._busy:
            return

    def burst(self, count: int) -> None:
        """Perform `count` steps at once."""
        with self._busy:
            for _ in range(count):
                self._workload.step()

    def _run(self) -> None:
        while True:
            with self._wanted:
                self._wanted.wait_for(lambda: self._rate is not None)
            with self._busy:
                rate = self._rate
                if rate is not None:
                    self._step()
            if rate:
                WALL_CLOCK.wait(_PAUSE, 1.0 / rate)

    def _step(self) -> None:
        try:
            self._workload.step()
        except DsrError as error:
            self.failure, self._rate = f"{type(error).__name__}: {error}", None


def content(memory: Memory) -> dict[str, dict[str, Any]]:
    """Everything that a replica shows, by name; edges as "source destination type"."""
    elements = {node.name: _plain(node) for node in memory.nodes()}
    elements.update({" ".join(edge.key): _plain(edge) for edge in memory.edges()})
    return dict(sorted(elements.items()))


def _plain(element: Node | Edge) -> dict[str, Any]:
    values = {name: element.get(name) for name in element}
    return {"type": element.type} | {
        name: [*value.t, *value.q, value.stamp] if isinstance(value, Pose) else value for name, value in values.items()
    }


class Worker:
    """Carries out commands; each method is one."""

    def __init__(self, memory: Memory, writer: Writer, workload: Workload) -> None:
        self._memory = memory
        self._writer = writer
        self._workload = workload

    def run(self, rate: float) -> None:
        """Write by itself, `rate` steps/s; as many as possible if 0."""
        self._writer.run(rate)

    def pause(self) -> None:
        """Stop writing by itself."""
        self._writer.pause()

    def burst(self, count: int) -> None:
        """Perform `count` steps at once."""
        self._writer.burst(count)

    def prepare_race(self, race: str, names: list[str]) -> None:
        """See `benchmarks.soak.races.prepare`."""
        races.prepare(self._memory, race, names)

    def run_race(self, race: str, names: list[str], role: int, times: list[float]) -> list[float]:
        """See `benchmarks.soak.races.run`."""
        return races.run(self._memory, race, names, role, times)

    def tidy(self) -> None:
        """Remove what a predecessor left."""
        self._workload.tidy()

    def digest(self) -> dict[str, Any]:
        """A short form of everything that is seen here, and when."""
        shown = msgspec.json.encode(content(self._memory))
        return {"digest": hashlib.blake2b(shown, digest_size=8).hexdigest(), "at": WALL_CLOCK.monotonic()}

    def state(self) -> dict[str, Any]:
        """Everything that is seen here."""
        return content(self._memory)

    def report(self) -> dict[str, Any]:
        """How it is doing."""
        return {
            "peers": len(self._memory.peers), "failure": self._writer.failure,
            "statistics": self._memory.statistics._asdict(),
        }  # fmt: skip


def main() -> None:
    """Join, say hello, obey until the input ends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("graph")
    parser.add_argument("slot")
    parser.add_argument("journal", type=Path)
    parser.add_argument("--connect", action="append", default=[])
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--shift", type=float, default=0.0)
    parser.add_argument("--timeout", type=float, default=30.0)
    arguments = parser.parse_args()
    memory = connect(
        arguments.graph, arguments.slot, connect=arguments.connect, clock=ShiftedClock(arguments.shift),
        timeout=arguments.timeout,
    )  # fmt: skip
    with memory:
        generator = np.random.default_rng(arguments.seed)
        workload = Workload(
            memory, arguments.slot, JournalWriter(arguments.journal), arguments.first, generator, WALL_CLOCK
        )
        obey(Worker(memory, Writer(workload), workload))


def obey(worker: object) -> None:
    """Answer commands from the standard input until it ends."""
    _answer(None)
    for line in sys.stdin:
        command = msgspec.json.decode(line)
        action: Callable[..., Any] = getattr(worker, command.pop("do"))
        _answer(action(**command))


def _answer(value: Any) -> None:
    sys.stdout.write(msgspec.json.encode(value).decode() + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
