"""A wire that can be cut: forwards TCP connections to a port of this machine, until told not to."""

from __future__ import annotations

import contextlib
import socket
import threading

_CHUNK = 1 << 16
_LOOPBACK = "127.0.0.1"


class Relay:
    """Listens on `port` and forwards to `target` while it is whole.

    `cut` closes all connections and refuses new ones; `stall` leaves them open and passes no byte, as a network does
    that lost its way without a word.
    """

    def __init__(self, target: int) -> None:
        self._target = target
        self._whole = threading.Event()
        self._whole.set()
        self._connections: set[socket.socket] = set()
        self._lock = threading.Lock()
        self._closed = False
        self._listener = self._listen(0)
        self.port: int = self._listener.getsockname()[1]

    def cut(self) -> None:
        """Close all connections and refuse new ones."""
        _close(self._listener)
        with self._lock:
            connections = list(self._connections)
        for connection in connections:
            _close(connection)

    def stall(self) -> None:
        """Pass nothing on, and say nothing."""
        self._whole.clear()

    def heal(self) -> None:
        """Pass everything on again, also what waited during a stall."""
        if self._listener.fileno() < 0 and not self._closed:
            self._listener = self._listen(self.port)
        self._whole.set()

    def close(self) -> None:
        """End it."""
        self._closed = True
        self.cut()
        self._whole.set()

    def _listen(self, port: int) -> socket.socket:
        listener = socket.create_server((_LOOPBACK, port), backlog=64)
        threading.Thread(target=self._accept, args=(listener,), name="relay", daemon=True).start()
        return listener

    def _accept(self, listener: socket.socket) -> None:
        with contextlib.suppress(OSError):  # closed: that ends it
            while True:
                near, _ = listener.accept()
                threading.Thread(target=self._join, args=(near,), name="relay-join", daemon=True).start()

    def _join(self, near: socket.socket) -> None:
        self._whole.wait()
        try:
            far = socket.create_connection((_LOOPBACK, self._target))
        except OSError:
            near.close()
            return
        with self._lock:
            self._connections |= {near, far}
        for source, sink in ((near, far), (far, near)):
            threading.Thread(target=self._pump, args=(source, sink), name="relay-pump", daemon=True).start()

    def _pump(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while piece := source.recv(_CHUNK):
                self._whole.wait()
                sink.sendall(piece)
        for connection in (source, sink):
            _close(connection)
        with self._lock:
            self._connections -= {source, sink}


def _close(connection: socket.socket) -> None:
    """Close it, and wake who waits for it."""
    with contextlib.suppress(OSError):
        connection.shutdown(socket.SHUT_RDWR)
    connection.close()
