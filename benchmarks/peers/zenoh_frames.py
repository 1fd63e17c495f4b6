"""Raw Zenoh with its shared memory: `put` of a frame's bytes, until the callback has them as `bytes`."""

from __future__ import annotations

import msgspec
import zenoh

from benchmarks.links import Closable, Received, Sender
from benchmarks.peers.zenoh_link import open_session

KEY = "bench/frame"


class ZenohFrames(msgspec.Struct, frozen=True):
    """A publisher that drops on congestion, and subscribers with a callback."""

    endpoint: str
    size: int
    """Bytes of a frame."""

    def writer(self) -> Sender:
        """The end that listens."""
        return _Sender(open_session(listen=self.endpoint, shared_memory=True), self.size)

    def reader(self, received: Received) -> Closable:
        """An end that connects."""
        return _Reader(open_session(connect=self.endpoint, shared_memory=True), received)


class _Sender:
    def __init__(self, session: zenoh.Session, size: int) -> None:
        self._session = session
        self._frame = bytes(size)
        self._publisher = session.declare_publisher(KEY, congestion_control=zenoh.CongestionControl.DROP)

    def send(self, number: int) -> None:
        self._publisher.put(self._frame, attachment=number.to_bytes(8, "little"))

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]


class _Reader:
    def __init__(self, session: zenoh.Session, received: Received) -> None:
        self._session = session

        def receive(sample: zenoh.Sample) -> None:
            sample.payload.to_bytes()
            assert sample.attachment is not None
            received(int.from_bytes(sample.attachment.to_bytes(), "little"))

        self._subscriber = session.declare_subscriber(KEY, receive)

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]
