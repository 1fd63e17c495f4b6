"""One mesh on its way here: who has it, piece by piece, verified; whoever brings it first ends it. No threads.

1. Everybody is asked at once; who offers it is a source. Of one agent only a few offers count.
2. A source on this machine says where its bytes can be read in place. Otherwise they come in pieces, a few at a time.
3. Bytes that do not have the hash are dropped and counted, and so is a source that falls silent; then comes the next.
   Agents take turns.
4. Anybody can claim to have a mesh, so nobody holds up the others: after `PATIENCE` the next source is asked as well.
5. Without another source the transfer has failed, as soon as everybody asked has answered or had his time.
"""

from __future__ import annotations

import logging
import math
import threading
from collections import Counter, deque
from collections.abc import Callable
from typing import NamedTuple, Protocol

from dsr.errors import WireError
from dsr.geometry.mesh import Mesh, hash_of
from dsr.geometry.messages import MOST_ASKED, AskForMesh, Offer, decode_offer, encode_ask
from dsr.geometry.shared import read_in_place
from dsr.network.keys import agent_of

EVERYBODY = "*"
PATIENCE = 0.5
"""s for which sources may keep others waiting: longer than an honest one on one machine takes for the largest mesh."""
MOST_SOURCES = 4
"""Sources that send pieces at once; each may take up as much memory as the largest mesh."""
_AT_ONCE = 4  # pieces asked for of one source
_MOST_OFFERS = 256
_MOST_OFFERS_OF_AGENT = 8  # which may have as many replicas here; in a secured graph nobody makes up more agents
_log = logging.getLogger("dsr.meshes")


class Network(Protocol):
    """The network as a transfer needs it: it calls the transfer in one thread at a time, and passes on answers in the
    same way.
    """

    def ask(
        self, holder: str, payload: bytes, on_reply: Callable[[str, bytes], None], on_done: Callable[[], None]
    ) -> None:
        """Ask one holder (replica id), or `EVERYBODY`; `on_reply(holder, payload)` for each answer, then `on_done`."""


class MeshSource(NamedTuple):
    """A replica that has the mesh."""

    holder: str
    """Replica id."""
    offer: Offer


class _Pieces:
    """What came of one source."""

    def __init__(self, source: MeshSource) -> None:
        self.source = source
        self.buffer = bytearray(source.offer.size)  # takes memory only where a piece was put
        self.to_ask = deque(range(0, source.offer.size, MOST_ASKED))
        self.missing = set(self.to_ask)

    @property
    def share(self) -> float:
        """Of the pieces, how many came, 0 to 1."""
        return 1.0 - len(self.missing) / math.ceil(self.source.offer.size / MOST_ASKED)


class Transfer:
    """Gets the mesh `hash`; `finished` is set when `mesh` is here, or nobody has it. Call `look` again and again.

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
        self._waiting: list[MeshSource] = []
        self._offers: Counter[str] = Counter()
        """How many came, by agent."""
        self._tried: Counter[str] = Counter()
        """How often sources were turned to, by agent."""
        self._locating = True
        self._running: list[_Pieces] = []
        self._begun_at = -math.inf
        """When the newest source began to send pieces."""

    def begin(self) -> None:
        """Ask all replicas who has the mesh."""
        self._network.ask(EVERYBODY, encode_ask(AskForMesh(self.hash)), self._take_offer, self._end_of_offers)

    def look(self, now: float) -> None:
        """Turn to the sources whose turn it is at monotonic time `now` (s)."""
        while self._waiting and not self.finished.is_set():
            if self._running and now < self._begun_at + PATIENCE:
                return
            source = min(self._waiting, key=lambda source: self._tried[_agent(source.holder)])
            self._waiting.remove(source)
            self._tried[_agent(source.holder)] += 1
            if source.offer.place is not None:
                self._read_in_place(source)
                continue
            if len(self._running) == MOST_SOURCES:
                self._running.remove(min(self._running, key=lambda pieces: pieces.share))
            self._begun_at = now
            self._begin_pieces(source)
        if not (self._running or self._waiting or self._locating):
            self.finished.set()

    def _take_offer(self, holder: str, payload: bytes) -> None:
        agent = _agent(holder)
        if self._offers.total() >= _MOST_OFFERS or self._offers[agent] >= _MOST_OFFERS_OF_AGENT:
            return
        self._offers[agent] += 1
        try:
            offer = decode_offer(payload)
        except WireError as error:
            self._drop(holder, "malformed", str(error))
            return
        if offer.size:
            self._waiting.append(MeshSource(holder, offer))

    def _end_of_offers(self) -> None:
        self._locating = False

    def _read_in_place(self, source: MeshSource) -> None:
        """Have the mesh so, if it can be had; what does not match may have changed since, and comes in pieces."""
        assert source.offer.place is not None
        self._waiting.append(MeshSource(source.holder, Offer(source.offer.size)))
        try:
            data = read_in_place(source.offer.place)
        except (OSError, ValueError) as error:
            _log.debug("mesh %s is not read in place: %s", self.hash, error)
            return
        if self._verify(source, data):
            self._counts["in_place"] += len(data)

    def _begin_pieces(self, source: MeshSource) -> None:
        try:
            pieces = _Pieces(source)
        except MemoryError:
            self._drop(source.holder, "malformed", f"there is no room for {source.offer.size} bytes")
            return
        self._running.append(pieces)
        for _ in range(_AT_ONCE):
            self._ask_piece(pieces)

    def _ask_piece(self, pieces: _Pieces) -> None:
        if not pieces.to_ask:
            return
        offset = pieces.to_ask.popleft()
        length = min(MOST_ASKED, pieces.source.offer.size - offset)
        self._network.ask(
            pieces.source.holder,
            encode_ask(AskForMesh(self.hash, offset, length)),
            lambda _, payload: self._take_piece(pieces, offset, length, payload),
            lambda: self._end_of_piece(pieces, offset),
        )

    def _take_piece(self, pieces: _Pieces, offset: int, length: int, payload: bytes) -> None:
        if pieces not in self._running or offset not in pieces.missing or self.finished.is_set():
            return
        if len(payload) != length:
            self._running.remove(pieces)
            self._drop(pieces.source.holder, "malformed", f"{len(payload)} bytes where {length} were asked for")
            return
        pieces.buffer[offset : offset + length] = payload
        self._counts["received"] += length
        pieces.missing.discard(offset)
        self._ask_piece(pieces)
        if not pieces.missing:
            self._running.remove(pieces)
            self._verify(pieces.source, memoryview(pieces.buffer).toreadonly())

    def _end_of_piece(self, pieces: _Pieces, offset: int) -> None:
        if pieces in self._running and offset in pieces.missing and not self.finished.is_set():
            self._running.remove(pieces)
            self._drop(pieces.source.holder, "silent", "it does not answer")

    def _verify(self, source: MeshSource, data: memoryview) -> bool:
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
        self._running.clear()
        return True

    def _drop(self, holder: str, reason: str, message: str) -> None:
        self._counts[reason] += 1
        if self._counts[reason] == 1:
            _log.warning("mesh %s from %s: %s (further ones are only counted)", self.hash, holder, message)


def _agent(holder: str) -> str:
    return agent_of(holder) or holder
