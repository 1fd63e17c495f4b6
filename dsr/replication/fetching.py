"""Fetches changes from another replica piece by piece; each piece is asked for when the one before has come.

A fetch that is broken off has lost nothing: what came is joined, and the next fetch, of whomever, asks for the rest.
"""

from __future__ import annotations

from itertools import chain

from dsr.crdt.context import CausalContext, Dot, DotRange, without
from dsr.crdt.delta import Delta
from dsr.crdt.pieces import FEWEST_TOLD, START, Piece, Place, share_of_full, share_of_told
from dsr.crdt.store import Store
from dsr.replication.piece_wire import Request, encode_request

MAX_UNJOINED = 1 << 20
"""Changes of one answer that cannot be joined, such as those that others may not hand on: 150 MB or about. Who has more
of them to tell is not listened to any longer."""
_LEAST = 1e-6
"""Share of a piece that brought anything: less than any single change takes"""

State = tuple[int, int]
"""Hashes of what a replica has seen and holds."""


class Fetch:
    """One answer under way.

    Args:
        peer: who is asked.
        seen: what need not be sent; it is not changed, and must not be while it is here.
        insists: see `Request`.
    """

    def __init__(self, peer: str, seen: CausalContext, *, insists: bool) -> None:
        self.peer = peer
        self.joined = False
        """Whether the peer had joined when it began to answer."""
        self.begin: Place | None = START
        """Of the piece to ask for; None if all have come."""
        self.before: State = (0, 0)
        """Of the asker, when it began to ask."""
        self.brought = 0.0
        """How much its pieces have brought, as `brought` tells: that is lost if this answer is forgotten."""
        self.first = 0
        """Number of the first request of which a reply may belong to this answer."""
        self.seen = seen
        """What need not be sent; it may only grow while an answer goes on."""
        self.asks_for_all = False
        """Whether nothing that was seen is left out, since a digest told of more than the gaps here."""
        self._insists = insists
        self._whole: list[DotRange] = []
        self._live: set[Dot] = set()
        self._held_back: set[Dot] = set()
        self._refused = 0

    def request(self, rid: str) -> bytes:
        """The question for the next piece, of replica `rid`."""
        assert self.begin is not None
        return encode_request(Request(rid, self.seen, self.begin, self._insists))

    def take(self, piece: Piece) -> bool:
        """Note that the piece has come, which is to be joined; false if it is not the one asked for."""
        if piece.begin != self.begin or (piece.begin[0] == "" and piece.whole is None):
            return False
        if piece.begin == START:
            self._whole, self.joined = [], piece.joined
            self._live = set()
        if piece.begin[0] == "":
            self._whole += piece.whole or []
        self.begin = piece.end
        return True

    def note_joined(self, piece: Piece, store: Store) -> None:
        """Note that the piece was joined into `store`.

        Changes that wait for others, or may not be judged yet, must not count as seen in the end. What lives elsewhere
        and was removed here never comes back, so it need not be kept in mind.
        """
        seen, entries = store.context.vector.get, store.entries
        beyond = [dot for write in piece.writes if (dot := write.dot) is not None and dot[1] > seen(dot[0], 0)]
        self._held_back.update(dot for dot in beyond if dot not in store.context)
        self._live.update(dot for dot in piece.kept if dot in entries)
        for add in piece.adds:
            self._live.add(add.dot)
            self._refused += add.dot not in entries

    @property
    def is_useless(self) -> bool:
        """Whether the peer sends no end of changes that cannot be joined, or of what it has seen."""
        return max(self._refused + len(self._held_back), len(self._whole)) > MAX_UNJOINED

    def rest(self) -> Delta:
        """Make the delta to be joined in the end: the peer's whole context of the moment when it began to answer.

        It tells once more what was gone there. An addition of that may have come between two pieces.
        """
        whole = list(without(self._whole, self._held_back))
        return Delta(context=whole, live=frozenset(self._live), examined=self._whole)


def is_refusal(piece: Piece) -> bool:
    """Whether the peer only says that it has not joined."""
    return not piece.joined and piece.begin == START and piece.whole is None


def state_of(store: Store) -> State:
    """By which it is told whether something has changed."""
    return store.context.hash, store.fingerprint


def brought(piece: Piece, store: Store, before: State, *, weighed: bool) -> float:
    """How much a piece that was joined has brought, as a share of what those bring that others follow.

    It is 1 for the last one, and 0 if nothing is new and nothing of it is here: made-up pieces have no end. Unless it
    is to be `weighed`, whatever is more than nothing is 1.
    """
    begin, end = piece.begin, piece.end
    if end is None:
        return 1.0
    is_new = state_of(store) != before
    if begin[0] == end[0] == "":  # it tells what the peer has seen, which cannot be much without many ranges
        whole = piece.whole or []
        return max(share_of_told(whole), _LEAST) if weighed else float(is_new or len(whole) >= FEWEST_TOLD)
    told = chain(piece.kept, (add.dot for add in piece.adds))
    if begin[0] and not is_new and not any(begin[:2] <= dot < end[:2] and dot in store.entries for dot in told):
        return 0.0
    return max(share_of_full(piece, store), _LEAST) if weighed else 1.0
