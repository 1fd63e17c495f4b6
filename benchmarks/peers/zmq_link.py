"""ZeroMQ between processes: PUB and SUB over TCP, one thread that reads."""

from __future__ import annotations

import contextlib
import threading

import msgspec
import zmq

from benchmarks.links import Closable, Received, Sender


class ZmqLink(msgspec.Struct, frozen=True):
    """A publisher that waits for slow subscribers instead of dropping (XPUB_NODROP)."""

    port: int
    size: int
    """Bytes of a message."""

    @property
    def endpoint(self) -> str:
        """Where the publisher is."""
        return f"tcp://127.0.0.1:{self.port}"

    def writer(self) -> Sender:
        """The end that listens."""
        return _Sender(self)

    def reader(self, received: Received) -> Closable:
        """An end that connects."""
        return _Reader(self, received)


class _Sender:
    def __init__(self, link: ZmqLink) -> None:
        self._socket = zmq.Context.instance().socket(zmq.PUB)
        self._socket.setsockopt(zmq.XPUB_NODROP, 1)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.bind(link.endpoint)
        self._padding = b"\0" * (link.size - 8)

    def send(self, number: int) -> None:
        self._socket.send(number.to_bytes(8, "little") + self._padding)

    def close(self) -> None:
        self._socket.close()


class _Reader:
    def __init__(self, link: ZmqLink, received: Received) -> None:
        self._closing = False
        threading.Thread(target=self._read, args=(link, received), daemon=True).start()

    def _read(self, link: ZmqLink, received: Received) -> None:
        with zmq.Context.instance().socket(zmq.SUB) as subscriber, contextlib.suppress(zmq.ContextTerminated):
            subscriber.setsockopt(zmq.SUBSCRIBE, b"")
            subscriber.connect(link.endpoint)
            while not self._closing:
                if subscriber.poll(100):
                    received(int.from_bytes(subscriber.recv()[:8], "little"))

    def close(self) -> None:
        self._closing = True
