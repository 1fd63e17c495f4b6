"""Processes that take part in a measurement: started fresh, spoken to over a pipe, gone with whoever started them."""

from __future__ import annotations

import contextlib
import multiprocessing
from collections.abc import Callable, Iterable, Iterator
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any

from dsr.errors import DsrError

PATIENCE = 120.0
"""s to wait for an answer, unless told otherwise."""
_context = multiprocessing.get_context("spawn")


class BenchmarkError(DsrError):
    """A measurement could not be made."""


class Worker:
    """A process that runs `main(connection, *arguments)`.

    Raises `BenchmarkError` from `receive` if the process has ended or does not answer.
    """

    def __init__(self, main: Callable[..., None], *arguments: Any) -> None:
        self._connection, theirs = _context.Pipe()
        self._process = _context.Process(target=_run, args=(main, theirs, *arguments), daemon=True)
        self._process.start()
        theirs.close()

    def __enter__(self) -> Worker:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def send(self, message: Any) -> None:
        """Tell it something."""
        self._connection.send(message)

    def receive(self, timeout: float = PATIENCE) -> Any:
        """What it says next."""
        try:
            if self._connection.poll(timeout):
                return self._connection.recv()
        except EOFError:
            raise BenchmarkError(f"{self._process.name} ended early, exit code {self._process.exitcode}") from None
        raise BenchmarkError(f"{self._process.name} said nothing for {timeout:.0f} s")

    def ask(self, message: Any, timeout: float = PATIENCE) -> Any:
        """Tell it something and wait for its answer."""
        self.send(message)
        return self.receive(timeout)

    def close(self) -> None:
        """Let it end: it finds its pipe closed; what does not end is killed."""
        self._connection.close()
        self._process.join(5.0)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


@contextlib.contextmanager
def all_of(workers: Iterable[Worker]) -> Iterator[list[Worker]]:
    """Several workers that are closed together."""
    with contextlib.ExitStack() as stack:
        yield [stack.enter_context(worker) for worker in workers]


def commands(connection: Connection) -> Iterator[Any]:
    """What the other end says, until it closes."""
    with contextlib.suppress(EOFError):
        while True:
            yield connection.recv()


def _run(main: Callable[..., None], connection: Connection, *arguments: Any) -> None:
    with contextlib.suppress(BrokenPipeError, ConnectionResetError, KeyboardInterrupt):
        main(connection, *arguments)
