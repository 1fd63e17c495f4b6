"""Large messages to many readers: in shared memory for those on this machine, as bytes for all others.

A writer puts a message into its ring once and sends a small ticket; whoever can open the ring reads it there. A
ticket that cannot be used makes its reader subscribe to the bytes, one that can makes it stop that again.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from typing import Protocol, SupportsBytes
from weakref import WeakValueDictionary

import msgspec

from dsr.network.decoding import decoded
from dsr.network.shared_ring import SLOTS, Ring, RingReader, Ticket
from dsr.network.transport import Chunks, Subscription

_log = logging.getLogger("dsr.network.bulk")
_encoder = msgspec.msgpack.Encoder()
_decoder: msgspec.msgpack.Decoder[Ticket | None] = msgspec.msgpack.Decoder(Ticket | None)
_ROOM = 1.25  # times the size of the first message


class Outlet(Protocol):
    """Where messages of one key leave."""

    @property
    def wanted(self) -> bool:
        """Whether anybody elsewhere listens."""

    def put(self, payload: bytes) -> None:
        """Send a message."""


class BulkWriter:
    """Sends the large messages of one key to whoever wants them; a message that nobody wants costs nothing.

    Args:
        tickets: where tickets leave; an empty one stands for a message that is not in shared memory.
        plain: where bytes leave.
    """

    def __init__(self, tickets: Outlet, plain: Outlet) -> None:
        self._tickets = tickets
        self._plain = plain
        self._writing = threading.Lock()
        self._ring: Ring | None = None
        self.unshared = 0
        """Messages that found no place in shared memory."""

    def put(self, chunks: Chunks) -> None:
        """Send a message given in pieces (of bytes)."""
        if self._tickets.wanted:
            with self._writing:
                ticket = self._share(chunks)
            self._tickets.put(_encoder.encode(ticket))
        if self._plain.wanted:
            self._plain.put(b"".join(chunks))

    def _share(self, chunks: Chunks) -> Ticket | None:
        length = sum(map(len, chunks))
        try:
            if self._ring is None or length > self._ring.slot_size:
                self._ring = Ring(int(_ROOM * length) + 1)
            ticket = self._ring.write(chunks)
            problem = f"readers hold all {SLOTS} slots"
        except OSError as error:
            ticket, problem = None, str(error)
        if ticket is None:
            self.unshared += 1
            if self.unshared == 1:
                _log.warning("a large message goes by copies (%s); further ones are only counted", problem)
        return ticket


Handler = Callable[[SupportsBytes], None]


class BulkReader:
    """Holds the newest large message of one key until it is taken; those that nobody takes are forgotten.

    Args:
        listen_for_tickets: subscribes to tickets with the handler it is given.
        listen_for_bytes: subscribes to messages that come as bytes.
        notify: called from a thread of the network when something has come.
    """

    def __init__(
        self,
        listen_for_tickets: Callable[[Handler], Subscription],
        listen_for_bytes: Callable[[Handler], Subscription],
        notify: Callable[[], None],
    ) -> None:
        self._listen_for_bytes = listen_for_bytes
        self._notify = notify
        self._ring: RingReader | None = None
        self._held_rings: WeakValueDictionary[bytes, RingReader] = WeakValueDictionary()
        """Of several writers that take turns: each ring is opened once, and knows what is held of it."""
        self._unusable = b""
        self._ticket: deque[SupportsBytes] = deque(maxlen=1)
        self._message: deque[SupportsBytes] = deque(maxlen=1)
        self._plain: Subscription | None = None
        self._want_bytes(True)
        self._tickets = listen_for_tickets(self._keep_in(self._ticket))

    def take(self) -> bytes | memoryview | None:
        """The newest message if it was not taken before; one in shared memory stays while it is referred to.

        Raises `WireError` if what came in its place is malformed.
        """
        while self._ticket:
            ticket = decode_ticket(bytes(self._ticket.pop()))
            ring = None if ticket is None else self._ring_of(ticket)
            self._want_bytes(ring is None)
            if ticket is None or ring is None:
                break
            message = ring.view(ticket)
            if message is not None:
                return message
        return bytes(self._message.pop()) if self._plain is not None and self._message else None

    def close(self) -> None:
        """Stop receiving; what was taken stays."""
        self._tickets.close()
        self._want_bytes(False)

    def _ring_of(self, ticket: Ticket) -> RingReader | None:
        """The ring that a ticket names, if it can be read here."""
        if self._ring is None or self._ring.ring != ticket.ring:
            if ticket.ring == self._unusable:
                return None
            try:
                self._ring = self._held_rings[ticket.ring] = self._held_rings.get(ticket.ring) or RingReader(ticket)
            except OSError as error:
                _log.info("large messages come by copies: %s", error)
                self._unusable = ticket.ring
                return None
        return self._ring

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


def decode_ticket(payload: bytes) -> Ticket | None:
    """Where a large message is; None if it is not in shared memory. Raises `WireError`."""
    return decoded(payload, "ticket of a large message", _decoder.decode)
