"""Ports for the peers: each is kept for this process until it ends, so that nobody is given it a second time."""

from __future__ import annotations

import socket

_KEPT: list[socket.socket] = []


def reserved_port() -> int:
    """A TCP port of the loopback interface on which a process of the measurement is going to listen.

    The socket that keeps it is bound and never listens. So the system gives the port to nobody who asks for any, and
    who asks for just this one, with SO_REUSEADDR as servers do, may listen.
    """
    keeper = socket.socket()
    keeper.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    keeper.bind(("127.0.0.1", 0))
    _KEPT.append(keeper)
    port: int = keeper.getsockname()[1]
    return port


def reserved_endpoint() -> str:
    """The same as an endpoint of Zenoh."""
    return f"tcp/127.0.0.1:{reserved_port()}"
