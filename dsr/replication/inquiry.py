"""The request under way: who is asked for what, how long the answer is waited for, and whose turn is next.

One piece of one answer is asked for at a time. An answer is paused if its next piece does not come in time, or after
its turn while others wait. It goes on with the same piece when it is the turn of who gives it.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from dsr.crdt.context import CausalContext
from dsr.crdt.pieces import START, Piece, seen_by
from dsr.graph.graph import Graph
from dsr.replication.fetching import Fetch, state_of
from dsr.replication.joining import Joining
from dsr.replication.lacking import Lacking
from dsr.replication.outputs import Ask
from dsr.replication.peers import LAST_PATIENCE, MAX_PEERS, SILENCE, Peers

REQUEST_TIMEOUT = 10.0
"""s after which an answer is of no use any more."""
JOIN_RETRY = 0.02
"""s after which a newcomer asks the same peer again, whose answer found no way yet."""
TURN = SILENCE
"""s after which another peer is asked, if there is one that may have something else: an answer may never end."""
MAX_PAUSED = 8
"""Answers that wait for their next turn, those first that went on in their last one; others begin at the beginning."""


class Inquiry:
    """Asks peers for what is missing here; all times are of the monotonic clock, in s.

    Args:
        graph: into which answers are joined.
        peers: who can be asked.
        joining: what a newcomer knows of them.
        lacking: tells which of them have something that is missing here.
        ask_ahead: asks for the next piece before the last one is joined; None to wait for that.
    """

    def __init__(
        self, graph: Graph, peers: Peers, joining: Joining, lacking: Lacking, ask_ahead: Callable[[Ask], None] | None
    ) -> None:
        self.fetch: Fetch | None = None
        """The answer that is asked for now."""
        self._graph, self._peers, self._joining, self._lacking = graph, peers, joining, lacking
        self._ask_ahead = ask_ahead
        self._paused: dict[str, Fetch] = {}
        self._turn_ends, self._turn_over = math.inf, False
        self._turn_brought = False
        """Whether the answer has gone on in this turn."""
        self._ready: set[str] = set()
        """Peers whose answers went on in their last turn."""
        self._broken_off: set[str] = set()
        """Peers whose answers were not given to the end: what they lack is a gap that somebody can fill."""
        self._requests = 0
        self._under_way: int | None = None
        """Number of the request whose answer is waited for."""
        self._asked_at, self._asked_ahead = 0.0, False

    # ---- questions

    def question(self, now: float, *, joined: bool) -> Ask | None:
        """The question that is due: for the next piece, of the same peer or of another one."""
        if not self._is_due(now, joined=joined):
            return None
        if self.fetch is None:
            peer = self._peer_to_ask(now, joined=joined)
            if peer is None:
                return None
            self._begin(peer, now, insists=joined or self._joining.insists)
        assert self.fetch is not None
        self._asked_at = now
        return self._request(self.fetch)

    def _is_due(self, now: float, *, joined: bool) -> bool:
        """Whether nothing is waited for; whose patience or turn is over is paused."""
        if self._asked_ahead:
            self._asked_at, self._asked_ahead = now, False
        if self.fetch is not None and now >= self._turn_ends and not self._turn_over:
            self._turn_over = self._others_wait(self.fetch.peer, now, joined=joined)
        if self.fetch is not None and self._under_way is not None:
            if now - self._asked_at < self._patience(self.fetch):
                return False
            self._peers.came_late(self.fetch.peer)
            self._turn_over = True
        if self.fetch is not None and self._turn_over:
            self._pause(self.fetch)
        return True

    def _patience(self, fetch: Fetch) -> float:
        """How long the piece that was asked for is waited for, s; the longest for one who has begun to answer."""
        peer = self._peers.get(fetch.peer) if fetch.begin == START else None
        return LAST_PATIENCE if peer is None else peer.patience

    def _others_wait(self, answering: str, now: float, *, joined: bool) -> bool:
        """Whether somebody else may have what is missing here."""
        if not joined:
            return any(rid != answering and self._joining.may_have_more(rid) for rid in self._peers)
        return any(rid != answering for rid in self._lacking.due(now))

    def _pause(self, fetch: Fetch) -> None:
        """Let others answer; this answer goes on, with the same piece, when it is the turn of who gives it."""
        self.give_up()
        if self._turn_brought:
            self._ready.add(fetch.peer)
        if fetch.begin == START:
            return
        if len(self._paused) >= MAX_PAUSED:
            least = min(self._paused, key=self._worth)
            if self._worth(least) < self._worth(fetch.peer):
                del self._paused[least]
        if len(self._paused) < MAX_PAUSED:
            self._paused[fetch.peer] = fetch

    def _worth(self, peer: str) -> tuple[bool, bool]:
        """Whose paused answer is kept: of a peer that is waited for, and whose answer goes on."""
        return peer not in self._joining.given_up, peer in self._ready

    def _peer_to_ask(self, now: float, *, joined: bool) -> str | None:
        if not joined:
            asked = {rid: peer.asked for rid, peer in self._peers.items() if now - peer.asked_at >= JOIN_RETRY}
            return self._joining.choose(asked, asked, now)
        leaving = [rid for rid, peer in self._peers.items() if peer.is_leaving]
        if leaving:
            return leaving[0]
        return self._least_asked(self._lacking.due(now))

    def _least_asked(self, rids: list[str]) -> str | None:
        """The peers in turn, so that one that does not answer is not asked for ever; last those that seem to leave."""
        peers = self._peers
        return min(rids, key=lambda rid: (peers[rid].withdrawn_at is not None, peers[rid].asked), default=None)

    def _begin(self, peer: str, now: float, *, insists: bool) -> None:
        """Begin the turn of a peer, with a new answer or one that goes on."""
        self._peers[peer].asked += 1
        self._peers[peer].asked_at = now
        paused = self._paused.pop(peer, None)
        self.fetch = paused if paused is not None and not self._lacking.everything else self._new(peer, insists=insists)
        self._turn_ends, self._turn_over = now + TURN, False
        self._turn_brought = False
        self._ready.discard(peer)

    def _new(self, peer: str, *, insists: bool) -> Fetch:
        store = self._graph.store
        fetch = Fetch(peer, CausalContext(() if self._lacking.everything else seen_by(store)), insists=insists)
        fetch.before = state_of(store)
        return fetch

    def _request(self, fetch: Fetch) -> Ask:
        self._requests += 1
        self._under_way = self._requests
        return Ask(fetch.peer, fetch.request(self._graph.rid), self._requests)

    # ---- answers

    def answer_to(self, number: int) -> Fetch | None:
        """The answer to the request with that number, if that is the one that is waited for."""
        return self.fetch if number == self._under_way else None

    def take(self, piece: Piece) -> bool:
        """Whether it is the piece that was asked for; then the next one is asked for, if there is any."""
        fetch, self._under_way = self.fetch, None
        if fetch is None or not fetch.take(piece):
            return False
        if fetch.begin is not None and self._ask_ahead is not None and not self._turn_over:
            self._asked_ahead = True
            self._ask_ahead(self._request(fetch))
        return True

    def went_on(self, peer: str, *, in_time: bool) -> None:
        """Note that the answer of a peer has gone on, though perhaps after its turn."""
        if in_time:
            self._turn_brought = True
        else:
            self._ready.add(peer)

    def keeps_waiting(self, peer: str) -> bool:
        """Whether a peer gave what it was asked for last, and is not asked now: it is others' turn."""
        return peer in self._ready

    def ask_again(self, peer: str) -> None:
        """Ask for the same piece again if a peer was asked last: who is gone does not answer that."""
        if self.fetch is not None and self.fetch.peer == peer:
            self._under_way = None

    def end(self, fetch: Fetch) -> bool:
        """Note that all pieces of an answer have come, and tell whether no other answer was broken off."""
        self._broken_off.discard(fetch.peer)
        self.fetch = self._under_way = None
        self._lacking.everything = False
        return not self._broken_off

    def give_up(self) -> None:
        """Ask for no further piece."""
        fetch = self.fetch
        if fetch is not None and fetch.begin != START and len(self._broken_off) < MAX_PEERS:
            self._broken_off.add(fetch.peer)
        if fetch is not None and self._turn_brought and fetch.peer in self._peers:
            self._ready.add(fetch.peer)
        self.fetch = self._under_way = None

    def forget(self, peer: str) -> None:
        """Expect nothing more of a peer."""
        self._paused.pop(peer, None)
        self._ready.discard(peer)
        if self.fetch is not None and self.fetch.peer == peer:
            self.give_up()
