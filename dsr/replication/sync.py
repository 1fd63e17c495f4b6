"""How replicas stay equal: join, digest and repair, as a protocol without I/O.

Received messages and the time go in; what is to be sent comes out as `Output`s. Rules:

1. Deltas are joined whenever they arrive; nothing relies on their order or on their arrival.
2. A newcomer asks one peer after the other for everything, until it has joined (`joining.py`). Who has not
   joined itself says so.
3. Once a second each replica makes its stream samples durable and publishes a digest of what it has seen, which costs
   the same whatever its history (`dsr.crdt.summary`); digests are more frequent for a moment when a peer appears, or
   after this process was stopped (`dsr.replication.pace`).
4. A replica that still lacks something `GRACE` after a digest told so, or may lack it (`lacking.py`), asks that peer
   for it with all that it has seen: one request at a time until patience ends, one for each digest (`inquiry.py`). It
   only ever pulls, so that nobody has to remember what others know. Answers come in pieces of bounded size, each asked
   for when the one before has come (`fetching.py`): so nothing is computed for who has given up. Whose answers change
   nothing is asked ever more rarely (`Peer.pause`).
5. Equal contexts with different fingerprints: a removal has reached one of the two without its dot, as a piece of an
   answer that was broken off, or before it had joined; or a liar has made two things under one dot. Then each asks the
   other for everything, and says so.
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
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, Protocol, TypeVar

from dsr.crdt.delta import Delta
from dsr.crdt.pieces import START, Piece, piece_of
from dsr.crdt.store import Store
from dsr.errors import WireError
from dsr.graph.graph import Graph
from dsr.graph.rights import Rights
from dsr.network.keys import WHOLE, agent_of
from dsr.replication.claims import Claims, accounted_for, without_word_of
from dsr.replication.clock_votes import ClockVerdict, Voice, verdict
from dsr.replication.collector import collector_paused
from dsr.replication.complaints import Complaints
from dsr.replication.fetching import Fetch, brought, is_refusal, state_of
from dsr.replication.impersonation import Impersonation
from dsr.replication.inquiry import Inquiry
from dsr.replication.joining import Joining
from dsr.replication.lacking import Lacking
from dsr.replication.outputs import Ask, Output, PublishDelta, PublishDigest, Renew, TakeId
from dsr.replication.pace import Pace
from dsr.replication.peers import SILENCE, Peer, Peers
from dsr.replication.piece_wire import Request, decode_piece, decode_request
from dsr.replication.portions import parts_in, portion
from dsr.replication.wire import MOST_NAMED, Digest, decode_delta, decode_digest, encode_digest

T = TypeVar("T")
MAX_DRIFT = 0.5
"""s that a peer's clock may be ahead of ours."""
LONG_WAIT = 1.0
"""s of waiting after which a newcomer says for which replicas it waits."""


class ChangeGate(Rights, Protocol):
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
    lock: AbstractContextManager[Any] = field(default_factory=nullcontext)
    """Held while messages are joined that come from the network's threads; all else is for the caller to serialise."""
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
    _pieces_before: int = 0
    _came_at: float = -math.inf
    _pace: Pace = field(default_factory=Pace)

    def __post_init__(self) -> None:
        self.joining = Joining(self.graph.rid, self._trusts)
        self.lacking = Lacking(self.graph, self._peers, self.complaints, self._trusts)
        self.inquiry = Inquiry(self.graph, self._peers, self.joining, self.lacking, self.ask_ahead)
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
        else:
            self.inquiry.ask_again(rid)

    def _forget(self, rid: str) -> None:
        """Expect nothing more of a replica."""
        self.joining.gone(rid)
        self.inquiry.forget(rid)

    def receive_delta(self, sender: str, payload: bytes, physical: float) -> None:
        """A delta or a bundle of stream samples arrived at physical time `physical` (s)."""
        delta = self._read(sender, payload, decode_delta)
        if delta is not None:
            with self.lock:
                self._take_delta(sender, delta, physical)

    def _read(self, sender: str, payload: bytes, decode: Callable[[bytes], T]) -> T | None:
        """Decode a message before the lock is taken: the longest take as long as a hundred writes."""
        try:
            return decode(payload)
        except WireError as error:
            with self.lock:
                self.complaints.drop(sender, error)
            return None

    def _take_delta(self, sender: str, delta: Delta, physical: float) -> None:
        try:
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
        if self.claims.may_grow(sender, delta, joining=not self.joined):
            self.graph.join(delta, physical)
        else:
            self.complaints.say(sender, "too many gaps or newcomers: what %s sends is left to the repair")

    def _check_identity(self, sender: str, delta: Delta) -> None:
        """Raise `WireError` if it speaks in our name."""
        believed = self.gate is None if delta.live is None else self._may_be_believed(sender)
        self.impersonation.check(sender, delta, lambda: self.confirmed, believed=believed)

    def _may_be_believed(self, sender: str) -> bool:
        """Whether others believe what a replica says to have seen of ours: in answers, if rights are told."""
        return self._trusts(sender) or agent_of(sender) == agent_of(self.graph.rid)

    def _check_part(self, delta: Delta) -> None:
        """Raise `WireError` if it is about another part of the graph: some would take it, and others never would."""
        if self.part is not None and (other := [part for part in parts_in(delta) if part != self.part]):
            raise WireError(f"dots of part {other[0]!r} in a message of part {self.part!r}")

    def receive_digest(self, sender: str, payload: bytes, now: float, physical: float) -> None:
        """A digest arrived at monotonic time `now` and physical time `physical` (s)."""
        digest = self._read(sender, payload, decode_digest)
        if digest is not None:
            with self.lock:
                self._take_digest(sender, digest, now, physical)

    def _take_digest(self, sender: str, digest: Digest, now: float, physical: float) -> None:
        try:
            if digest.replica != sender:
                raise WireError(f"a digest of {digest.replica!r}")
            if sender == self.graph.rid:
                raise WireError("a digest in the name of this replica")
        except WireError as error:
            self.complaints.drop(sender, error)
            return
        known = self._peers.get(sender)
        before = known and (known.ahead, known.digest is not None and self.graph.rid in known.digest.ahead)
        peer = self.lacking.note(sender, digest, now)
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
        last = digest.seen.last(self.graph.rid)
        if last is not None and last > counter:
            if self._may_be_believed(sender):
                self.impersonation.notice(sender)
        elif self.impersonation.noticed:
            pass  # what peers say to have seen of ours may be what somebody else has told them
        elif last is not None or peer.rest_known:
            peer.acknowledged = max(peer.acknowledged, counter if last is None else last)

    def receive_reply(self, sender: str, number: int, payload: bytes, physical: float) -> None:
        """The answer to `Ask` with that number arrived at physical time `physical` (s); what comes late counts, too."""
        self.take_reply(sender, number, self.read_reply(payload), physical)

    def read_reply(self, payload: bytes) -> Piece | WireError:
        """Read an answer, or what is wrong with it, before the lock is taken: long ones take as long as many writes."""
        try:
            with collector_paused():
                return decode_piece(payload)
        except WireError as error:
            return error

    def take_reply(self, sender: str, number: int, reply: Piece | WireError, physical: float) -> None:
        """Take an answer that was read: see `receive_reply`; the caller holds the lock."""
        in_time, before = self.inquiry.is_awaited(number), state_of(self.graph.store)
        fetch = self.inquiry.answer_to(sender, number)
        if in_time and sender in self._peers:  # what was asked before its token went proves nothing
            self._peers[sender].withdrawn_at = None
        try:
            if isinstance(reply, WireError):
                raise reply
            piece = reply
            with collector_paused():
                delta = piece.as_delta()
                self._check_piece(sender, piece, delta)
                if fetch is None and sender in self._peers:
                    fetch = self.inquiry.begun_late(sender, number, piece)
                taken = fetch is not None and self.inquiry.take(fetch, piece)
                self._join_reply(sender, delta, physical)
        except WireError as error:
            self.complaints.drop(sender, error)
            self._peers.gave(sender, useful=False)
            if fetch is not None:
                self._break_off(fetch)
            return
        except BaseException:  # the piece may not be joined: the end of this answer must not account for it
            if fetch is not None:
                self.inquiry.give_up(fetch)
            raise
        counts = taken if in_time else not is_refusal(piece) and sender in self._peers
        weighed = self.joining.weighs_pieces
        share = brought(piece, self.graph.store, before, weighed=weighed) if counts else 0.0
        if share and self.joining.went_on(sender, piece.end, share):
            self.pieces += taken
            self.inquiry.went_on(sender)
        if in_time:
            self._peers.answered(sender)
        if fetch is not None and (taken or in_time):
            if piece.end is None or piece.end[0]:  # of ranges that somebody has seen anybody can make up any number
                fetch.brought += share
            self._go_on(fetch, piece, physical, taken=taken)

    def _go_on(self, fetch: Fetch, piece: Piece, physical: float, *, taken: bool) -> None:
        """Go on with an answer of which a piece came, or end it."""
        if is_refusal(piece):
            self.joining.declined(fetch.peer, piece.waits_for)
            self.inquiry.give_up(fetch)
        elif not taken:
            self._reject(fetch, "another piece than was asked for")
        else:
            fetch.note_joined(piece, self.graph.store)
            if fetch.begin is None:
                self._finish(fetch, physical)
            elif fetch.is_useless:
                self._reject(fetch, "too many changes in one answer that cannot be joined")
            elif fetch is not self.inquiry.fetch:
                self.inquiry.keep(fetch)

    def _reject(self, fetch: Fetch, why: str) -> None:
        """Drop an answer that makes no sense."""
        self.complaints.drop(fetch.peer, WireError(why))
        self._peers.gave(fetch.peer, useful=False)
        self.inquiry.give_up(fetch)

    def _check_piece(self, sender: str, piece: Piece, delta: Delta) -> None:
        """Raise `WireError` if it speaks in our name; leave out of it what nobody can have seen."""
        claimed = [*piece.examined, *(piece.whole or ())]
        self._check_identity(sender, Delta(delta.adds, delta.writes, context=claimed, live=delta.live))
        told = ("", piece.begin[1] + len(piece.whole or ()), "")
        if piece.end is not None and piece.begin[0] == piece.end[0] == "" and piece.end != told:
            raise WireError("a piece that tells other ranges than it says")
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
        nothing_broken_off = self.inquiry.end(fetch)
        if fetch.joined and nothing_broken_off and self.claims.tidy(fetch.peer, rest):
            self.complaints.say(fetch.peer, "after a reply of %s too many gaps were left: the lowest are given up")
            self.graph.look_again()
        changed = state_of(self.graph.store) != fetch.before
        self._peers.gave(fetch.peer, useful=changed)
        if self.joined:
            self.repairs += changed
            return
        self.joining.exhausted(fetch.peer)
        self.joined = fetch.joined and self._trusts(fetch.peer)
        self._join_if_nobody_has_more()

    def _join_if_nobody_has_more(self) -> None:
        if not self.joined and self.joining.nobody_has_more and not self.joining.others_possible:
            self.joined = True

    def request_done(self, number: int) -> None:
        """No more answers to that `Ask` will come."""
        if self.inquiry.fetch is not None and self.inquiry.is_awaited(number):
            self._break_off(self.inquiry.fetch)

    def _break_off(self, fetch: Fetch) -> None:
        """Expect no more of an answer, and perhaps of who gave it."""
        self.inquiry.give_up(fetch)
        self._peers.unanswered(fetch.peer)
        if fetch.peer not in self._peers:
            self._forget(fetch.peer)

    def nobody_there(self) -> None:
        """Note that there is nothing to wait for: the caller knows that the graph begins here, or wants this."""
        self.joined = True

    def answer(self, sender: str, payload: bytes) -> Piece | None:
        """A piece of the reply to a peer's request; None if the request is malformed."""
        request = self._read(sender, payload, decode_request)
        if request is None:
            return None
        with self.lock:
            return self._piece_for(request)

    def _piece_for(self, request: Request) -> Piece:
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

    def tick(self, now: float, physical: float, *, holds_back: bool = False) -> list[Output]:
        """Do the work that is due at monotonic time `now` and physical time `physical` (s), and return its outputs.

        Who `holds_back` writes says nothing meanwhile unless it must: see `speak`.
        """
        outputs: list[Output] = []
        self._pace.look(now)
        self.claims.look(now)
        if self.impersonation.is_new_id_due(now):
            return [TakeId()]
        self._forget_gone(now)
        if not holds_back or self._pace.is_overdue(now):
            outputs += self.speak(now, physical)
        if self._pace.renewal_due(now):
            outputs.append(Renew())
        self._note_time(now)
        question = self.inquiry.question(now, joined=self.joined)
        return outputs if question is None else [*outputs, question]

    def speak(self, now: float, physical: float) -> list[Output]:
        """Settle samples and tell what is here, if that is due.

        Whatever a digest tells, all ask for that do not get it at once. So nobody should tell what is still held back.
        """
        outputs: list[Output] = []
        if self._pace.settling_due(now) and (settled := self.make_durable()):
            outputs.append(PublishDelta(settled))
        if self._pace.digest_due(now):
            self._compare_clocks(now)
            outputs.append(PublishDigest(self.graph.rid, self.digest(physical)))
        return outputs

    def _note_time(self, now: float) -> None:
        """For how long something has been missing here."""
        if not self.joined:
            self.joining.since = min(self.joining.since, now)
            self._join_if_nobody_has_more()
            if self.pieces > self._pieces_before:
                self._pieces_before, self._came_at = self.pieces, now
            if now - max(self.joining.since, self._came_at) > LONG_WAIT and self.joining.others:
                self.complaints.say(self.graph.rid, "%s has not joined yet: %s", self.joining.why(now))
        lacked = any(not self._peers[rid].in_vain for rid in self.lacking.have_more(now))
        complete = self.joined and not self.is_asking and not lacked
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
        return self.inquiry.fetch is not None

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

    def _trusts(self, rid: str) -> bool:
        return self.gate is None or self.gate.trusts(rid)
