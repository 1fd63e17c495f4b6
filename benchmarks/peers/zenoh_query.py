"""Raw Zenoh: get bytes from another process by one query, in a session that is opened for that or is open already."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from multiprocessing.connection import Connection

import zenoh

from benchmarks.peers.zenoh_link import open_session
from benchmarks.timing import monotonic, sleep
from benchmarks.workers import BenchmarkError, commands

_KEY = "bench/content"


@contextlib.contextmanager
def holding(endpoint: str, size: int) -> Iterator[None]:
    """Answer queries with `size` bytes."""
    content = bytes(size)
    session = open_session(listen=endpoint)
    session.declare_queryable(_KEY, lambda query: query.reply(_KEY, content))
    try:
        yield
    finally:
        session.close()  # type: ignore[no-untyped-call]


def hold_bytes(connection: Connection, endpoint: str, size: int) -> None:
    """Answer queries with `size` bytes in a process of its own, until the pipe closes."""
    with holding(endpoint, size):
        connection.send("ready")
        for _ in commands(connection):
            pass


def fetch(endpoint: str, size: int) -> float:
    """How long it takes from before the session is opened until the bytes are there, s."""
    zenoh.init_log_from_env_or("error")
    start = monotonic()
    session = open_session(connect=endpoint)
    try:
        _get(session, endpoint, size)
        return monotonic() - start
    finally:
        session.close()  # type: ignore[no-untyped-call]


class Asker:
    """A session that is open, and asks again and again."""

    def __init__(self, endpoint: str, size: int) -> None:
        zenoh.init_log_from_env_or("error")
        self._session = open_session(connect=endpoint)
        self._endpoint, self._size = endpoint, size
        self.ask()

    def ask(self) -> float:
        """How long it takes from the query until the bytes are there, s."""
        start = monotonic()
        _get(self._session, self._endpoint, self._size)
        return monotonic() - start

    def close(self) -> None:
        """Leave."""
        self._session.close()  # type: ignore[no-untyped-call]


def _get(session: zenoh.Session, endpoint: str, size: int) -> None:
    for _ in range(1000):  # the queryable is known a little after the link is open
        for reply in session.get(_KEY, timeout=5.0):
            if reply.ok is not None and len(reply.ok.payload.to_bytes()) == size:
                return
        sleep(0.001)
    raise BenchmarkError(f"no answer from {endpoint}")
