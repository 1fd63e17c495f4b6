"""The processes of a soak test, on one machine or as if on two that meet at a hub over a wire that can be cut."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.ports import reserved_port
from benchmarks.soak.process import Process, Worker, in_parallel
from benchmarks.soak.relay import Relay
from dsr.clock import Clock
from dsr.errors import TransportError

GRAPH = "soak"
_HUB_TIMEOUT = 30.0
_JOIN_TIMEOUT, _ALONE_TIMEOUT = 30.0, 1.0
"""s that a worker waits for the content of the graph; the first one finds nobody."""
_GENERATION = 1_000_000
"""Steps between the first of a worker and the first of its successor."""
_PAUSE = threading.Event()


@dataclass(frozen=True)
class Plan:
    """Who takes part.

    Args:
        processes: number of workers.
        machines: 1, or 2 that share no runtime folder and are connected by a hub.
        seed: of everything random.
        shifts: by how much the workers' clocks are wrong, in s; in turn.
    """

    processes: int = 4
    machines: int = 2
    seed: int = 0
    shifts: Sequence[float] = (0.0,)


class Hub:
    """A router in a process of its own, at a port that stays the same when it starts again."""

    def __init__(self, folder: Path, clock: Clock) -> None:
        self.port = reserved_port()
        self._log = folder / "hub.log"
        self._clock = clock
        self.start()

    def start(self) -> None:
        """Start it, and return when it can be reached."""
        command = ["-m", "benchmarks.soak.hub", f"tcp/127.0.0.1:{self.port}"]
        self._process = Process(command, {}, self._log)
        deadline = self._clock.monotonic() + _HUB_TIMEOUT
        while True:
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", self.port)):
                return
            if self._clock.monotonic() > deadline:
                raise TransportError(f"the hub cannot be reached; see {self._log}")
            self._clock.wait(_PAUSE, 0.005)

    def kill(self) -> None:
        """End it without a warning."""
        self._process.kill()


class Fleet:
    """The workers, by slot in the order in which they started, and what connects them."""

    def __init__(self, folder: Path, clock: Clock, plan: Plan) -> None:
        self.clock = clock
        self.plan = plan
        self.workers: dict[str, Worker] = {}
        self.hub: Hub | None = None
        self.wire: Relay | None = None
        self._folder = folder
        self._generation = 0
        self._closing = contextlib.ExitStack()
        with contextlib.ExitStack() as started:
            started.callback(self.close)
            self._start()
            started.pop_all()

    def __enter__(self) -> Fleet:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _start(self) -> None:
        if self.plan.machines > 1:
            self.hub = Hub(self._folder, self.clock)
            self._closing.callback(self.hub.kill)
            self.wire = Relay(self.hub.port)
            self._closing.callback(self.wire.close)
        for index in range(self.plan.processes):
            self.admit(self.launch(f"w{index}"))

    def launch(self, slot: str) -> Worker:
        """Start a worker; it has joined when its first answer is there."""
        index = int(slot[1:])
        machine = index % self.plan.machines
        runtime = self._folder / f"machine{machine}"
        runtime.mkdir(mode=0o700, exist_ok=True)
        journal = self._folder / f"{slot}-{self._generation}.journal"
        shift = self.plan.shifts[index % len(self.plan.shifts)]
        numbers = [f"--first={self._generation * _GENERATION}", f"--seed={self.plan.seed + self._generation}"]
        timeout = _JOIN_TIMEOUT if self.workers else _ALONE_TIMEOUT
        self._generation += 1
        return Worker(
            GRAPH, slot, journal, self.clock, {"XDG_RUNTIME_DIR": str(runtime)},
            [*numbers, f"--shift={shift}", f"--timeout={timeout}", *self._connections(machine)],
        )  # fmt: skip

    def _connections(self, machine: int) -> list[str]:
        """How a worker reaches the other machine: the first one is where the hub is, the other behind the wire."""
        if self.hub is None or self.wire is None:
            return []
        return [f"--connect=tcp/127.0.0.1:{self.wire.port if machine else self.hub.port}"]

    def admit(self, worker: Worker) -> None:
        """Wait until a launched worker has joined; it takes the place of the one in its slot, which must be dead."""
        self.workers.pop(worker.slot, None)
        self.workers[worker.slot] = worker
        worker.receive()

    def everybody(self) -> list[Worker]:
        """All workers, the oldest first."""
        return list(self.workers.values())

    def run(self, rate: float) -> None:
        """Let everybody write."""
        in_parallel(self.everybody(), "run", rate=rate)

    def pause(self) -> None:
        """Let nobody write."""
        in_parallel(self.everybody(), "pause")

    def seconds_until_equal(self, since: float, timeout: float) -> float | None:
        """Seconds from the time `since` until all show the same content; None if they do not within `timeout` s."""
        while True:
            answers = in_parallel(self.everybody(), "digest")
            if len({answer["digest"] for answer in answers}) == 1:
                return max(0.0, max(float(answer["at"]) for answer in answers) - since)
            if self.clock.monotonic() - since > timeout:
                return None
            self.clock.wait(_PAUSE, 0.01)

    def close(self) -> None:
        """End all processes."""
        for worker in self.everybody():
            worker.kill()
        self.workers.clear()
        self._closing.close()
