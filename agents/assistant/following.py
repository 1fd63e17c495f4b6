"""Tells assistants of earlier versions of the protocol what changes: those that ask by `resources/subscribe`.

Newer ones (from 2026-07-28 on) keep a stream open by `subscriptions/listen`, which the library serves itself.
"""

from __future__ import annotations

import logging
from typing import Any

from mcp.server import MCPServer, ServerRequestContext
from mcp.server.session import ServerSession
from mcp.types import EmptyResult, SubscribeRequestParams, UnsubscribeRequestParams

_log = logging.getLogger(__name__)
_MOST_CLIENTS = 64
"""Clients that are told at once: as many as there may be connections; the one that asked first is forgotten"""
_MOST_RESOURCES = 100
"""Resources that one client follows: more change than anybody reads"""


class _Follower:
    """A client, by the object that its connection keeps of its first message."""

    def __init__(self, session: ServerSession) -> None:
        self.session = session
        self.client = session.client_params
        self.uris: dict[str, None] = {}


class Followers:
    """The clients that follow resources.

    Args:
        server: that gets the methods `resources/subscribe` and `resources/unsubscribe`.
    """

    def __init__(self, server: MCPServer[None]) -> None:
        self._all: list[_Follower] = []
        methods = server._lowlevel_server  # the library's own way for methods that the newest version left out
        methods.add_request_handler("resources/subscribe", SubscribeRequestParams, self._subscribe)
        methods.add_request_handler("resources/unsubscribe", UnsubscribeRequestParams, self._unsubscribe)

    async def tell(self, uri: str) -> None:
        """Tell the followers of a resource that it changed. Who cannot be told is forgotten."""
        for follower in [one for one in self._all if uri in one.uris]:
            try:
                await follower.session.send_resource_updated(uri)
            except Exception as error:  # of a connection that is gone, whatever the transport
                _log.debug("a follower is gone: %s", error)
                self._forget(follower)

    async def _subscribe(self, context: ServerRequestContext[Any, Any], params: SubscribeRequestParams) -> EmptyResult:
        follower = self._known(context.session)
        if follower is None:
            follower = _Follower(context.session)
            self._all = [*self._all, follower][-_MOST_CLIENTS:]
        follower.uris[str(params.uri)] = None
        while len(follower.uris) > _MOST_RESOURCES:
            del follower.uris[next(iter(follower.uris))]
        return EmptyResult()

    async def _unsubscribe(
        self, context: ServerRequestContext[Any, Any], params: UnsubscribeRequestParams
    ) -> EmptyResult:
        follower = self._known(context.session)
        if follower is not None:
            follower.uris.pop(str(params.uri), None)
            if not follower.uris:
                self._forget(follower)
        return EmptyResult()

    def _known(self, session: ServerSession) -> _Follower | None:
        return next((one for one in self._all if one.client is session.client_params), None)

    def _forget(self, follower: _Follower) -> None:
        self._all = [one for one in self._all if one is not follower]
