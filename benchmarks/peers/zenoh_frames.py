"""Raw Zenoh: camera frames in buffers that were allocated in its shared memory."""

from __future__ import annotations

import msgspec
import zenoh
import zenoh.shm

from benchmarks.links import Closable, Received, Sender
from benchmarks.peers.zenoh_link import KEY, open_session

_BUFFERS = 16


class ZenohFrameLink(msgspec.Struct, frozen=True):
    """Frames of `size` bytes; the number travels beside them, so that nobody has to look into a frame."""

    endpoint: str
    size: int
    read_out: bool
    """Whether the reader takes the bytes out, which copies them; else it only gets hold of them."""

    def writer(self) -> Sender:
        """The end that listens."""
        return _Sender(self)

    def reader(self, received: Received) -> Closable:
        """An end that connects."""
        return _Reader(self, received)


class _Sender:
    def __init__(self, link: ZenohFrameLink) -> None:
        self._session = open_session(listen=link.endpoint, shared_memory=True)
        self._provider = zenoh.shm.ShmProvider.default_backend(_BUFFERS * link.size)
        self._policy = zenoh.shm.BlockOn(zenoh.shm.GarbageCollect())
        self._content = bytes(link.size)
        self._publisher = self._session.declare_publisher(
            KEY, congestion_control=zenoh.CongestionControl.DROP, priority=zenoh.Priority.DATA_LOW
        )

    def send(self, number: int) -> None:
        buffer = self._provider.alloc(len(self._content), self._policy)
        buffer[:] = self._content
        self._publisher.put(buffer, attachment=number.to_bytes(8, "little"))

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]


class _Reader:
    def __init__(self, link: ZenohFrameLink, received: Received) -> None:
        self._session = open_session(connect=link.endpoint, shared_memory=True)

        def receive(sample: zenoh.Sample) -> None:
            if link.read_out:
                sample.payload.to_bytes()
            elif sample.payload.as_shm() is None:
                return  # it did not come in shared memory: then this would measure something else
            assert sample.attachment is not None
            received(int.from_bytes(sample.attachment.to_bytes(), "little"))

        self._subscriber = self._session.declare_subscriber(KEY, receive)

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]
