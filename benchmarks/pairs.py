"""A writer and readers at the ends of a link, each a process, and what they can be told to do."""

from __future__ import annotations

from collections.abc import Callable
from multiprocessing.connection import Connection
from types import TracebackType

from benchmarks.links import Link
from benchmarks.timing import monotonic, sleep, sleep_until
from benchmarks.workers import BenchmarkError, Worker, commands

PERIOD = 0.01
"""s between two messages at 100 Hz."""
_COLD = 10
"""Messages at the start of a burst that do not count."""
_ON_ITS_WAY = 0.1  # s


class Latencies:
    """A writer and one reader: how long messages take."""

    def __init__(self, link: Link) -> None:
        self._writer = Worker(_write, link)
        self._reader: Worker | None = None
        self._next = 1
        try:
            self._writer.receive()
            self._reader = Worker(_read, link)
            self._reader.receive()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Latencies:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def burst(self, count: int, *, busy: bool = False) -> list[float]:
        """How long each of `count` messages took, s; `busy` keeps the reader's main thread in Python meanwhile."""
        assert self._reader is not None
        first, self._next = self._next, self._next + count + _COLD
        if busy:
            self._reader.send((count + _COLD) * PERIOD + _ON_ITS_WAY)
        sent = self._writer.ask((first, count + _COLD))
        sleep(_ON_ITS_WAY)
        received = self._reader.ask(None)
        taken = [received[number] - start for number, start in sent[_COLD:] if number in received]
        if len(taken) < count / 2:
            raise BenchmarkError(f"only {len(taken)} of {count} messages arrived")
        return taken

    def close(self) -> None:
        """End both processes."""
        for worker in (self._reader, self._writer):
            if worker is not None:
                worker.close()


def _write(connection: Connection, link: Link) -> None:
    """Send the bursts (first number, count) that are asked for; answer with each number and when it was sent."""
    writer = link.writer()
    connection.send("ready")
    for first, count in commands(connection):
        start = monotonic() + PERIOD
        connection.send([_send_at(writer.send, first + i, start + i * PERIOD) for i in range(count)])
    writer.close()


def _send_at(send: Callable[[int], None], number: int, due: float) -> tuple[int, float]:
    sleep_until(due)
    start = monotonic()
    send(number)
    return number, start


def _read(connection: Connection, link: Link) -> None:
    """Be busy for as many seconds as asked for; asked for None, answer with when each message was there."""
    stamps: dict[int, float] = {}

    def received(number: int) -> None:
        stamps.setdefault(number, monotonic())

    reader = link.reader(received)
    connection.send("ready")
    for busy in commands(connection):
        if busy is not None:
            _compute(busy)
        else:
            connection.send(dict(stamps))
            stamps.clear()
    reader.close()


def _compute(seconds: float) -> int:
    """Do nothing but Python, as an agent that is busy."""
    total, end = 0, monotonic() + seconds
    while monotonic() < end:
        for number in range(1000):
            total += number * number % 7
    return total
