"""Handles on the processes of a soak test: started, told what to do, stopped, killed."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from dsr.clock import Clock
from dsr.errors import DsrError

ANSWER_TIMEOUT = 60.0
"""s: far beyond what is expected; who takes longer hangs."""


class WorkerError(DsrError):
    """A worker ended or does not answer."""


class Process:
    """A process of which nothing is left when it is closed; its errors go to `log`."""

    def __init__(self, command: Sequence[str], environment: Mapping[str, str], log: Path) -> None:
        with log.open("ab") as errors:
            self._process = subprocess.Popen(
                [sys.executable, *command], env={**os.environ, **environment}, stdin=subprocess.PIPE,
                stdout=subprocess.PIPE, stderr=errors, bufsize=0, start_new_session=True,
            )  # fmt: skip
        self._log = log

    def stop(self) -> None:
        """Freeze it (SIGSTOP)."""
        self._process.send_signal(signal.SIGSTOP)

    def go_on(self) -> None:
        """Unfreeze it (SIGCONT)."""
        self._process.send_signal(signal.SIGCONT)

    def kill(self) -> None:
        """End it without a warning (SIGKILL)."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()


class Worker(Process):
    """A `benchmarks.soak.worker`: one command at a time is sent and answered.

    Args:
        graph: that it joins.
        slot: that it writes for.
        journal: of its writes.
        clock: for time-outs.
        environment: tells it which machine it is on.
        options: further arguments of `benchmarks.soak.worker`.
    """

    def __init__(
        self, graph: str, slot: str, journal: Path, clock: Clock, environment: Mapping[str, str],
        options: Sequence[str] = (),
    ) -> None:  # fmt: skip
        command = ["-m", "benchmarks.soak.worker", graph, slot, str(journal), *options]
        super().__init__(command, environment, journal.with_suffix(".log"))
        self.slot = slot
        self.journal = journal
        self._clock = clock
        self._received = b""

    def send(self, name: str, **arguments: Any) -> None:
        """Tell it what to do; `receive` gets the answer."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(msgspec.json.encode({"do": name, **arguments}) + b"\n")
        except OSError as error:
            raise self._failure("ended") from error

    def receive(self, timeout: float = ANSWER_TIMEOUT) -> Any:
        """The answer to what was sent; the first one says that it has joined. Raises `WorkerError`."""
        assert self._process.stdout is not None
        deadline = self._clock.monotonic() + timeout
        while b"\n" not in self._received:
            remaining = deadline - self._clock.monotonic()
            if remaining <= 0 or not select.select([self._process.stdout], [], [], remaining)[0]:
                raise self._failure(f"does not answer within {timeout:.0f} s")
            piece = os.read(self._process.stdout.fileno(), 1 << 16)
            if not piece:
                raise self._failure("ended")
            self._received += piece
        line, _, self._received = self._received.partition(b"\n")
        return msgspec.json.decode(line)

    def do(self, name: str, **arguments: Any) -> Any:
        """Send a command and return the answer."""
        self.send(name, **arguments)
        return self.receive()

    def _failure(self, what: str) -> WorkerError:
        last = self._log.read_text(encoding="utf-8", errors="replace").strip().splitlines()[-1:]
        return WorkerError(f"worker {self.slot} {what}{': ' if last else ''}{''.join(last)}")


def in_parallel(workers: Sequence[Worker], name: str, **arguments: Any) -> list[Any]:
    """Give all the same command and collect the answers, in the same order."""
    for worker in workers:
        worker.send(name, **arguments)
    return [worker.receive() for worker in workers]
