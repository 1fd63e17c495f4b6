"""Raw Zenoh: open a session and get bytes from another process by one query."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import zenoh

from benchmarks.peers.zenoh_link import open_session
from benchmarks.timing import monotonic, sleep
from benchmarks.workers import BenchmarkError

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


def fetch(endpoint: str, size: int) -> float:
    """How long it takes from before the session is opened until the bytes are there, s."""
    zenoh.init_log_from_env_or("error")
    start = monotonic()
    session = open_session(connect=endpoint)
    try:
        for _ in range(1000):  # the queryable is known a little after the link is open
            for reply in session.get(_KEY, timeout=5.0):
                if reply.ok is not None and len(reply.ok.payload.to_bytes()) == size:
                    return monotonic() - start
            sleep(0.001)
    finally:
        session.close()  # type: ignore[no-untyped-call]
    raise BenchmarkError(f"no answer from {endpoint}")
