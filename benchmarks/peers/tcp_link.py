"""Raw TCP between processes: fixed-size messages, no delay, one thread that reads."""

from __future__ import annotations

import contextlib
import socket
import threading

import msgspec

from benchmarks.links import Closable, Received, Sender


class TcpLink(msgspec.Struct, frozen=True):
    """A connection from each reader to the writer."""

    port: int
    size: int
    """Bytes of a message."""

    def writer(self) -> Sender:
        """The end that listens."""
        return _Sender(self)

    def reader(self, received: Received) -> Closable:
        """An end that connects."""
        return _Reader(self, received)


class _Sender:
    def __init__(self, link: TcpLink) -> None:
        self._server = socket.create_server(("127.0.0.1", link.port))
        self._padding = b"\0" * (link.size - 8)
        self._readers: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                reader, _ = self._server.accept()
                reader.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._readers.append(reader)

    def send(self, number: int) -> None:
        message = number.to_bytes(8, "little") + self._padding
        for reader in self._readers:
            reader.sendall(message)

    def close(self) -> None:
        for end in [self._server, *self._readers]:
            end.close()


class _Reader:
    def __init__(self, link: TcpLink, received: Received) -> None:
        self._socket = socket.create_connection(("127.0.0.1", link.port))
        threading.Thread(target=self._read, args=(link.size, received), daemon=True).start()

    def _read(self, size: int, received: Received) -> None:
        with contextlib.suppress(OSError), self._socket.makefile("rb") as stream:
            while message := stream.read(size):
                received(int.from_bytes(message[:8], "little"))

    def close(self) -> None:
        self._socket.close()
