"""Publishers and subscriptions as nodes under rmw_zenoh_cpp have them."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable
from typing import Any

import zenoh
import zenoh.ext

from agents.ros_bridge.errors import RosLinkError, RosMessageError
from agents.ros_bridge.link.link import Received
from agents.ros_bridge.link.zenoh.session import reason
from agents.ros_bridge.link.zenoh.tokens import Entity, attachment, gid, is_old_attachment, read_attachment
from dsr.clock import WALL_CLOCK
from dsr.threads import new_thread

_log = logging.getLogger("dsr.ros")

_HEARTBEAT = 0.5  # s, as rmw_zenoh has it
_PATIENCE = 2.0  # s
_MOST_WRITERS = 1000
"""Whose messages are numbered; beyond these, the oldest is forgotten"""
_LARGEST_GAP = 1_000_000
"""Messages that may be missing between two: a publisher of 1000 Hz sends as many in a quarter of an hour. Beyond that,
its numbers are of another life, or made up"""


class ZenohPublisher:
    """Sends on one topic."""

    def __init__(self, session: zenoh.Session, entity: Entity, subscribers: Callable[[], int]) -> None:
        token = entity.token()
        self.writer = gid(token)
        self._topic = entity.topic
        self._subscribers = subscribers
        self._sent = 0
        self.closed = False
        """Whether it was taken back."""
        self._lock = threading.Lock()
        self._publisher = self._declare(session, entity)
        self._token = session.liveliness().declare_token(token)

    def send(self, cdr: bytes) -> None:
        """Send a message to all subscribers; raises `RosLinkError` after `close`."""
        with self._lock:
            if self.closed:
                raise RosLinkError(f"the publisher of {self._topic} is closed")
            self._sent += 1
            stamp = round(WALL_CLOCK.now() * 1e9)
            try:
                self._publisher.put(cdr, attachment=attachment(self._sent, stamp, self.writer))
            except zenoh.ZError as error:
                raise RosLinkError(f"cannot publish on {self._topic}: {reason(error)}") from error

    def subscribers(self) -> int:
        """How many subscribers elsewhere are visible."""
        return self._subscribers()

    def close(self) -> None:
        """Take it back; harmless when repeated."""
        with self._lock:
            if not self.closed:
                self.closed = True
                undeclare(self._token)
                undeclare(self._publisher)

    @staticmethod
    def _declare(session: zenoh.Session, entity: Entity) -> Any:
        """Plain if it keeps nothing: on the wire, that is the same."""
        reliability = zenoh.Reliability
        options: dict[str, Any] = {
            "congestion_control": zenoh.CongestionControl.DROP,
            "reliability": reliability.RELIABLE if entity.qos.reliable else reliability.BEST_EFFORT,
            "allowed_destination": zenoh.Locality.REMOTE,
            "express": True,  # not gathered with what follows: an image would wait for it
        }
        if not entity.qos.transient_local:
            return session.declare_publisher(entity.key(), **options)
        detected = zenoh.ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=_HEARTBEAT)
        return zenoh.ext.declare_advanced_publisher(
            session, entity.key(), cache=zenoh.ext.CacheConfig(max(entity.qos.depth, 1)), publisher_detection=True,
            sample_miss_detection=detected if entity.qos.reliable else None, **options,
        )  # fmt: skip


class ZenohSubscription:
    """Calls back with what comes on one topic, from a thread of its own.

    The newest messages wait for this thread, as many as the depth of its QoS; older ones are dropped and counted.
    """

    def __init__(
        self, session: zenoh.Session, entity: Entity, receive: Callable[[Received], None], publishers: Callable[[], int]
    ) -> None:
        self.topic = entity.topic
        self._publishers = publishers
        self.lost = 0
        """Messages that were sent and did not arrive, by the gaps in their numbers."""
        self.malformed = 0
        """Messages without a right attachment, which are dropped."""
        self.outdated = 0
        """Messages of a release of rmw_zenoh that later ones do not understand, which are dropped."""
        self.failures = 0
        """Messages that `receive` raised an exception for."""
        self._receive = receive
        self._numbers: dict[bytes, int] = {}
        self.closed = False
        """Whether it was taken back."""
        self._subscriber = self._declare(session, entity)
        self._token = session.liveliness().declare_token(entity.token())
        self._thread = new_thread(self._run, f"ros-sub-{entity.topic}")
        self._thread.start()

    def publishers(self) -> int:
        """How many publishers elsewhere it hears."""
        return self._publishers()

    def close(self) -> None:
        """Take it back; harmless when repeated. From another thread than that of `receive`, it waits for that one."""
        if not self.closed:
            self.closed = True
            undeclare(self._token)
            undeclare(self._subscriber)
        if self._thread is not threading.current_thread():
            self._thread.join(_PATIENCE)

    def _declare(self, session: zenoh.Session, entity: Entity) -> Any:
        key, qos = entity.key(), entity.qos
        waiting: Any = zenoh.handlers.RingChannel(max(qos.depth, 1))
        if not qos.transient_local:
            return session.declare_subscriber(key, waiting, allowed_origin=zenoh.Locality.REMOTE)
        return zenoh.ext.declare_advanced_subscriber(
            session, key, waiting,
            allowed_origin=zenoh.Locality.REMOTE,
            history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=qos.depth),
            recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True) if qos.reliable else None,
            subscriber_detection=True,
        )  # fmt: skip

    def _run(self) -> None:
        """Take all that waits at each turn: to wait for each message would cost a switch of threads each time."""
        waiting = self._subscriber.handler  # of its own: who waits on the subscriber itself could not take it back
        receive, take = waiting.recv, waiting.try_recv
        with contextlib.suppress(zenoh.ZError):
            while not self.closed:
                sample = receive()
                while sample is not None and not self.closed:
                    self._pass_on(sample)
                    sample = take()

    def _pass_on(self, sample: zenoh.Sample) -> None:
        attached = sample.attachment.to_bytes() if sample.attachment else b""
        try:
            number, stamp, writer = read_attachment(attached)
        except RosMessageError:
            if is_old_attachment(attached):
                self.outdated += 1
            else:
                self.malformed += 1
            return
        self._count(number, writer)
        try:
            self._receive(Received(sample.payload.to_bytes(), stamp / 1e9, writer))
        except Exception:
            self.failures += 1
            if self.failures == 1:
                _log.exception("a message of %s could not be handled", self.topic)

    def _count(self, number: int, writer: bytes) -> None:
        last = self._numbers.get(writer)
        if last is None and len(self._numbers) >= _MOST_WRITERS:
            del self._numbers[next(iter(self._numbers))]
        if last is not None and 0 < (missing := number - last - 1) <= _LARGEST_GAP:
            self.lost += missing
        self._numbers[writer] = number


def undeclare(declared: Any) -> None:
    """Take a declaration back, whatever state its session is in."""
    with contextlib.suppress(zenoh.ZError):
        declared.undeclare()
