"""One mesh on its way here: who has it, piece by piece from one of them, verified, else from the next. No threads.

1. Everybody is asked at once; the first who offers it is the source, the others are kept for later.
2. A source on this machine says where its bytes can be read in place. Otherwise they come in pieces, a few at a time.
3. Bytes that do not have the hash are dropped and counted, and so is a source that falls silent; then comes the next.
4. Without another source the transfer has failed, as soon as everybody asked has answered or had his time.
"""

from __future__ import annotations

import logging
import threading
from collections import Counter, deque
from collections.abc import Callable
from typing import NamedTuple, Protocol

from dsr.errors import WireError
from dsr.geometry.mesh import Mesh, hash_of
from dsr.geometry.messages import MOST_ASKED, Ask, Offer, decode_offer, encode_ask
from dsr.geometry.shared import read_in_place

EVERYBODY = "*"
_AT_ONCE = 4  # pieces asked for
_MOST_OFFERS = 32
_log = logging.getLogger("dsr.meshes")


class Network(Protocol):
    """What a transfer needs: calls it in one thread at a time, and passes on answers in the same way."""

    def ask(
        self, holder: str, payload: bytes, on_reply: Callable[[str, bytes], None], on_done: Callable[[], None]
    ) -> None:
        """Ask one holder (replica id), or `EVERYBODY`; `on_reply(holder, payload)` for each answer, then `on_done`."""


class Source(NamedTuple):
    """Somebody who has the mesh."""

    holder: str
    """Replica id."""
    offer: Offer


class Transfer:
    """Gets the mesh `hash`; `finished` is set when `mesh` is here, or nobody has it.

    Args:
        hash: of the mesh.
        network: to ask.
        counts: what happened, by name: `received`, `in_place` (bytes), `mismatched`, `malformed`, `silent` (sources).
    """

    def __init__(self, hash: str, network: Network, counts: Counter[str]) -> None:
        self.hash = hash
        self.mesh: Mesh | None = None
        self.finished = threading.Event()
        self._network = network
        self._counts = counts
        self._offers: deque[Source] = deque()
        self._offered = 0
        self._locating = True
        self._source: Source | None = None
        self._buffer = bytearray()
        self._to_ask: deque[int] = deque()
        self._missing: set[int] = set()

    def begin(self) -> None:
        """Ask who has it."""
        self._network.ask(EVERYBODY, encode_ask(Ask(self.hash)), self._take_offer, self._end_of_offers)

    def _take_offer(self, holder: str, payload: bytes) -> None:
        self._offered += 1
        if self.finished.is_set() or self._offered > _MOST_OFFERS:
            return
        try:
            offer = decode_offer(payload)
        except WireError as error:
            self._drop(holder, "malformed", str(error))
            return
        if offer.size:
            self._offers.append(Source(holder, offer))
            if self._source is None:
                self._next_source()

    def _end_of_offers(self) -> None:
        self._locating = False
        if self._source is None:
            self._next_source()

    def _next_source(self) -> None:
        self._source = None
        while self._source is None and self._offers and not self.finished.is_set():
            source = self._offers.popleft()
            if not self._read_in_place(source):
                self._source = source
                self._begin_pieces(source)
        if self._source is None and not self._locating:
            self.finished.set()

    def _read_in_place(self, source: Source) -> bool:
        """Whether the mesh could be had so; what does not match may have changed since, and comes in pieces."""
        if source.offer.place is None:
            return False
        try:
            data = read_in_place(source.offer.place)
        except (OSError, ValueError) as error:
            _log.debug("mesh %s is not read in place: %s", self.hash, error)
            return False
        if not self._verify(source, data):
            return False
        self._counts["in_place"] += len(data)
        return True

    def _begin_pieces(self, source: Source) -> None:
        self._buffer = bytearray(source.offer.size)
        self._to_ask = deque(range(0, source.offer.size, MOST_ASKED))
        self._missing = set(self._to_ask)
        for _ in range(_AT_ONCE):
            self._ask_piece(source)

    def _ask_piece(self, source: Source) -> None:
        if not self._to_ask:
            return
        offset = self._to_ask.popleft()
        length = min(MOST_ASKED, source.offer.size - offset)
        self._network.ask(
            source.holder,
            encode_ask(Ask(self.hash, offset, length)),
            lambda _, payload: self._take_piece(source, offset, length, payload),
            lambda: self._end_of_piece(source, offset),
        )

    def _take_piece(self, source: Source, offset: int, length: int, payload: bytes) -> None:
        if source is not self._source or offset not in self._missing:
            return
        if len(payload) != length:
            self._drop(source.holder, "malformed", f"{len(payload)} bytes where {length} were asked for")
            self._next_source()
            return
        self._buffer[offset : offset + length] = payload
        self._counts["received"] += length
        self._missing.discard(offset)
        self._ask_piece(source)
        if not self._missing and not self._verify(source, memoryview(self._buffer).toreadonly()):
            self._next_source()

    def _end_of_piece(self, source: Source, offset: int) -> None:
        if source is self._source and offset in self._missing and not self.finished.is_set():
            self._drop(source.holder, "silent", "it does not answer")
            self._next_source()

    def _verify(self, source: Source, data: memoryview) -> bool:
        """Finish with these bytes if they are the mesh."""
        if hash_of(data) != self.hash:
            self._drop(source.holder, "mismatched", "its bytes do not match the hash")
            return False
        try:
            self.mesh = Mesh.decode(data, self.hash)
        except WireError as error:
            self._drop(source.holder, "malformed", str(error))
            return False
        self.finished.set()
        return True

    def _drop(self, holder: str, reason: str, message: str) -> None:
        self._counts[reason] += 1
        if self._counts[reason] == 1:
            _log.warning("mesh %s from %s: %s (further ones are only counted)", self.hash, holder, message)
