"""How replicas stay equal: join, digest and repair, as a protocol without I/O.

Received messages and the time go in; what is to be sent comes out as `Output`s. Rules:

1. Deltas are joined whenever they arrive; nothing relies on their order or on their arrival.
2. A newcomer asks one peer for everything, if it can the oldest. It has joined when a reply came, or when nobody
   is there.
3. Once a second each replica makes its stream samples durable and publishes a digest of what it has seen; digests
   are more frequent for a moment when a peer appears, or after this process was stopped (`dsr.pace`).
4. A replica that still lacks something `GRACE` after a digest told so asks that peer for it (one request
   at a time until patience ends, one for each digest). It only ever pulls, so that nobody has to remember what
   others know.
5. Equal contexts with different fingerprints cannot be; then the replica asks for everything and says so.
6. A replica whose clock most of its peers see in their future must not write (`drifting`).

A peer that sends nonsense is counted in `dropped` and logged once; nothing it sends can raise here.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import math
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from dsr.crdt.context import CausalContext
from dsr.crdt.delta import Delta
from dsr.crdt.store import Store
from dsr.errors import WireError
from dsr.graph import Graph
from dsr.pace import Pace
from dsr.wire import Digest, decode_delta, decode_digest, decode_kept, encode_digest

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


class PublishDigest(NamedTuple):
    """Tell all peers what was seen here."""

    payload: bytes


class PublishDelta(NamedTuple):
    """Send a delta to all peers."""

    delta: Delta


class Ask(NamedTuple):
    """Request from one peer what is missing; hand in the answer with `receive_reply`, then `request_done`."""

    peer: str
    payload: bytes


class Renew(NamedTuple):
    """Let the network know again what is listened to here: it has changed, and may have forgotten."""


Output = PublishDigest | PublishDelta | Ask | Renew


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
    drifting: bool = False
    """Whether most peers heard of lately see our clock in their future: then nothing must be written."""
    elders: Sequence[str] = ()
    """Replicas that are known to have been there before us, oldest first; set it before joining."""
    _peers: dict[str, _Peer] = field(default_factory=dict)
    _asked: str | None = None
    _asked_at: float = 0.0
    _pace: Pace = field(default_factory=Pace)
    _wants_everything: bool = False
    _joining_since: float | None = None
    _complaints: set[tuple[str, str]] = field(default_factory=set)

    # ---- events

    def peer_appeared(self, rid: str, now: float) -> None:
        """A replica became reachable; it gets a digest at once, so that a healed partition is repaired soon."""
        if rid != self.graph.rid:
            self._peers.setdefault(rid, _Peer())
            self._pace.hurry(now)

    def peer_gone(self, rid: str) -> None:
        """A replica became unreachable."""
        self._peers.pop(rid, None)
        if self._asked == rid:
            self._asked = None

    def receive_delta(self, sender: str, payload: bytes) -> None:
        """A delta or a bundle of stream samples arrived."""
        try:
            delta = decode_delta(payload)
            if delta.live is not None:
                raise WireError("a synchronisation reply that nobody asked for")
        except WireError as error:
            self._drop(sender, error)
            return
        self.graph.join(self.gate.delta(sender, delta, self.graph.store) if self.gate else delta)

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
        peer.digest, peer.heard_at, peer.ahead = digest, now, ahead
        self.drifting = self._is_drifting(now)

    def receive_reply(self, sender: str, payload: bytes) -> None:
        """The answer to `Ask` arrived."""
        self.request_done(sender)
        self._pace.answered()
        try:
            with collector_paused():
                delta = decode_kept(payload)
                if delta.live is None:
                    raise WireError("a synchronisation reply without the live dots")
                self.graph.join(self.gate.reply(sender, delta, self.graph.store) if self.gate else delta)
        except WireError as error:
            self._drop(sender, error)
            return
        self.repairs += self.joined
        self.joined = True
        self._wants_everything = False

    def request_done(self, peer: str) -> None:
        """No more answers to `Ask` will come."""
        if self._asked == peer:
            self._asked = None

    def nobody_there(self) -> None:
        """The caller knows that this is the first replica: nothing to ask for."""
        self.joined = self.joined or not self._peers

    def answer(self, sender: str, payload: bytes) -> Delta | None:
        """The reply to a peer's request; None if the request is malformed."""
        try:
            seen = decode_digest(payload).context
        except WireError as error:
            self._drop(sender, error)
            return None
        with collector_paused():
            return self.graph.store.missing_for(seen)

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
            self.drifting = self._is_drifting(now)
            outputs.append(PublishDigest(self._digest(physical)))
        if self._pace.renewal_due(now):
            outputs.append(Renew())
        peer = self._peer_to_ask(now)
        if peer is not None:
            self._asked, self._asked_at = peer, now
            self._peers[peer].asked += 1
            self._peers[peer].asked_at = now
            outputs.append(Ask(peer, self._request(physical)))
        return outputs

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

    def _is_drifting(self, now: float) -> bool:
        recent = [p.digest for p in self._peers.values() if p.digest and now - p.heard_at < SILENCE]
        return 2 * sum(self.graph.rid in digest.ahead for digest in recent) > len(recent)

    def _forget_silent(self, now: float) -> None:
        """Drop peers that fell silent, for whom no word of their going may ever come."""
        for rid, peer in list(self._peers.items()):
            if peer.digest and now - peer.heard_at > FORGET:
                self.peer_gone(rid)

    def _digest(self, physical: float, seen: CausalContext | None = None) -> bytes:
        ahead = tuple(sorted(rid for rid, peer in self._peers.items() if peer.ahead))
        store = self.graph.store
        return encode_digest(Digest(self.graph.rid, physical, seen or store.context, store.fingerprint, ahead))

    def _request(self, physical: float) -> bytes:
        return self._digest(physical, CausalContext() if self._wants_everything else None)

    def _peer_to_ask(self, now: float) -> str | None:
        if self._asked is not None:
            if now - self._asked_at < self._pace.patience:
                return None
            self._pace.unanswered()
            self._asked = None
        if not self.joined:
            return self._peer_to_join(now)
        return self._least_asked([
            rid
            for rid, peer in self._peers.items()
            if peer.digest
            and peer.digest is not peer.covered
            and peer.asked_at < peer.heard_at
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


@contextlib.contextmanager
def collector_paused() -> Iterator[None]:
    """Do not look for reference cycles: among many new objects that all stay, it takes as long as the work itself."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()
