"""The request under way: who is asked for what, how long the answer is waited for, and whose turn is next.

One piece of one answer is asked for at a time. An answer is paused if its next piece does not come in time, or after
its turn while others wait. It goes on with the same piece when it is the turn of who gives it.

To be paused is no end of a question: another peer is asked as well. A piece that comes late takes its answer further
all the same. Whose piece has come is asked for the next one before the first of anybody else is waited for any longer.
But each other turn is of who has waited longest, so that neither late pieces nor ever new ids keep anybody waiting.
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
"""Answers that wait for their next turn, those first that have brought most; others begin at the beginning."""

FADES = 8.0
"""By what an answer counts less for each turn without a piece: three silent turns outweigh hundreds of pieces, and who
is slow keeps its place for one."""


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
        self._turn_taken = False
        """Whether any piece of the answer has come in this turn."""
        self._ready: set[str] = set()
        """Peers whose answers went on in their last turn."""
        self._broken_off: set[str] = set()
        """Peers whose answers were not given to the end: what they lack is a gap that somebody can fill."""
        self._unanswered: dict[str, int] = {}
        """By peer, the number of the first request to begin an answer since one came."""
        self._came_late: str | None = None
        """Whose answer has gone on since its turn."""
        self._out_of_turn = False
        """Whether the one that is asked now did not wait for its turn."""
        self._asked_last = ""
        """Whose turn it is, or was until now."""
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
            if (before := self._peers.get(self._asked_last)) is not None:
                before.queued_at = now
            late, self._asked_last = self._who_goes_on(), ""
            self._out_of_turn = late is not None
            peer = late or self._peer_to_ask(now, joined=joined)
            if peer is None:
                return None
            self._came_late = None
            self._begin(peer, now, insists=joined or self._joining.insists)
        assert self.fetch is not None
        self._asked_at = now
        return self._request(self.fetch)

    def _is_due(self, now: float, *, joined: bool) -> bool:
        """Whether nothing is waited for; whose patience or turn is over is paused."""
        if self._asked_ahead:
            self._asked_at, self._asked_ahead = now, False
        fetch = self.fetch
        if fetch is None:
            return True
        if now >= self._turn_ends and not self._turn_over:
            self._turn_over = self._others_wait(fetch.peer, now, joined=joined)
        if self._under_way is not None:
            if now - self._asked_at >= self._patience(fetch):
                self._peers.came_late(fetch.peer)
            elif fetch.begin != START or self._who_goes_on() is None:
                return False
            self._turn_over = True
        if self._turn_over:
            self._pause(fetch)
        return True

    def _patience(self, fetch: Fetch) -> float:
        """How long the piece that was asked for is waited for, s; the longest for one who has begun to answer."""
        peer = self._peers.get(fetch.peer) if fetch.begin == START else None
        return LAST_PATIENCE if peer is None else peer.patience

    def _others_wait(self, answering: str, now: float, *, joined: bool) -> bool:
        """Whether somebody else may have what is missing here."""
        others = self._lacking.due(now) if joined else filter(self._joining.may_have_more, self._peers)
        return any(rid != answering for rid in others)

    def _pause(self, fetch: Fetch) -> None:
        """Let others answer; this answer goes on, with the same piece, when it is the turn of who gives it."""
        self.give_up(fetch)
        if self._turn_brought:
            self._ready.add(fetch.peer)
        if fetch.begin != START:
            if not self._turn_taken:
                fetch.brought /= FADES
            self.keep(fetch)

    def keep(self, fetch: Fetch) -> None:
        """Keep an answer for its next turn, if there is room."""
        self._paused[fetch.peer] = fetch
        if len(self._paused) > MAX_PAUSED:
            del self._paused[min(reversed(self._paused), key=self._worth)]

    def _worth(self, peer: str) -> tuple[bool, float]:
        """Whose paused answer is kept: of a peer that is waited for, and that has brought most."""
        return peer not in self._joining.given_up, self._paused[peer].brought

    def _who_goes_on(self) -> str | None:
        """Whose answer went on after its turn, and is gone on with at once; each other turn is of who waits longest."""
        peer = self._came_late
        is_known = peer in self._peers and peer in self._paused and peer not in self._joining.given_up
        return peer if is_known and not self._out_of_turn else None

    def _peer_to_ask(self, now: float, *, joined: bool) -> str | None:
        """Who has waited longest for its turn: nobody that comes later, under whatever ids, is asked before."""
        if not joined:
            queued = {rid: peer.queued_at for rid, peer in self._peers.items() if now - peer.asked_at >= JOIN_RETRY}
            return self._joining.choose(queued, now)
        leaving = [rid for rid, peer in self._peers.items() if peer.is_leaving]
        return min([*leaving, *self._lacking.due(now)], key=lambda rid: self._peers[rid].queued_at, default=None)

    def _begin(self, peer: str, now: float, *, insists: bool) -> None:
        """Begin the turn of a peer, with a new answer or one that goes on."""
        self._asked_last = peer
        self._peers[peer].asked += 1
        self._peers[peer].asked_at = now
        paused = self._paused.pop(peer, None)
        if paused is None or (self._lacking.everything and not paused.asks_for_all):
            self.fetch = self._new(peer, insists=insists)
        else:
            self.fetch, paused.asks_for_all = paused, self._lacking.everything
            if not paused.asks_for_all:
                paused.seen = CausalContext(seen_by(self._graph.store))
        self._turn_ends, self._turn_over = now + TURN, False
        self._turn_brought = self._turn_taken = False
        self._ready.discard(peer)

    def _new(self, peer: str, *, insists: bool) -> Fetch:
        store = self._graph.store
        fetch = Fetch(peer, CausalContext(() if self._lacking.everything else seen_by(store)), insists=insists)
        fetch.before, fetch.asks_for_all = state_of(store), self._lacking.everything
        return fetch

    def _request(self, fetch: Fetch) -> Ask:
        self._requests += 1
        self._under_way = self._requests
        if fetch.begin == START:
            if self._lacking.everything:  # an answer to an earlier question leaves out what was seen here
                self._unanswered.pop(fetch.peer, None)
            fetch.first = self._unanswered.setdefault(fetch.peer, self._requests)
        return Ask(fetch.peer, fetch.request(self._graph.rid), self._requests)

    # ---- answers

    def is_awaited(self, number: int) -> bool:
        """Whether the request with that number is the one whose answer is waited for."""
        return self.fetch is not None and number == self._under_way

    def answer_to(self, peer: str, number: int) -> Fetch | None:
        """The answer of a peer of which a reply to that request may be the next piece, paused or not."""
        if self.fetch is not None and self.fetch.peer == peer:
            return self.fetch if number >= self.fetch.first else None
        fetch = self._paused.get(peer)
        return fetch if fetch is not None and number >= fetch.first else None

    def take(self, fetch: Fetch, piece: Piece) -> bool:
        """Whether it is the piece that is to come next; if it is that answer's turn, the next one is asked for."""
        if not fetch.take(piece):
            return False
        if piece.begin == START:
            self._unanswered.pop(fetch.peer, None)
        if fetch is self.fetch:
            self._under_way, self._turn_taken = None, True
            if fetch.begin is not None and self._ask_ahead is not None and not self._turn_over:
                self._asked_ahead = True
                self._ask_ahead(self._request(fetch))
        return True

    def begun_late(self, peer: str, number: int, piece: Piece) -> Fetch | None:
        """The answer that begins with this piece, though others are asked meanwhile; None if it is no beginning.

        What was seen here when it was asked for is still seen, so the next pieces may leave out what is seen now.
        """
        first = self._unanswered.get(peer)
        if piece.begin != START or piece.whole is None or first is None or number < first or self._lacking.everything:
            return None
        fetch = self._new(peer, insists=not piece.joined)
        fetch.first = number
        self._note_broken_off(peer)
        return fetch

    def went_on(self, peer: str) -> None:
        """Note that the answer of a peer has gone on, though perhaps after its turn."""
        if self.fetch is not None and self.fetch.peer == peer:
            self._turn_brought = True
        else:
            self._ready.add(peer)
            self._came_late = peer

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
        if fetch.asks_for_all:
            self._lacking.everything = False
        if fetch is self.fetch:
            self.fetch = self._under_way = None
        else:
            self._paused.pop(fetch.peer, None)
        return not self._broken_off

    def give_up(self, fetch: Fetch) -> None:
        """Ask for no further piece of an answer."""
        if fetch.begin != START:
            self._note_broken_off(fetch.peer)
        if fetch is not self.fetch:
            self._paused.pop(fetch.peer, None)
            return
        if self._turn_brought and fetch.peer in self._peers:
            self._ready.add(fetch.peer)
        self.fetch = self._under_way = None

    def _note_broken_off(self, peer: str) -> None:
        if len(self._broken_off) < MAX_PEERS:
            self._broken_off.add(peer)

    def forget(self, peer: str) -> None:
        """Expect nothing more of a peer."""
        self._paused.pop(peer, None)
        self._unanswered.pop(peer, None)
        self._ready.discard(peer)
        if self.fetch is not None and self.fetch.peer == peer:
            self.give_up(self.fetch)
        self._broken_off.discard(peer)
