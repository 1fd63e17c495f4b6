"""Raw Zenoh between two processes, taken from a ring by a thread of the reader, with or without a codec."""

from __future__ import annotations

import threading
from typing import Any

import msgspec
import zenoh

from benchmarks.links import Closable, Received, Sender
from benchmarks.peers.zenoh_link import KEY, open_session, publisher
from dsr.clock import WALL_CLOCK
from dsr.crdt.delta import Delta, Write
from dsr.replication.replica import NEWEST_DELTAS
from dsr.replication.wire import decode_delta, encode_delta


class RingLink(msgspec.Struct, frozen=True):
    """Raw Zenoh, but a thread of the reader takes messages from a ring, as the memory does: no callback may block."""

    endpoint: str
    size: int
    decoded: bool = False
    """Whether the message is a delta of one write, encoded, decoded and put into a dictionary under a lock."""

    def writer(self) -> Sender:
        """The end that listens."""
        return _RingSender(self)

    def reader(self, received: Received) -> Closable:
        """An end that connects."""
        return _RingReader(self, received)


class _RingSender:
    def __init__(self, link: RingLink) -> None:
        self._session = open_session(listen=link.endpoint)
        self._publisher = publisher(self._session, reliable=True)
        self._link = link

    def send(self, number: int) -> None:
        link = self._link
        self._publisher.put(_delta(number) if link.decoded else number.to_bytes(8, "little").ljust(link.size, b"\0"))

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]


class _RingReader:
    def __init__(self, link: RingLink, received: Received) -> None:
        self._session = open_session(connect=link.endpoint)
        ring: Any = zenoh.handlers.RingChannel(NEWEST_DELTAS)
        self._subscriber: Any = self._session.declare_subscriber(KEY, ring)
        self._lock, self._registers = threading.RLock(), dict[Any, Write]()
        threading.Thread(target=self._read, args=(link.decoded, received), daemon=True).start()

    def _read(self, decoded: bool, received: Received) -> None:
        for sample in self._subscriber:
            payload = sample.payload.to_bytes()
            received(self._keep(payload) if decoded else int.from_bytes(payload[:8], "little"))

    def _keep(self, payload: bytes) -> int:
        (write,) = decode_delta(payload).writes
        with self._lock:
            self._registers[write.owner, write.attribute] = write
        return int(write.value)

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]


def _delta(number: int) -> bytes:
    owner, rid = ("writer-process-12345678", number % 1000 + 1), "writer-process-12345678"
    write = Write(owner, "order", int(WALL_CLOCK.now() * 1e6) << 10, rid, (rid, number + 1000), number)
    return encode_delta(Delta(writes=[write], context=[(rid, number + 1000, number + 1000)]))
