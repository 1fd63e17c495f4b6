"""Large messages to many readers: in shared memory for those on this machine, as bytes for all others.

A writer puts a message into its ring once and sends a small descriptor; whoever can open the ring reads it there. A
descriptor that cannot be used makes its reader subscribe to the bytes, one that can makes it stop that again.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from typing import Protocol, SupportsBytes, TypeVar
from weakref import WeakValueDictionary

import msgspec

from dsr.errors import WireError
from dsr.network.decoding import decoded
from dsr.network.keys import descriptor_key
from dsr.network.shared_ring import SLOTS, Ring, RingReader, SlotDescriptor
from dsr.network.transport import BulkHandler, Chunks, MessageHandler, Subscription

T = TypeVar("T")
_log = logging.getLogger("dsr.network.bulk")
_encoder = msgspec.msgpack.Encoder()
_decoder: msgspec.msgpack.Decoder[SlotDescriptor | None] = msgspec.msgpack.Decoder(SlotDescriptor | None)
_ROOM = 1.25  # times the size of the first message
MOST_STREAMS = 256
"""Streams that one subscription tells apart, more than the cameras of a graph: made-up names must take no memory. One
that was forgotten is found again with its next descriptor."""
MOST_EARLY = 16
"""Messages that came as bytes before their descriptors and are kept: as many cameras as may begin at once."""


class Outlet(Protocol):
    """A sender of the messages of one key."""

    @property
    def wanted(self) -> bool:
        """Whether anybody elsewhere listens."""

    def put(self, payload: bytes) -> None:
        """Send a message."""


class BulkWriter:
    """Sends the large messages of one key to whoever wants them; a message that nobody wants costs nothing.

    Args:
        descriptors: where descriptors leave; an empty one stands for a message that is not in shared memory.
        plain: where bytes leave.
    """

    def __init__(self, descriptors: Outlet, plain: Outlet) -> None:
        self._descriptors = descriptors
        self._plain = plain
        self._writing = threading.Lock()
        self._ring: Ring | None = None
        self.unshared = 0
        """Messages that found no place in shared memory."""

    def put(self, chunks: Chunks) -> None:
        """Send a message given in pieces (of bytes)."""
        if self._descriptors.wanted:
            with self._writing:
                descriptor = self._share(chunks)
            self._descriptors.put(_encoder.encode(descriptor))
        if self._plain.wanted:
            self._plain.put(b"".join(chunks))

    def _share(self, chunks: Chunks) -> SlotDescriptor | None:
        length = sum(map(len, chunks))
        try:
            if self._ring is None or length > self._ring.slot_size:
                self._ring = Ring(int(_ROOM * length) + 1)
            descriptor = self._ring.write(chunks)
            problem = f"readers hold all {SLOTS} slots"
        except OSError as error:
            descriptor, problem = None, str(error)
        if descriptor is None:
            self.unshared += 1
            if self.unshared == 1:
                _log.warning("a large message goes by copies (%s); further ones are only counted", problem)
        return descriptor


Handler = Callable[[SupportsBytes], None]


class _Source:
    """Finds the rings that the descriptors of one stream name.

    Args:
        opened: rings that something refers to. Each is opened once, and so knows what is held of it, whichever streams
            and writers take turns.
    """

    def __init__(self, opened: WeakValueDictionary[bytes, RingReader]) -> None:
        self.shares = False
        """Whether the newest message can be read in place."""
        self._opened = opened
        self._ring: RingReader | None = None
        self._unusable = b""

    def ring_of(self, descriptor: SlotDescriptor | None) -> RingReader | None:
        """The ring that a descriptor names, if it can be read here."""
        ring = None if descriptor is None else self._find(descriptor)
        self.shares = ring is not None
        return ring

    def _find(self, descriptor: SlotDescriptor) -> RingReader | None:
        if self._ring is None or self._ring.ring != descriptor.ring:
            if descriptor.ring == self._unusable:
                return None
            try:
                ring = self._opened.get(descriptor.ring) or RingReader(descriptor)
                self._ring = self._opened[descriptor.ring] = ring
            except OSError as error:
                _log.info("large messages come by copies: %s", error)
                self._unusable = descriptor.ring
                return None
        return self._ring


class BulkReader:
    """Holds the newest large message of one key until it is taken; those that nobody takes are forgotten.

    Args:
        listen_for_descriptors: subscribes to descriptors with the handler it is given.
        listen_for_bytes: subscribes to messages that come as bytes.
        notify: called from a thread of the network when something has come.
    """

    def __init__(
        self,
        listen_for_descriptors: Callable[[Handler], Subscription],
        listen_for_bytes: Callable[[Handler], Subscription],
        notify: Callable[[], None],
    ) -> None:
        self._listen_for_bytes = listen_for_bytes
        self._notify = notify
        self._source = _Source(WeakValueDictionary())
        self._descriptor: deque[SupportsBytes] = deque(maxlen=1)
        self._message: deque[SupportsBytes] = deque(maxlen=1)
        self._plain: Subscription | None = None
        self._want_bytes(True)
        self._descriptors = listen_for_descriptors(self._keep_in(self._descriptor))

    def take(self) -> bytes | memoryview | None:
        """The newest message if it was not taken before; one in shared memory stays while it is referred to.

        Raises `WireError` if what came in its place is malformed.
        """
        while self._descriptor:
            descriptor = decode_descriptor(bytes(self._descriptor.pop()))
            ring = self._source.ring_of(descriptor)
            self._want_bytes(ring is None)
            if descriptor is None or ring is None:
                break
            message = ring.view(descriptor)
            if message is not None:
                return message
        return bytes(self._message.pop()) if self._plain is not None and self._message else None

    def close(self) -> None:
        """Stop receiving; what was taken stays."""
        self._descriptors.close()
        self._want_bytes(False)

    def _want_bytes(self, wanted: bool) -> None:
        if wanted and self._plain is None:
            self._message.clear()
            self._plain = self._listen_for_bytes(self._keep_in(self._message))
        elif not wanted and self._plain is not None:
            plain, self._plain = self._plain, None
            plain.close()

    def _keep_in(self, place: deque[SupportsBytes]) -> Handler:
        def keep(payload: SupportsBytes) -> None:
            place.append(payload)
            self._notify()

        return keep


class BulkSubscription:
    """Hands over each large message of many keys, in place where its writer shares memory with this process.

    Bytes are asked for until a descriptor can be used, and again when one cannot. A stream from elsewhere that begins
    in between therefore lacks its first message.

    Args:
        subscribe: subscribes to small messages.
        key: of the messages, with wildcards.
        handler: gets their keys and contents, in threads of the network. What it keeps of a message in shared memory
            stays there: see `FrameReader`.
    """

    def __init__(
        self, subscribe: Callable[[str, MessageHandler], Subscription], key: str, handler: BulkHandler
    ) -> None:
        self._subscribe = subscribe
        self._key = key
        self._handler = handler
        self._opened: WeakValueDictionary[bytes, RingReader] = WeakValueDictionary()
        self._sources: dict[str, _Source] = {}
        """Of the streams that have sent a descriptor, the one that did last at the end."""
        self._early: dict[str, bytes] = {}
        """The newest message of each stream that came as bytes before the first descriptor was here."""
        self._changing = threading.Lock()
        self._wanting = threading.Lock()
        self._closed = False
        self._plain: Subscription | None = None
        self.malformed = 0
        """Descriptors that were none."""
        self._descriptors = subscribe(descriptor_key(key), self._take_descriptor)
        self._want_bytes(True)

    def close(self) -> None:
        """Stop receiving; harmless when repeated."""
        self._descriptors.close()
        self._closed = True
        self._want_bytes(False)

    def _take_descriptor(self, key: str, payload: bytes) -> None:
        stream = key.removesuffix(descriptor_key(""))
        try:
            descriptor = decode_descriptor(payload)
            with self._changing:
                ring = self._source_of(stream).ring_of(descriptor)
                early = self._early.pop(stream, None)
                all_share = all(source.shares for source in self._sources.values())
            message = early if ring is None or descriptor is None else ring.view(descriptor)
        except WireError as error:
            self.malformed += 1
            if self.malformed == 1:
                _log.warning("%s: %s (further ones are only counted)", key, error)
            return
        if message is not None:
            self._handler(stream, message)
        self._want_bytes(not all_share)

    def _take_bytes(self, stream: str, payload: bytes) -> None:
        with self._changing:
            source = self._sources.get(stream)
            if source is None:
                _put_last(self._early, stream, payload, MOST_EARLY)
        if source is not None and not source.shares:
            self._handler(stream, payload)

    def _source_of(self, stream: str) -> _Source:
        source = self._sources.get(stream) or _Source(self._opened)
        _put_last(self._sources, stream, source, MOST_STREAMS)
        return source

    def _want_bytes(self, wanted: bool) -> None:
        with self._wanting:
            if wanted and self._plain is None and not self._closed:
                self._plain = self._subscribe(self._key, self._take_bytes)
            elif not wanted and self._plain is not None:
                plain, self._plain = self._plain, None
                plain.close()


def _put_last(places: dict[str, T], key: str, value: T, most: int) -> None:
    """Put a value at the end; beyond so many, the first one goes."""
    places.pop(key, None)
    places[key] = value
    if len(places) > most:
        del places[next(iter(places))]


def decode_descriptor(payload: bytes) -> SlotDescriptor | None:
    """Decode the descriptor of a large message; None if the message is not in shared memory. Raises `WireError`."""
    return decoded(payload, "descriptor of a large message", _decoder.decode)
