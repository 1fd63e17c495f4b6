"""Raw Zenoh through a chain of processes that all know each other, as the processes of one system do."""

from __future__ import annotations

from multiprocessing.connection import Connection

import msgspec
import zenoh

from benchmarks.links import Closable, Received, Sender
from benchmarks.peers.zenoh_link import open_session, publisher
from benchmarks.workers import commands


class ZenohMesh(msgspec.Struct, frozen=True):
    """The ends of the chain; each process listens, connects to all before it, and has one key to the next one."""

    endpoints: tuple[str, ...]
    """Of the writer, the forwarders and the reader."""
    size: int
    """Bytes of a message."""

    def writer(self) -> Sender:
        """The first process."""
        return _Sender(open_session(listen=self.endpoints[0]), self.size)

    def reader(self, received: Received) -> Closable:
        """The last process."""
        return _Reader(self._join(len(self.endpoints) - 1), len(self.endpoints) - 2, received)

    def forward(self, connection: Connection, index: int) -> None:
        """Process number `index`: pass on in the callback whatever comes from the one before, until the pipe closes."""
        session = self._join(index)
        following = publisher(session, key=_key(index), reliable=True)
        session.declare_subscriber(_key(index - 1), lambda sample: following.put(sample.payload))
        connection.send("ready")
        for _ in commands(connection):
            pass
        session.close()  # type: ignore[no-untyped-call]

    def _join(self, index: int) -> zenoh.Session:
        return open_session(listen=self.endpoints[index], connect=self.endpoints[:index])


class _Sender:
    def __init__(self, session: zenoh.Session, size: int) -> None:
        self._session = session
        self._padding = b"\0" * (size - 8)
        self._publisher = publisher(session, key=_key(0), reliable=True)

    def send(self, number: int) -> None:
        self._publisher.put(number.to_bytes(8, "little") + self._padding)

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]


class _Reader:
    def __init__(self, session: zenoh.Session, index: int, received: Received) -> None:
        self._session = session
        self._subscriber = session.declare_subscriber(
            _key(index), lambda sample: received(int.from_bytes(sample.payload.to_bytes()[:8], "little"))
        )

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]


def _key(index: int) -> str:
    """What process number `index` sends on."""
    return f"bench/hop/{index}"
