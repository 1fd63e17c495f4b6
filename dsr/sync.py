"""How replicas stay equal: join, digest and repair, as a protocol without I/O.

Received messages and the time go in; what is to be sent comes out as `Output`s. Rules:

1. Deltas are joined whenever they arrive; nothing relies on their order or on their arrival.
2. A newcomer asks one peer after the other for everything, until it has joined (dsr/joining.py). Who has not
   joined itself says so.
3. Once a second each replica makes its stream samples durable and publishes a digest of what it has seen; digests
   are more frequent for a moment when a peer appears, or after this process was stopped (`dsr.pace`).
4. A replica that still lacks something `GRACE` after a digest told so asks that peer for it (one request
   at a time until patience ends, one for each digest). It only ever pulls, so that nobody has to remember what
   others know. Answers come in pieces of bounded size, each asked for when the one before was joined
   (dsr/fetching.py): so nothing is computed for who has given up.
5. Equal contexts with different fingerprints cannot be; then the replica asks for everything and says so.
6. A replica whose clock most other agents see in their future must not write (`clocks`).

A peer that sends nonsense is counted in `dropped` and logged once; nothing it sends can raise here.
"""

from __future__ import annotations

import logging
import math
import sys
from collections import Counter
from dataclasses import dataclass, field
from typing import Protocol

from dsr.clock_votes import Verdict, Voice, verdict
from dsr.collector import collector_paused
from dsr.crdt.context import CausalContext
from dsr.crdt.delta import Delta
from dsr.crdt.pieces import START, Piece, piece_of
from dsr.crdt.store import Store
from dsr.errors import WireError
from dsr.fetching import Fetch, is_refusal
from dsr.graph import Graph
from dsr.joining import Joining
from dsr.outputs import Ask, Output, PublishDelta, PublishDigest, Renew
from dsr.pace import LAST_PATIENCE, Pace
from dsr.piece_wire import decode_piece, decode_request
from dsr.wire import Digest, decode_delta, decode_digest, encode_digest

GRACE = 0.15
"""s that a delta on its way may be later than the digest that mentions it."""
REQUEST_TIMEOUT = 10.0
"""s after which an answer is of no use any more."""
MAX_DRIFT = 0.5
"""s that a peer's clock may be ahead of ours."""
LONG_WAIT = 1.0
"""s after which a newcomer says for whom it waits."""
JOIN_RETRY = 0.02
"""s after which a newcomer asks the same peer again, whose answer found no way yet."""
SILENCE = 5.0
"""s after which a peer's last digest counts no more."""
MAX_PEERS = 1000
"""Replicas that are listened to, and senders told apart when they err: made-up names must take no memory."""
FORGET = 30.0
"""s after which a silent peer counts as gone; its next digest brings it back."""

_log = logging.getLogger("dsr.sync")


class Gate(Protocol):
    """Decides what of an arriving message may be joined; see dsr/security/gate.py."""

    def delta(self, sender: str, delta: Delta, store: Store) -> Delta:
        """The allowed part of a delta."""

    def reply(self, sender: str, delta: Delta, store: Store) -> Delta:
        """The allowed part of a synchronisation reply."""

    def trusts(self, rid: str) -> bool:
        """Whether that replica may speak for others."""


@dataclass
class _Peer:
    """What is known of another replica; times on the monotonic clock."""

    digest: Digest | None = None
    covered: Digest | None = None
    """The last digest that told nothing that is not known here."""
    heard_at: float = 0.0
    ahead: bool = False
    """Its physical clock was more than MAX_DRIFT in our future."""
    asked: int = 0
    """How often it was asked for something."""
    asked_at: float = -math.inf


@dataclass
class Synchroniser:
    """Keeps one graph in step with its peers."""

    graph: Graph
    gate: Gate | None = None
    """Checks what arrives; None if everybody is believed."""
    joined: bool = False
    dropped: Counter[str] = field(default_factory=Counter)
    """Malformed messages, by sender."""
    repairs: int = 0
    """Replies joined because a digest told of something missing."""
    clocks: Verdict = field(default_factory=Verdict)
    """How our clock stands beside those of the agents heard of lately."""
    pieces: int = 0
    """Pieces of replies that came when they were asked for, of those who had not given all they have before."""
    behind_since: float | None = None
    """Monotonic time since when it is known that something is missing here; None if nothing is."""
    _peers: dict[str, _Peer] = field(default_factory=dict)
    _fetch: Fetch | None = None
    _requests: int = 0
    _pieces_before: int = 0
    _came_at: float = -math.inf
    _under_way: int | None = None
    _asked_at: float = 0.0
    _pace: Pace = field(default_factory=Pace)
    _wants_everything: bool = False
    _complaints: set[tuple[str, str]] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.joining = Joining(self.graph.rid, self._trusts)

    # ---- events

    def peer_appeared(self, rid: str, now: float) -> None:
        """A replica became reachable; it gets a digest at once, so that a healed partition is repaired soon."""
        if rid != self.graph.rid:
            self._peers.setdefault(rid, _Peer())
            self.joining.appeared(rid)
            self._pace.hurry(now)

    def peer_gone(self, rid: str) -> None:
        """A replica became unreachable."""
        self._peers.pop(rid, None)
        self.joining.gone(rid)
        if self._fetch is not None and self._fetch.peer == rid:
            self._give_up()

    def receive_delta(self, sender: str, payload: bytes, physical: float) -> None:
        """A delta or a bundle of stream samples arrived at physical time `physical` (s)."""
        try:
            delta = decode_delta(payload)
            if delta.live is not None:
                raise WireError("a synchronisation reply that nobody asked for")
        except WireError as error:
            self._drop(sender, error)
            return
        self.graph.join(self.gate.delta(sender, delta, self.graph.store) if self.gate else delta, physical)

    def receive_digest(self, sender: str, payload: bytes, now: float, physical: float) -> None:
        """A digest arrived at monotonic time `now` and physical time `physical` (s)."""
        try:
            digest = decode_digest(payload)
            if digest.replica != sender:
                raise WireError(f"a digest of {digest.replica!r}")
        except WireError as error:
            self._drop(sender, error)
            return
        if digest.replica == self.graph.rid:
            return
        if sender not in self._peers and len(self._peers) >= MAX_PEERS:
            return
        peer = self._peers.setdefault(sender, _Peer())
        ahead = digest.now - physical > MAX_DRIFT
        if ahead:
            self._complain(sender, "the clock of %s is %.1f s ahead of ours", digest.now - physical)
        said = peer.digest is not None and self.graph.rid in peer.digest.ahead
        changed = (peer.ahead, said) != (ahead, self.graph.rid in digest.ahead)
        peer.digest, peer.heard_at, peer.ahead = digest, now, ahead
        if changed:
            self._compare_clocks(now)

    def receive_reply(self, sender: str, number: int, payload: bytes, physical: float) -> None:
        """The answer to `Ask` with that number arrived at physical time `physical` (s); what comes late counts, too."""
        try:
            with collector_paused():
                piece = decode_piece(payload)
                self._join_reply(sender, piece.as_delta(), physical)
        except WireError as error:
            self._drop(sender, error)
            self.request_done(number)
            return
        if self._fetch is None or number != self._under_way:
            return
        self._under_way = None
        self._pace.answered()
        self.pieces += not is_refusal(piece) and self.joining.may_have_more(sender)
        if is_refusal(piece):
            self.joining.declined(sender, piece.waits_for)
            self._give_up()
        elif not self._fetch.take(piece, self.graph.store.context):
            self._drop(sender, WireError("another piece than was asked for"))
            self._give_up()
        elif self._fetch.begin is None:
            self._finish(self._fetch, physical)

    def _join_reply(self, sender: str, delta: Delta, physical: float) -> None:
        self.graph.join(self.gate.reply(sender, delta, self.graph.store) if self.gate else delta, physical)

    def _finish(self, fetch: Fetch, physical: float) -> None:
        """All pieces have come."""
        self._join_reply(fetch.peer, fetch.rest(), physical)
        self._give_up()
        self._wants_everything = False
        if self.joined:
            self.repairs += 1
            return
        self.joining.exhausted(fetch.peer)
        self.joined = fetch.joined and self._trusts(fetch.peer)
        self._join_if_nobody_has_more()

    def _join_if_nobody_has_more(self) -> None:
        if not self.joined and self.joining.nobody_has_more and not self.joining.others_possible:
            self.joined = True

    def request_done(self, number: int) -> None:
        """No more answers to that `Ask` will come."""
        if number == self._under_way:
            self._give_up()

    def _give_up(self) -> None:
        """Ask for no further piece."""
        self._fetch = self._under_way = None

    def nobody_there(self) -> None:
        """The caller knows that the graph begins here, or wants it to: nothing to wait for."""
        self.joined = True

    def answer(self, sender: str, payload: bytes) -> Piece | None:
        """A piece of the reply to a peer's request; None if the request is malformed."""
        try:
            request = decode_request(payload)
        except WireError as error:
            self._drop(sender, error)
            return None
        if self.joined or request.insists:
            with collector_paused():
                piece = piece_of(self.graph.store, request.seen, request.begin)
        else:
            piece = Piece(START, waits_for=self.joining.waits_for())
        piece.joined = self.joined
        return piece

    def tick(self, now: float, physical: float) -> list[Output]:
        """What is due at monotonic time `now` and physical time `physical` (s)."""
        outputs: list[Output] = []
        self._pace.look(now)
        if self._pace.settling_due(now):
            settled = self.settle()
            if settled:
                outputs.append(PublishDelta(settled))
        if self._pace.digest_due(now):
            self._forget_silent(now)
            self._compare_clocks(now)
            outputs.append(PublishDigest(self._digest(physical)))
        if self._pace.renewal_due(now):
            outputs.append(Renew())
        outputs += self._ask(now)
        return outputs

    def _ask(self, now: float) -> list[Output]:
        """Ask for the next piece, of the same peer or of another one."""
        self._note_time(now)
        if self._under_way is not None:
            answering = self._fetch is not None and self._fetch.begin != START
            if now - self._asked_at < (LAST_PATIENCE if answering else self._pace.patience):
                return []
            self._pace.unanswered()
            self._give_up()
        if self._fetch is None:
            peer = self._peer_to_ask(now)
            if peer is None:
                return []
            self._peers[peer].asked += 1
            self._peers[peer].asked_at = now
            ranges = () if self._wants_everything else self.graph.store.context.ranges()
            insists = self.joined or self.joining.insists
            self._fetch = Fetch(peer, CausalContext(ranges), insists=insists)
        self._requests += 1
        self._under_way, self._asked_at = self._requests, now
        return [Ask(self._fetch.peer, self._fetch.request(self.graph.rid), self._requests)]

    def _note_time(self, now: float) -> None:
        """For how long something has been missing here."""
        if not self.joined:
            self.joining.since = min(self.joining.since, now)
            self._join_if_nobody_has_more()
            if self.pieces > self._pieces_before:
                self._pieces_before, self._came_at = self.pieces, now
            if now - max(self.joining.since, self._came_at) > LONG_WAIT and self.joining.others:
                self._complain(self.graph.rid, "%s has not joined yet: %s", self.joining.why(now))
        complete = self.joined and self._fetch is None and not self._known_ahead(now)
        self.behind_since = None if complete else now if self.behind_since is None else self.behind_since

    def settle(self) -> Delta:
        """Stream samples made durable: our own, and those of writers that are gone if we may speak for others."""
        return self.graph.settle() if self._trusts(self.graph.rid) else self.graph.settle(sys.maxsize)

    # ---- state

    @property
    def peers(self) -> list[str]:
        """Replica ids of the reachable peers."""
        return sorted(self._peers)

    @property
    def delivered(self) -> bool:
        """Whether every reachable peer told that it has seen all that was written here."""
        rid, store = self.graph.rid, self.graph.store
        samples = [entry.registers[name] for dot, name in store.unsettled if (entry := store.find(dot))]
        last = store.context.vector.get(rid, 0)
        settled = all(sample.writer != rid for sample in samples)
        digests = [peer.digest for peer in self._peers.values()]
        return settled and all(digest and digest.context.vector.get(rid, 0) >= last for digest in digests)

    def _compare_clocks(self, now: float) -> None:
        self.clocks = self._verdict(now)
        kind = self.clocks.kind
        if kind in ("ahead", "behind") or self.clocks.slower:  # single ones that are ahead are told by `receive_digest`
            self._complain(self.graph.rid, f"%s: clocks {kind}: %s", self.clocks)

    def _verdict(self, now: float) -> Verdict:
        return verdict(
            Voice(rid, peer.heard_at, self.graph.rid in peer.digest.ahead, peer.ahead)
            for rid, peer in self._peers.items()
            if peer.digest and now - peer.heard_at < SILENCE
        )

    def _forget_silent(self, now: float) -> None:
        """Drop peers that fell silent, for whom no word of their going may ever come."""
        for rid, peer in list(self._peers.items()):
            if peer.digest and now - peer.heard_at > FORGET:
                self.peer_gone(rid)

    def _digest(self, physical: float) -> bytes:
        ahead = tuple(sorted(rid for rid, peer in self._peers.items() if peer.ahead))
        store = self.graph.store
        return encode_digest(Digest(self.graph.rid, physical, store.context, store.fingerprint, ahead))

    def _peer_to_ask(self, now: float) -> str | None:
        if not self.joined:
            asked = {rid: peer.asked for rid, peer in self._peers.items() if now - peer.asked_at >= JOIN_RETRY}
            return self.joining.choose(asked, asked, now)
        return self._least_asked([rid for rid in self._known_ahead(now) if self._is_new(self._peers[rid])])

    def _known_ahead(self, now: float) -> list[str]:
        """Peers of which a digest told of something that is not here, though it had the time to come."""
        return [
            rid
            for rid, peer in self._peers.items()
            if peer.digest
            and peer.digest is not peer.covered
            and GRACE <= now - peer.heard_at < SILENCE
            and self._is_behind(rid, peer, peer.digest)
        ]

    @staticmethod
    def _is_new(peer: _Peer) -> bool:
        """Whether it was not asked since its last digest."""
        return peer.asked_at < peer.heard_at

    def _least_asked(self, rids: list[str]) -> str | None:
        """The peers in turn, so that one that does not answer is not asked for ever."""
        return min(rids, key=lambda rid: self._peers[rid].asked, default=None)

    def _is_behind(self, rid: str, peer: _Peer, digest: Digest) -> bool:
        store = self.graph.store
        if not store.context.covers(digest.context):
            return True
        if digest.fingerprint != store.fingerprint and digest.context == store.context and self._trusts(rid):
            self._complain(rid, "same history as %s but another state: asking for everything", level=logging.ERROR)
            self._wants_everything = True
            return True
        peer.covered = digest
        return False

    def _trusts(self, rid: str) -> bool:
        return self.gate is None or self.gate.trusts(rid)

    def _drop(self, sender: str, error: WireError) -> None:
        if sender not in self.dropped and len(self.dropped) >= MAX_PEERS:
            sender = "others"
        self.dropped[sender] += 1
        self._complain(sender, "dropped a message from %s: %s (further ones are only counted)", error)

    def _complain(self, rid: str, text: str, *details: object, level: int = logging.WARNING) -> None:
        """Log something about a replica, but only once, and not about any number of made-up ones."""
        if (rid, text) not in self._complaints and len(self._complaints) < MAX_PEERS:
            self._complaints.add((rid, text))
            _log.log(level, text, rid, *details)
