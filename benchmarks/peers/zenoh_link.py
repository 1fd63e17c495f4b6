"""Raw Zenoh between two processes: `put` of as many bytes as an update takes, until the callback has them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from multiprocessing.connection import Connection
from typing import Any

import msgspec
import zenoh

from benchmarks.links import Closable, Received, Sender
from benchmarks.workers import commands

KEY = "bench/value"


def open_session(
    *, listen: str | None = None, connect: str | Sequence[str] = (), shared_memory: bool = False
) -> zenoh.Session:
    """A peer that knows its endpoints and looks for no others, as the working memory's are."""
    config = zenoh.Config()
    settings: dict[str, Any] = {
        "mode": "peer",
        "listen/endpoints": [listen] if listen else [],
        "connect/endpoints": [connect] if isinstance(connect, str) else list(connect),
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2},
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": shared_memory,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def open_router(endpoint: str) -> zenoh.Session:
    """What a robot's `rmw_zenohd` is: a router, by which nodes find each other."""
    config = zenoh.Config()
    for key, value in {
        "mode": "router", "listen/endpoints": [endpoint], "scouting/multicast/enabled": False,
    }.items():  # fmt: skip
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


class ZenohLink(msgspec.Struct, frozen=True):
    """A publisher with the quality of service of our updates, and a subscriber with a callback."""

    endpoint: str
    size: int
    """Bytes of a message."""
    reliable: bool = True
    """As attributes travel: nothing dropped; else as poses: dropped when the link is full."""

    def writer(self) -> Sender:
        """The end that listens."""
        return _Sender(open_session(listen=self.endpoint), self)

    def reader(self, received: Received) -> Closable:
        """An end that connects."""
        return _Reader(open_session(connect=self.endpoint), received)


class _Sender:
    def __init__(self, session: zenoh.Session, link: ZenohLink) -> None:
        self._session = session
        self._padding = b"\0" * (link.size - 8)
        self._publisher = publisher(session, reliable=link.reliable)

    def send(self, number: int) -> None:
        self._publisher.put(number.to_bytes(8, "little") + self._padding)

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]


class _Reader:
    def __init__(self, session: zenoh.Session, received: Received) -> None:
        self._session = session
        self._subscriber = session.declare_subscriber(
            KEY, lambda sample: received(int.from_bytes(sample.payload.to_bytes()[:8], "little"))
        )

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]


def forward(connection: Connection, first: str, last: str) -> None:
    """Pass on whatever comes from endpoint `first` to those who connect to `last`, until the pipe closes."""
    target, source = open_session(listen=last), open_session(connect=first)
    following = publisher(target, reliable=True)
    source.declare_subscriber(KEY, lambda sample: following.put(sample.payload))
    connection.send("ready")
    for _ in commands(connection):
        pass
    for session in (source, target):
        session.close()  # type: ignore[no-untyped-call]


def publisher(session: zenoh.Session, *, reliable: bool, key: str = KEY) -> zenoh.Publisher:
    """One with the quality of service of our updates, or of our streams."""
    control, priority = zenoh.CongestionControl, zenoh.Priority
    return session.declare_publisher(
        key,
        congestion_control=control.BLOCK if reliable else control.DROP,
        priority=priority.INTERACTIVE_HIGH if reliable else priority.INTERACTIVE_LOW,
        express=True,
    )
