"""A compiled core at both ends of raw Zenoh: a lock, a clock, and no thread but the one that takes from a ring."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Literal

import msgspec
import zenoh

from benchmarks import workload
from benchmarks.compiled.building import new_core
from benchmarks.compiled.steps import filled
from benchmarks.links import Closable, Received, Sender
from benchmarks.peers.zenoh_link import KEY, open_session, publisher
from dsr.clock import WALL_CLOCK
from dsr.math3d.transforms import Pose
from dsr.replication.replica import NEWEST_DELTAS

_WRITER = "writer-process-12345678"


class CompiledLink(msgspec.Struct, frozen=True):
    """The prototype in the place of the whole memory: what is left of a row if nothing else cost anything."""

    endpoint: str
    file: str
    """Of the prototype that was built."""
    kind: Literal["attribute", "RT"]

    def writer(self) -> Sender:
        """The end that listens."""
        return _CoreSender(self)

    def reader(self, received: Received) -> Closable:
        """An end that connects, and has all content."""
        return _CoreReader(self, received)


class _CoreSender:
    def __init__(self, link: CompiledLink) -> None:
        self._session = open_session(listen=link.endpoint)
        self._publisher = publisher(self._session, reliable=link.kind == "attribute")
        self._lock, self._core = threading.RLock(), filled(link.file, _WRITER)
        self._write: Callable[[int], object] = self._attribute if link.kind == "attribute" else self._pose

    def send(self, number: int) -> None:
        with self._lock:
            self._write(number)
            bundles, samples = self._core.take()
        self._publisher.put(bundles[0] if bundles else samples)

    def _attribute(self, number: int) -> None:
        self._core.write_node(workload.name(number % workload.NODES), {"order": number}, WALL_CLOCK.now())

    def _pose(self, number: int) -> None:
        now = WALL_CLOCK.now()
        pose = Pose.unchecked((float(number), 0.2, 0.3), (0.0, 0.0, 0.6, 0.8), now)
        self._core.write_edge("world", workload.name(number % workload.NODES), "RT", {"pose": pose}, now)

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]


class _CoreReader:
    def __init__(self, link: CompiledLink, received: Received) -> None:
        self._lock, self._core = threading.RLock(), new_core(link.file, "reader-process-12345678")
        for piece in filled(link.file, _WRITER).pieces():
            self._core.join_piece(piece, WALL_CLOCK.now())
        self._core.watch()
        self._session = open_session(connect=link.endpoint)
        ring: Any = zenoh.handlers.RingChannel(NEWEST_DELTAS)
        self._subscriber: Any = self._session.declare_subscriber(KEY, ring)
        threading.Thread(target=self._read, args=(received,), daemon=True).start()

    def _read(self, received: Received) -> None:
        for sample in self._subscriber:
            with self._lock:
                if not self._core.receive(_WRITER, sample.payload.to_bytes(), WALL_CLOCK.now()):
                    continue
                changes = self._core.changes()
            for _, key, _, _ in changes:
                is_node = isinstance(key, str)
                value = self._core.get_node(key, "order") if is_node else self._core.get_edge(*key, "pose")
                received(int(value if is_node else value.t[0]))

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]
