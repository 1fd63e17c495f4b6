"""Serves the tool server over HTTP on this machine, to those who show the token."""

from __future__ import annotations

import hmac
import socket
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

import anyio
import uvicorn

from dsr.errors import ConfigError

HOST = "127.0.0.1"
_PATIENCE = 3
"""s for which the end of the server waits for those who still read: a stream of changes would never end by itself"""
_MOST_CONNECTIONS = 64
"""Connections at once, more than which are answered that the server is busy: assistants on one machine need a few"""
_UNAUTHORIZED = b"a token is needed: Authorization: Bearer TOKEN, see dsr assist serve --help\n"

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]
"""An application by ASGI 3"""


class BearerGuard:
    """Lets requests with the token through to an application, and answers 401 to all others (RFC 6750).

    Args:
        app: by ASGI.
        token: that is to be shown.
    """

    def __init__(self, app: App, token: str) -> None:
        self._app = app
        self._expected = f"Bearer {token}".encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] == "lifespan" or self._is_shown(scope):
            await self._app(scope, receive, send)
            return
        headers = [(b"www-authenticate", b"Bearer"), (b"content-type", b"text/plain; charset=utf-8")]
        await send({"type": "http.response.start", "status": 401, "headers": headers})
        await send({"type": "http.response.body", "body": _UNAUTHORIZED})

    def _is_shown(self, scope: Scope) -> bool:
        """Whether exactly one token is shown, the right one; the time that takes tells nothing of it."""
        shown = [value for name, value in scope.get("headers", ()) if name.lower() == b"authorization"]
        return len(shown) == 1 and hmac.compare_digest(shown[0], self._expected)


def listening(port: int) -> socket.socket:
    """A socket that listens on this machine only. Raises `ConfigError` if the port is taken."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((HOST, port))
        listener.listen()
    except OSError as error:
        listener.close()
        raise ConfigError(f"port {port} cannot be used: {error.strerror}; another server may run: --port") from error
    return listener


def serve(app: App, listener: socket.socket, token: str | None) -> None:
    """Serve an application until Ctrl-C.

    Args:
        app: by ASGI.
        listener: of `listening`.
        token: that requests show; None to answer everybody.
    """
    guarded = app if token is None else BearerGuard(app, token)
    config = uvicorn.Config(
        guarded, log_level="warning", timeout_graceful_shutdown=_PATIENCE, limit_concurrency=_MOST_CONNECTIONS,
        server_header=False,
    )  # fmt: skip
    server = uvicorn.Server(config)
    anyio.run(lambda: server.serve(sockets=[listener]))
