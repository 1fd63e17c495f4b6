"""An agent that claims to hold parts, and never gives all of them: nobody may wait for it for ever."""

from __future__ import annotations

from typing import Literal, get_args

import msgspec

from dsr.clock import Clock
from dsr.crdt.context import CausalContext
from dsr.crdt.delta import Add, Write
from dsr.crdt.pieces import FEWEST_TOLD, START, Piece, Place
from dsr.network.keys import Keys, agent_of, part_rid
from dsr.network.transport import Qos, Transport
from dsr.replication.holders import HoldersAnswer, decode_query
from dsr.replication.inquiry import REQUEST_TIMEOUT
from dsr.replication.piece_wire import decode_request, encode_piece
from dsr.replication.wire import Digest, encode_digest

Kind = Literal[
    "tells nothing", "is not there", "is silent", "waits itself", "never ends", "begins anew", "makes up", "repeats",
    "trickles", "tells ranges",
]  # fmt: skip
KINDS: tuple[Kind, ...] = get_args(Kind)
"""What it does: says not even whether it holds a part; says so and does not take part in it; takes part and does not
answer; answers that it has not joined, whoever insists; gives the first piece and never the next; spoils the next;
gives one after the other, of what never was; says in each that its only element lives; makes a further element for
each, as rarely as it is listened to; or tells ever more ranges that it has seen."""
RARELY = 15.0
"""s between two answers of the one that trickles: others are waited for that long"""


class Claimant:
    """Speaks in the base of a graph whenever `speak` is called, and in some parts; what it has of the base it gives.

    Args:
        kind: what it does, and does not.
        transport: its connection.
        clock: for its digests.
        graph: name of the graph.
        rid: its replica id in the base.
        parts: which it claims to hold.
    """

    def __init__(
        self, kind: Kind, transport: Transport, clock: Clock, graph: str, rid: str, parts: tuple[str, ...]
    ) -> None:
        self._kind, self._transport, self._clock, self._rid = kind, transport, clock, rid
        self._gave_at = clock.monotonic()
        base, agent = Keys(graph), agent_of(rid)
        self._speaks_as = {base.digest(rid): rid}
        self._held = {Keys(graph, part=part).place: part_rid(rid, part, 1) for part in parts}
        transport.announce(base.presence(agent, rid))
        nothing = encode_piece(Piece(START, whole=[], joined=False))
        transport.serve(base.sync(rid), lambda key, payload: nothing)
        if kind != "tells nothing":
            transport.serve(base.holders(rid), self._claim)
        if kind in ("tells nothing", "is not there"):
            return
        for part in parts:
            keys, mine = Keys(graph, part=part), part_rid(rid, part, 1)
            if kind != "is silent":
                transport.serve(keys.sync(mine), self._answer)
            transport.announce(keys.presence(agent, mine))
            self._speaks_as[keys.digest(mine)] = mine

    def _claim(self, key: str, payload: bytes) -> bytes:
        places = decode_query(payload).places
        return msgspec.msgpack.encode(HoldersAnswer(1, self._rid, [self._held.get(place, "") for place in places]))

    def _answer(self, key: str, payload: bytes) -> bytes | None:
        if self._kind == "waits itself":
            return encode_piece(Piece(START, joined=False, waits_for=["nobody-1"]))
        begin = decode_request(payload).begin
        if begin == START and self._kind != "tells ranges":
            return encode_piece(Piece(START, (key.rpartition("/")[2], 1, ""), whole=[]))
        rare = {"trickles": self._trickle, "tells ranges": self._ranges}.get(self._kind)
        if rare is not None:
            return rare(begin)
        if self._kind == "makes up":
            return encode_piece(self._made_up(begin))
        if self._kind == "repeats":
            return encode_piece(self._repeated(begin))
        return b"nonsense" if self._kind == "begins anew" else None

    def _made_up(self, begin: Place) -> Piece:
        """A piece with an element that lives, a value of it and a range that was seen, all of which never were."""
        rid, first, _ = begin
        owner, counter = (rid, first), first + 1
        write = Write(owner, "seen", 1, rid, (rid, counter), 1)
        return Piece(begin, (rid, first + 2, ""), writes=[write], kept=[owner], examined=[(rid, first, counter)])

    def _trickle(self, begin: Place) -> bytes | None:
        """A piece with one further element, if the last one was long ago; else no answer."""
        if self._clock.monotonic() - self._gave_at < RARELY:
            return None
        self._gave_at = self._clock.monotonic()
        rid, counter, _ = begin
        return encode_piece(Piece(begin, (rid, counter + 1, ""), adds=[Add((rid, counter), f"ball_{counter}", "ball")]))

    def _ranges(self, begin: Place) -> bytes | None:
        """A piece with the fewest ranges that others follow, each of a short name, if the last one was long ago."""
        if self._clock.monotonic() - self._gave_at < REQUEST_TIMEOUT / 2:
            return None
        self._gave_at = self._clock.monotonic()
        whole = [(f"x-{number}", 1, 1) for number in range(FEWEST_TOLD)]
        return encode_piece(Piece(begin, ("", begin[1] + FEWEST_TOLD, ""), whole=whole))

    def _repeated(self, begin: Place) -> Piece:
        """A piece with one true element, or with nothing but its name, as if that were news."""
        rid, first, _ = begin
        end = (rid, first + 2, "")
        own = (rid, 1)
        return Piece(begin, end, adds=[Add(own, "thing", "cube")]) if first == 1 else Piece(begin, end, kept=[own])

    def speak(self) -> None:
        """Send digests, as whoever is there and well does once a second."""
        for key, rid in self._speaks_as.items():
            digest = Digest(rid, self._clock.now(), CausalContext().summary(), 0, ())
            self._transport.publish(key, encode_digest(digest), Qos.STREAM)
