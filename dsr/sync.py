"""How replicas stay equal: join, digest and repair, as a protocol without I/O.

Received messages and the time go in; what is to be sent comes out as `Output`s. Rules:

1. Deltas are joined whenever they arrive; nothing relies on their order or on their arrival.
2. A newcomer asks one peer for everything, if it can the oldest. It has joined when a reply came, or when nobody
   is there.
3. Once a second each replica makes its stream samples durable and publishes a digest of what it has seen, which costs
   the same whatever its history (`dsr.crdt.summary`); digests are more frequent for a moment when a peer appears, or
   after this process was stopped (`dsr.pace`).
4. A replica that still lacks something `GRACE` after a digest told so, or may lack it, asks that peer for it with all
   that it has seen (one request at a time until patience ends, one for each digest). It only ever pulls, so that nobody
   has to remember what others know. Whose answers change nothing is asked ever more rarely (`Peer.pause`).
5. Equal contexts with different fingerprints cannot be; then the replica asks for everything and says so.
6. A replica whose clock most of its peers see in their future must not write (`drifting`).
7. What is claimed to have been seen is bounded (`dsr.claims`). A replica in whose name somebody else speaks refuses
   that and takes another id (`TakeId`): peers that believed it would take what the replica adds for seen.

A peer that sends nonsense is counted in `dropped` and logged once; nothing it sends can raise here.
"""

from __future__ import annotations

import logging
import math
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

from dsr.claims import MAX_EARLY, Claims, goes_beyond, without_word_of
from dsr.collector import collector_paused
from dsr.complaints import Complaints
from dsr.crdt.context import CausalContext, Dot
from dsr.crdt.delta import Delta
from dsr.crdt.store import Store
from dsr.errors import WireError
from dsr.graph import Graph
from dsr.outputs import Ask, Output, PublishDelta, PublishDigest, Renew, TakeId
from dsr.pace import Pace
from dsr.peers import SILENCE, Peer, Peers
from dsr.wire import Digest, Request, decode_delta, decode_digest, decode_request, encode_digest, encode_request

GRACE = 0.15
"""s that a delta on its way may be later than the digest that mentions it."""
REQUEST_TIMEOUT = 10.0
"""s after which an answer is of no use any more."""
MAX_DRIFT = 0.5
"""s that a peer's clock may be ahead of ours."""
ELDER_PATIENCE = 1.0
"""s that a newcomer waits for an answer of those before it, the oldest first, before it asks anybody."""
JOIN_RETRY = 0.02
"""s after which a newcomer asks the same peer again, whose answer found no way yet."""
NEW_ID_PAUSE = 10.0
"""s between two new ids of a replica: each stays in all contexts, and whoever speaks in its name may go on doing so."""


class Gate(Protocol):
    """Decides what of an arriving message may be joined; see dsr/security/gate.py."""

    def delta(self, sender: str, delta: Delta, store: Store) -> Delta:
        """The allowed part of a delta."""

    def reply(self, sender: str, delta: Delta, store: Store) -> Delta:
        """The allowed part of a synchronisation reply."""

    def trusts(self, rid: str) -> bool:
        """Whether that replica may speak for others."""


@dataclass
class Synchroniser:
    """Keeps one graph in step with its peers."""

    graph: Graph
    gate: Gate | None = None
    """Checks what arrives; None if everybody is believed."""
    joined: bool = False
    complaints: Complaints = field(default_factory=Complaints)
    repairs: int = 0
    """Replies that brought something that was missing."""
    drifting: bool = False
    """Whether most peers heard of lately see our clock in their future: then nothing must be written."""
    elders: Sequence[str] = ()
    """Replicas that are known to have been there before us, oldest first; set it before joining."""
    new_ids: int = 0
    """How often this replica took another id."""
    claims: Claims = field(init=False)
    _peers: Peers = field(default_factory=Peers)
    forged: dict[Dot, None] = field(default_factory=dict)
    """Creation dots under which somebody else added something in our name."""
    _impersonated: bool = False
    _new_id_at: float = -math.inf
    _asked: str | None = None
    _asked_at: float = 0.0
    _pace: Pace = field(default_factory=Pace)
    _wants_everything: bool = False
    _joining_since: float | None = None

    def __post_init__(self) -> None:
        self.claims = Claims(self.graph)

    # ---- events

    def peer_appeared(self, rid: str, now: float) -> None:
        """A replica became reachable; it gets a digest at once, so that a healed partition is repaired soon."""
        if rid == self.graph.rid:
            return
        if self._peers.appeared(rid, now):
            self._pace.hurry(now)
        else:
            self.complaints.say("others", "more replicas announce themselves than are listened to: %s are passed over")

    def peer_gone(self, rid: str, now: float) -> None:
        """The token of a replica was withdrawn: it is asked whether it is still there."""
        self._peers.withdrawn(rid, now)
        if self._asked == rid:
            self._asked = None

    def receive_delta(self, sender: str, payload: bytes) -> None:
        """A delta or a bundle of stream samples arrived."""
        try:
            delta = decode_delta(payload)
            if delta.live is not None:
                raise WireError("a synchronisation reply that nobody asked for")
            self._check_identity(sender, delta)
            store = self.graph.store
            delta = self.gate.delta(sender, delta, store) if self.gate else self.claims.own_part(sender, delta)
        except WireError as error:
            self.complaints.drop(sender, error)
            return
        if self.claims.may_grow(sender, delta):
            self.graph.join(delta)
        else:
            self.complaints.say(sender, "too many gaps or newcomers: what %s sends is left to the repair")

    def _check_identity(self, sender: str, delta: Delta) -> None:
        """Raise `WireError` if it speaks in our name; and if peers may have believed that, take another id."""
        rid = self.graph.rid
        if sender != rid and delta.live is None and not delta.removed:
            return
        believed = sender == rid or delta.live is not None
        known = self.confirmed if sender == rid else self.graph.counter  # others may have had it before what is ours
        beyond = goes_beyond(rid, known, delta, removals_only=not believed)
        if beyond and (believed or self.gate is None):
            self._note_impersonation(sender)
            added = [add.dot for add in delta.adds if add.dot[0] == rid and add.dot[1] > known]
            self.forged.update(dict.fromkeys(added[: MAX_EARLY - len(self.forged)]))
        if beyond or sender == rid:
            raise WireError(f"it speaks in the name of {rid}, this replica")

    def _note_impersonation(self, sender: str) -> None:
        self._impersonated = True
        self.complaints.say(
            self.graph.rid, "somebody speaks in the name of %s (told by %s): taking another id", sender,
            level=logging.ERROR,
        )  # fmt: skip

    def receive_digest(self, sender: str, payload: bytes, now: float, physical: float) -> None:
        """A digest arrived at monotonic time `now` and physical time `physical` (s)."""
        try:
            digest = decode_digest(payload)
            if digest.replica != sender:
                raise WireError(f"a digest of {digest.replica!r}")
        except WireError as error:
            self.complaints.drop(sender, error)
            return
        if digest.replica == self.graph.rid:
            self.complaints.drop(sender, WireError("a digest in the name of this replica"))
            return
        peer = self._peers.heard(sender, digest, now)
        if peer is None:
            return
        self._note_acknowledged(sender, peer, digest)
        ahead = digest.now - physical > MAX_DRIFT
        if ahead:
            self.complaints.say(sender, "the clock of %s is %.1f s ahead of ours", digest.now - physical)
        peer.ahead = ahead
        self.drifting = self._is_drifting(now)

    def _note_acknowledged(self, sender: str, peer: Peer, digest: Digest) -> None:
        """Take note of how much of ours a peer has seen, and if that is more than there is."""
        counter = self.graph.counter
        listed, peer.rest_known = self.graph.store.context.compare(digest.seen)
        if listed and peer.rest_known and not self._differs(digest):
            peer.covered = digest  # what changes here from now on does not matter
        last = digest.seen.last(self.graph.rid)
        if last is not None and last > counter:
            self._note_impersonation(sender)
        elif self._impersonated:
            pass  # what peers say to have seen of ours may be what somebody else has told them
        elif last is not None or peer.rest_known:
            peer.acknowledged = max(peer.acknowledged, counter if last is None else last)

    def receive_reply(self, sender: str, payload: bytes) -> None:
        """The answer to `Ask` arrived."""
        if sender in self._peers:
            self._peers[sender].withdrawn_at = None
        self.request_done(sender)
        self._pace.answered()
        before = self._state
        try:
            with collector_paused():
                delta = decode_delta(payload)
                if delta.live is None:
                    raise WireError("a synchronisation reply without the live dots")
                self._join_reply(sender, delta)
        except WireError as error:
            self.complaints.drop(sender, error)
            self._note_answer(sender, useful=False)
            return
        changed = self._state != before
        self._note_answer(sender, useful=changed)
        self.repairs += self.joined and changed
        self.joined = True
        self._wants_everything = False

    @property
    def _state(self) -> tuple[int, int]:
        return self.graph.store.context.summary().hash, self.graph.store.fingerprint

    def _join_reply(self, sender: str, reply: Delta) -> None:
        self._check_identity(sender, reply)
        if self._impersonated:  # who was told to have seen what is ours takes it for removed
            reply = without_word_of(self.graph.rid, reply)
        delta = self.claims.reply_part(sender, reply, joining=not self.joined)
        self.graph.join(self.gate.reply(sender, delta, self.graph.store) if self.gate else delta)
        if self.claims.tidy(sender, delta):
            self.complaints.say(sender, "after a reply of %s too many gaps were left: the lowest are given up")

    def _note_answer(self, sender: str, *, useful: bool) -> None:
        peer = self._peers.get(sender)
        if peer is not None:
            peer.in_vain = 0 if useful else peer.in_vain + 1

    def request_done(self, peer: str) -> None:
        """No more answers to `Ask` will come."""
        self._peers.unanswered(peer)
        if self._asked == peer:
            self._asked = None

    def nobody_there(self) -> None:
        """The caller knows that this is the first replica: nothing to ask for."""
        self.joined = self.joined or not self.heard

    def answer(self, sender: str, payload: bytes) -> Delta | None:
        """The reply to a peer's request, empty if it lacks nothing; None if the request is malformed."""
        try:
            seen = decode_request(payload).context
        except WireError as error:
            self.complaints.drop(sender, error)
            return None
        if seen.covers(self.graph.store.context):
            return Delta(live=frozenset())  # it accounts for nothing, so that nothing is removed
        with collector_paused():
            return self.graph.store.missing_for(seen)

    def tick(self, now: float, physical: float) -> list[Output]:
        """What is due at monotonic time `now` and physical time `physical` (s)."""
        outputs: list[Output] = []
        self._pace.look(now)
        self.claims.look(now)
        if self._impersonated and now - self._new_id_at >= NEW_ID_PAUSE:
            self._impersonated, self._new_id_at = False, now
            return [TakeId()]
        self._forget_gone(now)
        if self._pace.settling_due(now):
            settled = self.settle()
            if settled:
                outputs.append(PublishDelta(settled))
        if self._pace.digest_due(now):
            self.drifting = self._is_drifting(now)
            outputs.append(PublishDigest(self.digest(physical)))
        if self._pace.renewal_due(now):
            outputs.append(Renew())
        peer = self._peer_to_ask(now)
        if peer is not None:
            self._asked, self._asked_at = peer, now
            self._peers[peer].asked += 1
            self._peers[peer].asked_at = now
            outputs.append(Ask(peer, self._request()))
        return outputs

    def settle(self) -> Delta:
        """Stream samples made durable: our own, and those of writers that are gone if we may speak for others."""
        return self.graph.settle() if self._trusts(self.graph.rid) else self.graph.settle(sys.maxsize)

    # ---- state

    @property
    def dropped(self) -> Counter[str]:
        """Malformed messages, by sender."""
        return self.complaints.dropped

    @property
    def peers(self) -> list[str]:
        """Replica ids of the reachable peers."""
        return sorted(self._peers)

    @property
    def passed_over(self) -> int:
        """Claims beyond what is taken from one sender, and replicas beyond those listened to."""
        return self.claims.passed_over + self._peers.refused

    @property
    def heard(self) -> list[str]:
        """Replica ids of the peers that have spoken: nobody else need be waited for."""
        return sorted(rid for rid, peer in self._peers.items() if peer.digest)

    @property
    def delivered(self) -> bool:
        """Whether every peer that is heard told that it has seen all that was written here."""
        rid, store = self.graph.rid, self.graph.store
        samples = [entry.registers[name] for dot, name in store.unsettled if (entry := store.find(dot))]
        settled = all(sample.writer != rid for sample in samples)
        heard = [peer for peer in self._peers.values() if peer.digest] or list(self._peers.values())
        return settled and all(peer.acknowledged >= self.graph.counter for peer in heard)

    @property
    def confirmed(self) -> int:
        """The counter up to which every peer that is heard has told to have seen what was written here."""
        return min((peer.acknowledged for peer in self._peers.values() if peer.digest), default=0)

    def id_taken(self) -> None:
        """The replica has another id now, under which nobody has seen anything."""
        self.new_ids += 1
        self.forged.clear()
        for peer in self._peers.values():
            peer.acknowledged, peer.covered = 0, None

    def _is_drifting(self, now: float) -> bool:
        recent = [p.digest for p in self._peers.values() if p.digest and now - p.heard_at < SILENCE]
        return 2 * sum(self.graph.rid in digest.ahead for digest in recent) > len(recent)

    def _forget_gone(self, now: float) -> None:
        """Drop peers that are gone, for some of whom no word of their going may ever come."""
        for rid in self._peers.forget_gone(now):
            if self._asked == rid:
                self._asked = None

    def digest(self, physical: float) -> bytes:
        """What is told to the peers at physical time `physical` (s)."""
        ahead = tuple(sorted(rid for rid, peer in self._peers.items() if peer.ahead))
        rid, store = self.graph.rid, self.graph.store
        return encode_digest(Digest(rid, physical, store.context.summary(rid), store.fingerprint, ahead))

    def _request(self) -> bytes:
        seen = CausalContext() if self._wants_everything else self.graph.store.context
        return encode_request(Request(self.graph.rid, seen))

    def _peer_to_ask(self, now: float) -> str | None:
        if self._asked is not None:
            if now - self._asked_at < self._pace.patience:
                return None
            self._pace.unanswered()
            self._asked = None
        if not self.joined:
            return self._peer_to_join(now)
        leaving = [rid for rid, peer in self._peers.items() if peer.is_leaving]
        if leaving:
            return leaving[0]
        return self._least_asked([
            rid
            for rid, peer in self._peers.items()
            if peer.digest
            and peer.digest is not peer.covered
            and peer.asked_at < peer.heard_at
            and now - peer.asked_at >= peer.pause
            and GRACE <= now - peer.heard_at < SILENCE
            and self._is_behind(rid, peer, peer.digest)
        ])

    def _peer_to_join(self, now: float) -> str | None:
        """The elders first, for a while: a younger one may be a newcomer itself. Then whoever answers."""
        if self._joining_since is None:
            self._joining_since = now
        patient = now - self._joining_since < ELDER_PATIENCE
        if patient and self.elders and self.elders[0] not in self._peers:
            return None
        elders = [rid for rid in self.elders if rid in self._peers] if patient else []
        return self._least_asked([
            rid for rid in elders or self._peers if now - self._peers[rid].asked_at >= JOIN_RETRY
        ])

    def _least_asked(self, rids: list[str]) -> str | None:
        """The peers in turn, so that one that does not answer is not asked for ever; last those that seem to leave."""
        peers = self._peers
        return min(rids, key=lambda rid: (peers[rid].withdrawn_at is not None, peers[rid].asked), default=None)

    def _is_behind(self, rid: str, peer: Peer, digest: Digest) -> bool:
        listed, rest = self.graph.store.context.compare(digest.seen)
        if not listed or not (rest or peer.rest_known):
            return True
        if self._differs(digest) and self._trusts(rid):
            self.complaints.say(rid, "same history as %s but another state: asking for everything", level=logging.ERROR)
            self._wants_everything = True
            return True
        peer.covered, peer.in_vain = digest, 0
        return False

    def _differs(self, digest: Digest) -> bool:
        """Whether somebody holds something else and has seen the same: that cannot be."""
        store = self.graph.store
        return digest.fingerprint != store.fingerprint and digest.seen.hash == store.context.summary().hash

    def _trusts(self, rid: str) -> bool:
        return self.gate is None or self.gate.trusts(rid)
