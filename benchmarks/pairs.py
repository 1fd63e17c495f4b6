"""A writer and readers at the ends of a link, each a process, and what they can be told to do."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from types import TracebackType

from benchmarks.links import Link
from benchmarks.timing import monotonic, percentile, sleep, sleep_until
from benchmarks.workers import BenchmarkError, Worker, commands

PERIOD = 0.01
"""s between two messages at 100 Hz."""
_BURST = 100
"""Messages of a link until it is another one's turn."""
_COLD = 10
"""Messages at the start of a burst that do not count."""
_ON_ITS_WAY = 0.1  # s
_LATE = 20  # times as long as that until what has not come counts as lost
_PATIENCE = 20  # bursts without an answer


class Latencies:
    """A writer and its readers: how long messages take.

    Args:
        link: connects them.
        between: called when the writer is there, before the readers are started.
        readers: how many.
    """

    def __init__(self, link: Link, between: Callable[[], object] = lambda: None, *, readers: int = 1) -> None:
        self._writer = Worker(_write, link)
        self._readers: list[Worker] = []
        self._next = 1
        try:
            self._writer.receive()
            between()
            for _ in range(readers):
                self._readers.append(Worker(_read, link))
            for reader in self._readers:
                reader.receive()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Latencies:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def warm_up(self) -> None:
        """Send until messages arrive. Raises `BenchmarkError` if none do."""
        for _ in range(_PATIENCE - 1):
            with contextlib.suppress(BenchmarkError):
                self.burst(_COLD)
                return
        self.burst(_COLD)

    def burst(self, count: int, *, period: float = PERIOD, busy: bool = False) -> list[float]:
        """How long each of `count` messages took to each reader, s.

        Args:
            count: how many.
            period: s between two.
            busy: keep the readers' main threads in Python meanwhile.

        Raises:
            BenchmarkError: if half of them are lost.
        """
        first, self._next = self._next, self._next + count + _COLD
        for reader in self._readers if busy else ():
            reader.send((count + _COLD) * period + _ON_ITS_WAY)
        sent = self._writer.ask((first, count + _COLD, period))
        sleep(_ON_ITS_WAY)
        taken: list[float] = []
        for reader in self._readers:
            received = self._received(reader, sent[-1][0])
            arrived = [received[number] - start for number, start in sent[_COLD:] if number in received]
            if len(arrived) < count / 2:
                raise BenchmarkError(f"only {len(arrived)} of {count} messages arrived")
            taken += arrived
        return taken

    def _received(self, reader: Worker, last: int) -> dict[int, float]:
        """When each message came; waits for the last one, unless that is lost."""
        received: dict[int, float] = {}
        for _ in range(_LATE):
            received |= reader.ask(None)
            if last in received:
                break
            sleep(_ON_ITS_WAY)
        return received

    def close(self) -> None:
        """End all processes."""
        for worker in (*self._readers, self._writer):
            worker.close()


def in_turns(links: Mapping[str, Link], rounds: int) -> dict[str, list[float]]:
    """Median time (s) of a burst in each round by each link; the links take turns, so that all share what disturbs."""
    times: dict[str, list[float]] = {name: [] for name in links}
    with contextlib.ExitStack() as stack:
        pairs = {name: stack.enter_context(Latencies(link)) for name, link in links.items()}
        for pair in pairs.values():
            pair.warm_up()
        for _ in range(rounds):
            for name, pair in pairs.items():
                times[name].append(percentile(pair.burst(_BURST), 0.5))
    return times


def _write(connection: Connection, link: Link) -> None:
    """Send the bursts (first number, count, period) asked for; answer with each number and when it was sent."""
    writer = link.writer()
    connection.send("ready")
    for first, count, period in commands(connection):
        start = monotonic() + period
        connection.send([_send_at(writer.send, first + i, start + i * period) for i in range(count)])
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
