"""Services and their clients as nodes under rmw_zenoh_cpp have them."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable
from typing import Any

import zenoh

from agents.ros_bridge.errors import RosLinkError, RosMessageError, RosTimeoutError
from agents.ros_bridge.link.zenoh.session import reason
from agents.ros_bridge.link.zenoh.tokens import Entity, attachment, gid, read_attachment
from agents.ros_bridge.link.zenoh.topics import undeclare
from dsr.clock import WALL_CLOCK

_log = logging.getLogger("dsr.ros")

_MOST_WAITING = 64
"""Requests to one service; of more, the oldest is dropped, whose client most likely has given up"""
_PATIENCE = 2.0  # s
_LOOK = 0.005  # s
_TIMED_OUT = "Timeout"
"""What Zenoh says in place of a response that did not come in time"""


class ZenohServed:
    """Answers requests to one service, one after the other, from a thread of its own."""

    def __init__(self, session: zenoh.Session, entity: Entity, answer: Callable[[bytes], bytes]) -> None:
        self.name = entity.topic
        self.refused = 0
        """Requests that were malformed, or that `answer` raised an exception for."""
        self._key = entity.key()
        self._answer = answer
        self.closed = False
        """Whether it was taken back."""
        waiting: Any = zenoh.handlers.RingChannel(_MOST_WAITING)
        self._queryable = session.declare_queryable(self._key, waiting, complete=True)
        self._token = session.liveliness().declare_token(entity.token())
        self._thread = threading.Thread(target=self._run, name=f"ros-serve-{self.name}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Take it back; harmless when repeated."""
        if not self.closed:
            self.closed = True
            undeclare(self._token)
            undeclare(self._queryable)
        if self._thread is not threading.current_thread():
            self._thread.join(_PATIENCE)

    def _run(self) -> None:
        waiting: Any = self._queryable.handler
        with contextlib.suppress(zenoh.ZError):
            while not self.closed:
                with waiting.recv() as query:
                    self._reply(query)

    def _reply(self, query: zenoh.Query) -> None:
        """A refusal is an error reply; clients under rmw_zenoh see none, and run into their timeout."""
        try:
            number, _, client = read_attachment(query.attachment.to_bytes() if query.attachment else b"")
            response = self._answer(query.payload.to_bytes() if query.payload is not None else b"")
        except RosMessageError as error:
            self.refused += 1
            query.reply_err(str(error))
        except Exception as error:
            self.refused += 1
            _log.exception("a request to %s could not be answered", self.name)
            query.reply_err(f"{type(error).__name__}: {error}")
        else:
            query.reply(self._key, response, attachment=attachment(number, _nanoseconds(), client))


class ZenohClient:
    """Asks one service."""

    def __init__(self, session: zenoh.Session, entity: Entity) -> None:
        token = entity.token()
        self.key = entity.key()
        self._name = entity.topic
        self._gid = gid(token)
        self._asked = 0
        self._lock = threading.Lock()
        self._session = session
        self._querier: Any = session.declare_querier(self.key, target=zenoh.QueryTarget.ALL_COMPLETE)
        self._token = session.liveliness().declare_token(token)

    def wait(self, timeout: float) -> bool:
        """Wait until requests reach a server, of which its announcement may come first; false after `timeout` s."""
        end, never = WALL_CLOCK.monotonic() + timeout, threading.Event()
        while not self._querier.matching_status.matching:
            if WALL_CLOCK.monotonic() >= end:
                return False
            WALL_CLOCK.wait(never, _LOOK)
        return True

    def call(self, request: bytes, timeout: float) -> bytes:
        """Ask once, and wait for the first response; errors as of `RosLink.call`."""
        with self._lock:
            self._asked += 1
            number = self._asked
        try:
            replies = self._session.get(
                self.key, payload=request, attachment=attachment(number, _nanoseconds(), self._gid),
                target=zenoh.QueryTarget.ALL_COMPLETE, consolidation=zenoh.ConsolidationMode.NONE, timeout=timeout,
            )  # fmt: skip
            refusal = ""
            for reply in replies:
                if reply.ok is not None:
                    return reply.ok.payload.to_bytes()
                refusal = reply.err.payload.to_string() if reply.err is not None else ""
        except zenoh.ZError as error:
            raise RosLinkError(f"cannot ask {self._name}: {reason(error)}") from error
        if refusal and refusal != _TIMED_OUT:
            raise RosLinkError(f"{self._name} refused: {refusal}")
        raise RosTimeoutError(f"{self._name} did not answer within {timeout:g} s")

    def close(self) -> None:
        """Take it back; harmless when repeated."""
        undeclare(self._token)
        undeclare(self._querier)


def _nanoseconds() -> int:
    return round(WALL_CLOCK.now() * 1e9)
