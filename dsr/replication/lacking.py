"""What is lacking here: which peers have seen or hold something else, by their digests."""

from __future__ import annotations

import math
from collections.abc import Callable

from dsr.graph.graph import Graph
from dsr.replication.complaints import Complaints
from dsr.replication.pace import DIGEST_PERIOD
from dsr.replication.peers import SILENCE, Peer, Peers
from dsr.replication.wire import Digest

GRACE = 0.15
"""s that a delta on its way may be later than the digest that mentions it."""


class Lacking:
    """Compares the digests of peers with what is here; all times are of the monotonic clock, in s.

    Args:
        graph: what is here.
        peers: whose digests.
        complaints: where a lost removal is told.
        trusts: tells who may speak for others.
    """

    def __init__(self, graph: Graph, peers: Peers, complaints: Complaints, trusts: Callable[[str], bool]) -> None:
        self.everything = False
        """Whether a removal has come somewhere without its dot: then only what all hold tells who is right."""
        self._graph, self._peers, self._complaints, self._trusts = graph, peers, complaints, trusts
        self._looked_at = -math.inf
        """When a difference had edges without ends looked at last."""

    def note(self, rid: str, digest: Digest, now: float) -> Peer | None:
        """Compare the digest of a replica that has just come; returns what is known of it, None if none is listened to.

        If nothing is unknown here, what changes from now on does not matter. If what the digest before told is still
        missing, another one gives it no more time to come.
        """
        before = self._peers.get(rid)
        lacked = before is not None and self._has_more(rid, before, now)
        peer = self._peers.heard(rid, digest, now)
        if peer is None:
            return None
        if not lacked:
            peer.told_at = now
        listed, peer.rest_known = self._graph.store.context.compare(digest.seen)
        if listed and peer.rest_known and not self._differs(digest, now):
            peer.covered = digest
        return peer

    def have_more(self, now: float) -> list[str]:
        """Peers of which a digest told of something that is not here, though it had the time to come."""
        return [
            rid
            for rid, peer in self._peers.items()
            if now - peer.told_at >= GRACE and now - peer.heard_at < SILENCE and self._has_more(rid, peer, now)
        ]

    def due(self, now: float) -> list[str]:
        """Those of them that were not asked since their last digest, nor too soon after an answer in vain."""
        return [rid for rid in self.have_more(now) if self._peers[rid].is_due(now)]

    def _has_more(self, rid: str, peer: Peer, now: float) -> bool:
        digest = peer.digest
        return digest is not None and digest is not peer.covered and self._is_behind(rid, peer, digest, now)

    def _is_behind(self, rid: str, peer: Peer, digest: Digest, now: float) -> bool:
        listed, rest = self._graph.store.context.compare(digest.seen)
        if not listed or not (rest or peer.rest_known):
            return True
        if self._differs(digest, now) and self._trusts(rid):
            self._complaints.say(rid, "a removal has come to %s or to us without its dot: asking for everything")
            self.everything = True
            return True
        peer.covered, peer.in_vain = digest, 0
        return False

    def _differs(self, digest: Digest, now: float) -> bool:
        """Whether somebody holds something else and has seen the same: one of us cannot account for a removal.

        Edges that turned out to be dead may still be here: they are looked at first, but for no number of digests more
        often than by themselves.
        """
        store = self._graph.store
        if digest.fingerprint == store.fingerprint or digest.seen.hash != store.context.hash:
            return False
        if now - self._looked_at >= DIGEST_PERIOD:
            self._graph.look_between()
            self._looked_at = now
        return digest.fingerprint != store.fingerprint
