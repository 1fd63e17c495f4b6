"""How replicas stay equal: join, digest and repair, as a protocol without I/O.

Received messages and the time go in; what is to be sent comes out as `Output`s. Rules:

1. Deltas are joined whenever they arrive; nothing relies on their order or on their arrival.
2. A newcomer asks one peer after the other for everything, until it has joined (`joining.py`). Who has not
   joined itself says so.
3. Once a second each replica makes its stream samples durable and publishes a digest of what it has seen, which costs
   the same whatever its history (`dsr.crdt.summary`); digests are more frequent for a moment when a peer appears, or
   after this process was stopped (`dsr.replication.pace`).
4. A replica that still lacks something `GRACE` after a digest told so, or may lack it, asks that peer for it with all
   that it has seen (one request at a time until patience ends, one for each digest). It only ever pulls, so that nobody
   has to remember what others know. Answers come in pieces of bounded size, each asked for when the one before has
   come (`fetching.py`): so nothing is computed for who has given up. Whose answers change nothing is asked ever
   more rarely (`Peer.pause`).
5. Equal contexts with different fingerprints: a removal has reached one of the two without its dot, as a piece of an
   answer that was broken off, or before it had joined. Then each asks the other for everything, and says so.
6. A replica whose clock most other agents see in their future must not write (`clocks`).
7. What is claimed to have been seen is bounded (`claims.py`). A replica in whose name somebody else speaks refuses
   that and takes another id (`TakeId`): peers that believed it would take what the replica adds for seen.

A peer that sends nonsense is counted in `dropped` and logged once; nothing it sends can raise here.
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import islice
from typing import Protocol

from dsr.crdt.context import CausalContext
from dsr.crdt.delta import Delta
from dsr.crdt.pieces import FEWEST_TOLD, START, Piece, piece_of, seen_by
from dsr.crdt.store import Store
from dsr.errors import WireError
from dsr.graph.graph import Graph
from dsr.network.keys import WHOLE
from dsr.replication.claims import Claims, accounted_for, without_word_of
from dsr.replication.clock_votes import ClockVerdict, Voice, verdict
from dsr.replication.collector import collector_paused
from dsr.replication.complaints import Complaints
from dsr.replication.fetching import Fetch, is_refusal
from dsr.replication.impersonation import Impersonation
from dsr.replication.joining import Joining
from dsr.replication.outputs import Ask, Output, PublishDelta, PublishDigest, Renew, TakeId
from dsr.replication.pace import Pace
from dsr.replication.peers import LAST_PATIENCE, MAX_PEERS, SILENCE, Peer, Peers
from dsr.replication.piece_wire import decode_piece, decode_request
from dsr.replication.portions import parts_in, portion
from dsr.replication.wire import Digest, decode_delta, decode_digest, encode_digest

GRACE = 0.15
"""s that a delta on its way may be later than the digest that mentions it."""
REQUEST_TIMEOUT = 10.0
"""s after which an answer is of no use any more."""
MAX_DRIFT = 0.5
"""s that a peer's clock may be ahead of ours."""
LONG_WAIT = 1.0
"""s of waiting after which a newcomer says for which replicas it waits."""
JOIN_RETRY = 0.02
"""s after which a newcomer asks the same peer again, whose answer found no way yet."""
TURN = SILENCE
"""s after which another peer is asked, if there is one that may have something else: an answer may never end."""
MOST_NAMED = 32
"""Replicas that one message names to people, or for votes about clocks: those known longest."""
MAX_PAUSED = 8
"""Answers that wait for their next turn; of others the next request begins at the beginning."""


class ChangeGate(Protocol):
    """Selects the part of an arriving message that may be joined; see dsr/security/gate.py."""

    def delta(self, sender: str, delta: Delta, store: Store) -> Delta:
        """The allowed part of a delta."""

    def reply(self, sender: str, delta: Delta, store: Store) -> Delta:
        """The allowed part of a synchronisation reply."""

    def trusts(self, rid: str) -> bool:
        """Whether replica `rid` may speak for others."""


@dataclass
class Synchroniser:
    """Keeps one graph in step with its peers."""

    graph: Graph
    gate: ChangeGate | None = None
    """Checks arriving messages; None if everybody is believed."""
    part: str | None = None
    """The part of the graph of which all arriving dots must be (dsr/parts); None where they may be of any."""
    joined: bool = False
    complaints: Complaints = field(default_factory=Complaints)
    repairs: int = 0
    """Replies that brought something that was missing."""
    new_ids: int = 0
    """Number of times when this replica took another id."""
    clocks: ClockVerdict = field(default_factory=ClockVerdict)
    """How our clock stands beside those of the agents heard of lately."""
    pieces: int = 0
    """Pieces of replies that came when they were asked for, and went further than what their senders gave before."""
    ask_ahead: Callable[[Ask], None] | None = None
    """Asks for the next piece before the last one is joined, so that both replicas work at the same time."""
    behind_since: float | None = None
    """Monotonic time since when it is known that something is missing here; None if nothing is."""
    _peers: Peers = field(default_factory=Peers)
    _fetch: Fetch | None = None
    _paused: dict[str, Fetch] = field(default_factory=dict)
    _turn_ends: float = math.inf
    _turn_over: bool = False
    _turn_brought: bool = False
    _ready: set[str] = field(default_factory=set)
    _broken_off: set[str] = field(default_factory=set)
    _requests: int = 0
    _pieces_before: int = 0
    _came_at: float = -math.inf
    _under_way: int | None = None
    _asked_at: float = 0.0
    _asked_ahead: bool = False
    _pace: Pace = field(default_factory=Pace)
    _wants_everything: bool = False

    def __post_init__(self) -> None:
        self.joining = Joining(self.graph.rid, self._trusts)
        self.claims = Claims(self.graph)
        self.impersonation = Impersonation(self.graph, self.complaints)

    # ---- events

    def peer_appeared(self, rid: str, now: float) -> None:
        """A replica became reachable; it gets a digest at once, so that a healed partition is repaired soon."""
        if rid == self.graph.rid:
            return
        if self._peers.appeared(rid, now):
            self.joining.appeared(rid)
            self._pace.hurry(now)
        else:
            self.complaints.say("others", "more replicas announce themselves than are listened to: %s are passed over")

    def peer_gone(self, rid: str, now: float) -> None:
        """The token of a replica was withdrawn: it is asked whether it is still there."""
        self._peers.withdrawn(rid, now)
        if rid not in self._peers:
            self._forget(rid)
        elif self._fetch is not None and self._fetch.peer == rid:
            self._under_way = None  # the same piece is asked for again: who is gone does not answer that

    def _forget(self, rid: str) -> None:
        """Expect nothing more of a replica."""
        self.joining.gone(rid)
        self._paused.pop(rid, None)
        self._ready.discard(rid)
        if self._fetch is not None and self._fetch.peer == rid:
            self._give_up()

    def receive_delta(self, sender: str, payload: bytes, physical: float) -> None:
        """A delta or a bundle of stream samples arrived at physical time `physical` (s)."""
        try:
            delta = decode_delta(payload)
            if delta.live is not None:
                raise WireError("a synchronisation reply that nobody asked for")
            if delta.misfits:
                self.complaints.say(sender, "%s writes values of another kind than their attributes have: taken away")
            if self.gate is None and self.joined and self.claims.is_plain(sender, delta, self.part):
                return self.graph.join(delta, physical)
            self._check_identity(sender, delta)
            self._check_part(delta)
            store = self.graph.store
            delta = self.gate.delta(sender, delta, store) if self.gate else self.claims.own_part(sender, delta)
        except WireError as error:
            self.complaints.drop(sender, error)
            return
        if not self.joined:  # it has nothing that could show a false claim, and is told of all that it lacks anyway
            delta.context = accounted_for(sender, delta)
        if self.claims.may_grow(sender, delta, fetching=self._fetch is not None):
            self.graph.join(delta, physical)
        else:
            self.complaints.say(sender, "too many gaps or newcomers: what %s sends is left to the repair")

    def _check_identity(self, sender: str, delta: Delta) -> None:
        """Raise `WireError` if it speaks in our name."""
        self.impersonation.check(sender, delta, lambda: self.confirmed, gated=self.gate is not None)

    def _check_part(self, delta: Delta) -> None:
        """Raise `WireError` if it is about another part of the graph: some would take it, and others never would."""
        if self.part is not None and (other := [part for part in parts_in(delta) if part != self.part]):
            raise WireError(f"dots of part {other[0]!r} in a message of part {self.part!r}")

    def receive_digest(self, sender: str, payload: bytes, now: float, physical: float) -> None:
        """A digest arrived at monotonic time `now` and physical time `physical` (s)."""
        try:
            digest = decode_digest(payload)
            if digest.replica != sender:
                raise WireError(f"a digest of {digest.replica!r}")
            if sender == self.graph.rid:
                raise WireError("a digest in the name of this replica")
        except WireError as error:
            self.complaints.drop(sender, error)
            return
        known = self._peers.get(sender)
        before = known and (known.ahead, known.digest is not None and self.graph.rid in known.digest.ahead)
        peer = self._peers.heard(sender, digest, now)
        if peer is None:
            return
        self._note_acknowledged(sender, peer, digest)
        peer.ahead = digest.now - physical > MAX_DRIFT
        if peer.ahead:
            self.complaints.say(sender, "the clock of %s is %.1f s ahead of ours", digest.now - physical)
        if (peer.ahead, self.graph.rid in digest.ahead) != (before or (False, False)):
            self._compare_clocks(now)

    def _note_acknowledged(self, sender: str, peer: Peer, digest: Digest) -> None:
        """Take note of how much of ours a peer has seen, and if that is more than there is."""
        counter = self.graph.counter
        listed, peer.rest_known = self.graph.store.context.compare(digest.seen)
        if listed and peer.rest_known and not self._differs(digest):
            peer.covered = digest  # what changes here from now on does not matter
        last = digest.seen.last(self.graph.rid)
        if last is not None and last > counter:
            self.impersonation.notice(sender)
        elif self.impersonation.noticed:
            pass  # what peers say to have seen of ours may be what somebody else has told them
        elif last is not None or peer.rest_known:
            peer.acknowledged = max(peer.acknowledged, counter if last is None else last)

    def receive_reply(self, sender: str, number: int, payload: bytes, physical: float) -> None:
        """The answer to `Ask` with that number arrived at physical time `physical` (s); what comes late counts, too."""
        if sender in self._peers and number == self._under_way:  # what was asked before its token went proves nothing
            self._peers[sender].withdrawn_at = None
        fetch, before = self._fetch if number == self._under_way else None, self._state
        try:
            with collector_paused():
                piece = decode_piece(payload)
                delta = piece.as_delta()
                self._check_piece(sender, piece, delta)
                taken = fetch is not None and self._take(fetch, piece)
                self._join_reply(sender, delta, physical)
        except WireError as error:
            self.complaints.drop(sender, error)
            self._note_answer(sender, useful=False)
            if fetch is not None:
                self._break_off(fetch)
            return
        except BaseException:  # the piece may not be joined: the end of this answer must not account for it
            if fetch is not None:
                self._give_up()
            raise
        counts = taken if fetch is not None else not is_refusal(piece) and sender in self._peers
        went_on = counts and self._brought(piece, before) and self.joining.went_on(sender, piece.end)
        if fetch is None:
            self._ready |= {sender} if went_on else set()  # late, but who gives it gets on
            return
        self._peers.answered(sender)
        self.pieces += went_on
        self._turn_brought |= went_on
        if is_refusal(piece):
            self.joining.declined(sender, piece.waits_for)
            self._give_up()
        elif not taken:
            self.complaints.drop(sender, WireError("another piece than was asked for"))
            self._note_answer(sender, useful=False)
            self._give_up()
        else:
            fetch.note_joined(piece, self.graph.store)
            if fetch.begin is None:
                self._finish(fetch, physical)
            elif fetch.is_useless:
                self.complaints.drop(sender, WireError("too many changes in one answer that cannot be joined"))
                self._note_answer(sender, useful=False)
                self._give_up()

    def _brought(self, piece: Piece, before: tuple[int, int]) -> bool:
        """Whether a joined piece is the last, told something new, or of what is here: made-up ones have no end."""
        begin, end, entries = piece.begin, piece.end, self.graph.store.entries
        if end is None or self._state != before:
            return True
        if begin[0] == "":  # it tells what the peer has seen, which cannot be much without many ranges
            return end[0] != "" or len(piece.whole or ()) >= FEWEST_TOLD
        return any(begin[:2] <= dot < end[:2] and dot in entries for dot in piece.kept)

    def _take(self, fetch: Fetch, piece: Piece) -> bool:
        """Whether it is the piece that was asked for; then the next one is asked for, if there is any."""
        self._under_way = None
        if not fetch.take(piece):
            return False
        if fetch.begin is not None and self.ask_ahead is not None and not self._turn_over:
            self._asked_ahead = True
            self.ask_ahead(self._request(fetch))
        return True

    def _check_piece(self, sender: str, piece: Piece, delta: Delta) -> None:
        """Raise `WireError` if it speaks in our name; leave out of it what nobody can have seen."""
        claimed = [*piece.examined, *(piece.whole or ())]
        self._check_identity(sender, Delta(delta.adds, delta.writes, context=claimed, live=delta.live))
        if piece.whole:
            piece.whole = self.claims.context_part(sender, piece.whole)

    def _join_reply(self, sender: str, delta: Delta, physical: float) -> None:
        if self.impersonation.noticed:  # who was told to have seen what is ours takes it for removed
            delta = without_word_of(self.graph.rid, delta)
        try:
            self._check_part(delta)
        except WireError as error:  # the rest counts: this peer may only hand on what it was told
            self.complaints.drop(sender, error)
            delta = portion(delta, self.part or WHOLE)
        self.graph.join(self.gate.reply(sender, delta, self.graph.store) if self.gate else delta, physical)

    def _finish(self, fetch: Fetch, physical: float) -> None:
        """All pieces have come."""
        rest = self.claims.reply_part(fetch.rest(), joining=not self.joined)
        self._join_reply(fetch.peer, rest, physical)
        self._broken_off.discard(fetch.peer)
        self._fetch = self._under_way = None
        if fetch.joined and not self._broken_off and self.claims.tidy(fetch.peer, rest):
            self.complaints.say(fetch.peer, "after a reply of %s too many gaps were left: the lowest are given up")
            self.graph.look_again()
        changed = self._state != fetch.before
        self._note_answer(fetch.peer, useful=changed)
        self._wants_everything = False
        if self.joined:
            self.repairs += changed
            return
        self.joining.exhausted(fetch.peer)
        self.joined = fetch.joined and self._trusts(fetch.peer)
        self._join_if_nobody_has_more()

    @property
    def _state(self) -> tuple[int, int]:
        return self.graph.store.context.hash, self.graph.store.fingerprint

    def _note_answer(self, sender: str, *, useful: bool) -> None:
        peer = self._peers.get(sender)
        if peer is not None:
            peer.in_vain = 0 if useful else peer.in_vain + 1

    def _join_if_nobody_has_more(self) -> None:
        if not self.joined and self.joining.nobody_has_more and not self.joining.others_possible:
            self.joined = True

    def request_done(self, number: int) -> None:
        """No more answers to that `Ask` will come."""
        if number == self._under_way and self._fetch is not None:
            self._break_off(self._fetch)

    def _break_off(self, fetch: Fetch) -> None:
        """Expect no more of an answer, and perhaps of who gave it."""
        self._give_up()
        self._peers.unanswered(fetch.peer)
        if fetch.peer not in self._peers:
            self._forget(fetch.peer)

    def _give_up(self) -> None:
        """Ask for no further piece."""
        if self._fetch is not None and self._fetch.begin != START and len(self._broken_off) < MAX_PEERS:
            self._broken_off.add(self._fetch.peer)  # what it had not sent yet is a gap that somebody can fill
        if self._fetch is not None and self._turn_brought and self._fetch.peer in self._peers:
            self._ready.add(self._fetch.peer)
        self._fetch = self._under_way = None

    def nobody_there(self) -> None:
        """Note that there is nothing to wait for: the caller knows that the graph begins here, or wants this."""
        self.joined = True

    def answer(self, sender: str, payload: bytes) -> Piece | None:
        """A piece of the reply to a peer's request; None if the request is malformed."""
        try:
            request = decode_request(payload)
        except WireError as error:
            self.complaints.drop(sender, error)
            return None
        store = self.graph.store
        if not self.joined and not request.insists:
            piece = Piece(START, waits_for=self.joining.waits_for()[:MOST_NAMED])
        elif request.begin == START and request.seen.covers(store.context):
            piece = Piece(START, whole=[])  # it accounts for nothing, so that nothing is removed
        else:
            with collector_paused():
                piece = piece_of(store, request.seen, request.begin)
        piece.joined = self.joined
        return piece

    def tick(self, now: float, physical: float) -> list[Output]:
        """Do the work that is due at monotonic time `now` and physical time `physical` (s), and return its outputs."""
        outputs: list[Output] = []
        self._pace.look(now)
        self.claims.look(now)
        if self.impersonation.is_new_id_due(now):
            return [TakeId()]
        self._forget_gone(now)
        if self._pace.settling_due(now) and (settled := self.make_durable()):
            outputs.append(PublishDelta(settled))
        if self._pace.digest_due(now):
            self._compare_clocks(now)
            outputs.append(PublishDigest(self.digest(physical)))
        if self._pace.renewal_due(now):
            outputs.append(Renew())
        outputs += self._ask(now)
        return outputs

    def _ask(self, now: float) -> list[Output]:
        """Ask for the next piece, of the same peer or of another one."""
        self._note_time(now)
        if self._asked_ahead:
            self._asked_at, self._asked_ahead = now, False
        if self._fetch is not None and now >= self._turn_ends and not self._turn_over:
            self._turn_over = self._others_wait(now)
        if self._under_way is not None:
            if now - self._asked_at < self._patience():
                return []
            if self._fetch is not None:
                self._peers.came_late(self._fetch.peer)
            self._turn_over = True
        if self._fetch is not None and self._turn_over:
            self._pause(self._fetch)
        if self._fetch is None:
            peer = self._peer_to_ask(now)
            if peer is None:
                return []
            self._peers[peer].asked += 1
            self._peers[peer].asked_at = now
            self._fetch, self._turn_ends, self._turn_over = self._begun(peer), now + TURN, False
            self._turn_brought = False
            self._ready.discard(peer)
        self._asked_at = now
        return [self._request(self._fetch)]

    def _patience(self) -> float:
        """How long the piece that was asked for is waited for, s; the longest for one who has begun to answer."""
        peer = self._peers.get(self._fetch.peer) if self._fetch is not None and self._fetch.begin == START else None
        return LAST_PATIENCE if peer is None else peer.patience

    def _begun(self, peer: str) -> Fetch:
        """The answer of a peer that is asked next: a new one, or one that goes on."""
        paused = self._paused.pop(peer, None)
        if paused is not None and not self._wants_everything:
            return paused
        ranges = () if self._wants_everything else seen_by(self.graph.store)
        fetch = Fetch(peer, CausalContext(ranges), insists=self.joined or self.joining.insists)
        fetch.before = self._state
        return fetch

    def _pause(self, fetch: Fetch) -> None:
        """Let others answer; this answer goes on, with the same piece, when it is the turn of who gives it."""
        self._give_up()
        if self._turn_brought:
            self._ready.add(fetch.peer)
        if fetch.begin != START and len(self._paused) < MAX_PAUSED:
            self._paused[fetch.peer] = fetch

    def _others_wait(self, now: float) -> bool:
        """Whether somebody else may have what is missing here."""
        answering = self._fetch.peer if self._fetch is not None else ""
        if not self.joined:
            return any(rid != answering and self.joining.may_have_more(rid) for rid in self._peers)
        return any(rid != answering and self._is_due(self._peers[rid], now) for rid in self._known_ahead(now))

    def _request(self, fetch: Fetch) -> Ask:
        self._requests += 1
        self._under_way = self._requests
        return Ask(fetch.peer, fetch.request(self.graph.rid), self._requests)

    def _note_time(self, now: float) -> None:
        """For how long something has been missing here."""
        if not self.joined:
            self.joining.since = min(self.joining.since, now)
            self._join_if_nobody_has_more()
            if self.pieces > self._pieces_before:
                self._pieces_before, self._came_at = self.pieces, now
            if now - max(self.joining.since, self._came_at) > LONG_WAIT and self.joining.others:
                self.complaints.say(self.graph.rid, "%s has not joined yet: %s", self.joining.why(now))
        ahead = [rid for rid in self._known_ahead(now) if not self._peers[rid].in_vain]
        complete = self.joined and self._fetch is None and not ahead
        self.behind_since = None if complete else now if self.behind_since is None else self.behind_since

    def make_durable(self) -> Delta:
        """Stream samples made durable: our own, and those of writers that are gone if we may speak for others."""
        return self.graph.make_durable() if self._trusts(self.graph.rid) else self.graph.make_durable(sys.maxsize)

    # ---- state

    @property
    def dropped(self) -> Counter[str]:
        """Malformed messages, by sender."""
        return self.complaints.dropped

    @property
    def is_asking(self) -> bool:
        """Whether an answer is under way."""
        return self._fetch is not None

    @property
    def peers(self) -> list[str]:
        """Replica ids of the reachable peers."""
        return sorted(self._peers)

    @property
    def passed_over(self) -> int:
        """Claims beyond what is taken from one sender, and replicas beyond those listened to."""
        return self.claims.passed_over + self._peers.refused

    def heard_at(self, rid: str) -> float:
        """The monotonic time (s) of a replica's last digest; minus infinity without any."""
        peer = self._peers.get(rid)
        return -math.inf if peer is None else peer.heard_at

    def was_asked(self, rid: str) -> bool:
        """Whether a replica was asked for what it has, or cannot be, for nobody there goes by that id."""
        peer = self._peers.get(rid)
        return peer is None or peer.asked > 0

    def keeps_waiting(self, rid: str) -> bool:
        """Whether a replica gave what it was asked for last, and is not asked now: it is others' turn."""
        return rid in self._ready

    @property
    def heard(self) -> list[str]:
        """Replica ids of the peers that have spoken: nobody else need be waited for."""
        peers = list(self._peers.items())  # other threads may ask while peers come and go
        return sorted(rid for rid, peer in peers if peer.digest)

    @property
    def is_held_up(self) -> bool:
        """Whether somebody may have more who holds the graph or has spoken; a token alone holds nothing up."""
        return any(map(self.joining.may_have_more, {*self.joining.holders, *self.heard}))

    @property
    def delivered(self) -> bool:
        """Whether every peer that is heard has seen all that was written here."""
        rid, store = self.graph.rid, self.graph.store
        samples = [entry.registers[name] for dot, name in store.unsettled if (entry := store.find(dot))]
        settled = all(sample.writer != rid for sample in samples)
        heard = [peer for peer in self._peers.values() if peer.digest] or list(self._peers.values())
        return settled and all(peer.acknowledged >= self.graph.counter for peer in heard)

    @property
    def confirmed(self) -> int:
        """The counter up to which all who may lack it have told to have seen what was written here."""
        return self._peers.confirmed

    def id_taken(self) -> None:
        """The replica has another id now, under which nobody has seen anything."""
        self.new_ids += 1
        self.impersonation.forged.clear()
        self.joining.rid = self.graph.rid
        self._peers.confirm_nothing()

    def _compare_clocks(self, now: float) -> None:
        self.clocks = self._verdict(now)
        kind = self.clocks.kind
        if kind in ("ahead", "behind") or self.clocks.slower:  # single ones that are ahead are told by `receive_digest`
            self.complaints.say(self.graph.rid, f"%s: clocks {kind}: %s", self.clocks)

    def _verdict(self, now: float) -> ClockVerdict:
        return verdict(
            Voice(rid, peer.heard_at, self.graph.rid in peer.digest.ahead, peer.ahead)
            for rid, peer in self._peers.items()
            if peer.digest and now - peer.heard_at < SILENCE
        )

    def _forget_gone(self, now: float) -> None:
        """Drop peers that are gone, for some of whom no word of their going may ever come."""
        for rid in self._peers.forget_gone(now):
            self._forget(rid)

    def digest(self, physical: float) -> bytes:
        """Encode the digest for the peers at physical time `physical` (s)."""
        ahead = tuple(sorted(islice((rid for rid, peer in self._peers.items() if peer.ahead), MOST_NAMED)))
        rid, store = self.graph.rid, self.graph.store
        return encode_digest(Digest(rid, physical, store.context.summary(rid), store.fingerprint, ahead))

    def _peer_to_ask(self, now: float) -> str | None:
        if not self.joined:
            asked = {rid: peer.asked for rid, peer in self._peers.items() if now - peer.asked_at >= JOIN_RETRY}
            return self.joining.choose(asked, asked, now)
        leaving = [rid for rid, peer in self._peers.items() if peer.is_leaving]
        if leaving:
            return leaving[0]
        return self._least_asked([rid for rid in self._known_ahead(now) if self._is_due(self._peers[rid], now)])

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
    def _is_due(peer: Peer, now: float) -> bool:
        """Whether it was not asked since its last digest, nor too soon after an answer that changed nothing."""
        return peer.asked_at < peer.heard_at and now - peer.asked_at >= peer.pause

    def _least_asked(self, rids: list[str]) -> str | None:
        """The peers in turn, so that one that does not answer is not asked for ever; last those that seem to leave."""
        peers = self._peers
        return min(rids, key=lambda rid: (peers[rid].withdrawn_at is not None, peers[rid].asked), default=None)

    def _is_behind(self, rid: str, peer: Peer, digest: Digest) -> bool:
        listed, rest = self.graph.store.context.compare(digest.seen)
        if not listed or not (rest or peer.rest_known):
            return True
        if self._differs(digest) and self._trusts(rid):
            self.complaints.say(rid, "a removal has come to %s or to us without its dot: asking for everything")
            self._wants_everything = True
            return True
        peer.covered, peer.in_vain = digest, 0
        return False

    def _differs(self, digest: Digest) -> bool:
        """Whether somebody holds something else and has seen the same: one of us cannot account for a removal."""
        store = self.graph.store
        if digest.fingerprint == store.fingerprint or digest.seen.hash != store.context.hash:
            return False
        self.graph.look_between()  # edges that turned out to be dead may still be here
        return digest.fingerprint != store.fingerprint

    def _trusts(self, rid: str) -> bool:
        return self.gate is None or self.gate.trusts(rid)
