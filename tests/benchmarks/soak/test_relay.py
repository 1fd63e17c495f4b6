"""The wire passes bytes, refuses while it is cut, is silent while it stalls, and is whole again afterwards."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Iterator

import pytest

from benchmarks.soak.relay import Relay


@pytest.fixture
def echo() -> Iterator[int]:
    """The port of a server that sends back what it gets."""
    server = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        with contextlib.suppress(OSError):
            while True:
                connection, _ = server.accept()
                threading.Thread(target=answer, args=(connection,), daemon=True).start()

    def answer(connection: socket.socket) -> None:
        with contextlib.suppress(OSError), connection:
            while piece := connection.recv(100):
                connection.sendall(piece)

    threading.Thread(target=serve, daemon=True).start()
    yield server.getsockname()[1]
    server.shutdown(socket.SHUT_RDWR)
    server.close()


@pytest.fixture
def relay(echo: int) -> Iterator[Relay]:
    wire = Relay(echo)
    yield wire
    wire.close()


def dial(relay: Relay) -> socket.socket:
    return socket.create_connection(("127.0.0.1", relay.port), timeout=10.0)


def says(connection: socket.socket, text: bytes) -> bytes:
    connection.sendall(text)
    return connection.recv(100)


def test_a_cut_ends_connections_and_refuses_new_ones_until_it_is_healed(relay: Relay) -> None:
    with dial(relay) as connection:
        assert says(connection, b"a") == b"a"
        relay.cut()
        with contextlib.suppress(ConnectionError):
            assert connection.recv(100) == b""
    with pytest.raises(ConnectionRefusedError):
        dial(relay)
    relay.heal()
    with dial(relay) as connection:
        assert says(connection, b"b") == b"b"


def test_a_stall_passes_nothing_and_delivers_afterwards(relay: Relay) -> None:
    with dial(relay) as connection:
        assert says(connection, b"a") == b"a"
        relay.stall()
        connection.sendall(b"b")
        connection.settimeout(0.3)
        with pytest.raises(TimeoutError):
            connection.recv(100)
        connection.settimeout(10.0)
        relay.heal()
        assert connection.recv(100) == b"b"


def test_a_target_that_is_not_there_is_a_closed_connection(echo: int) -> None:
    with socket.create_server(("127.0.0.1", 0)) as unused:
        port = unused.getsockname()[1]
    wire = Relay(port)
    with dial(wire) as connection, contextlib.suppress(ConnectionError):
        assert connection.recv(100) == b""
    wire.close()
