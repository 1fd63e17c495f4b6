"""Answers that never end: others have their turn, and what was asked for so far is not asked for again."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import pytest

from dsr.crdt.context import CausalContext
from dsr.crdt.delta import Add, Delta, Write
from dsr.crdt.pieces import START, Piece, Place
from dsr.graph.graph import Graph
from dsr.replication import fetching
from dsr.replication.claims import MAX_GAPS
from dsr.replication.inquiry import TURN
from dsr.replication.lacking import GRACE
from dsr.replication.outputs import Ask
from dsr.replication.piece_wire import Request, decode_request, encode_piece
from dsr.replication.sync import Synchroniser
from dsr.replication.wire import Digest, encode_digest

STEP = 0.25
"""s between two looks"""


class Room:
    """A replica, an honest peer that holds nodes, and a liar; time is moved by hand."""

    def __init__(self, nodes: int, lie: Callable[[Request], Piece], *, joined: bool = True) -> None:
        self.mine = Synchroniser(Graph("me-1"), joined=joined)
        self.honest = Synchroniser(Graph("honest-1"), joined=True)
        for number in range(nodes):
            self.honest.graph.add_node(f"n{number}", "cube", {}, 0.0)
        self.lie = lie
        self.asked: list[str] = []
        self.now = 0.0
        self.mine.peer_appeared("liar-1", 0.0)
        self.mine.peer_appeared("honest-1", 0.0)

    def live(self, seconds: float, *, honest: bool = True) -> None:
        """Let time pass; whether the honest peer tells what it has."""
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            seen = CausalContext([("nobody-1", 1, 5)])
            liar = encode_digest(Digest("liar-1", self.now, seen.summary(), 0, ()))
            self.mine.receive_digest("liar-1", liar, self.now - STEP, self.now)
            if honest:
                digest = self.honest.digest(self.now)
                self.mine.receive_digest("honest-1", digest, self.now - STEP, self.now)
            for ask in [each for each in self.mine.tick(self.now, self.now) if isinstance(each, Ask)]:
                self._answer(ask)

    def _answer(self, ask: Ask) -> None:
        self.asked.append(ask.peer)
        lie = self.lie(decode_request(ask.payload)) if ask.peer == "liar-1" else None
        piece = lie or self.honest.answer("me-1", ask.payload)
        assert piece is not None
        self.mine.receive_reply(ask.peer, ask.number, encode_piece(piece), self.now)
        self.mine.request_done(ask.number)


def endless(request: Request) -> Piece:
    begin = request.begin
    kept = [("nobody-1", begin[1] + number + 1) for number in range(1000)]
    whole = [("nobody-1", 1, 9)] if begin == START else None
    return Piece(begin, ("nobody-1", begin[1] + 1000, ""), kept=kept, whole=whole)


def test_an_endless_answer_keeps_nobody_from_others() -> None:
    room = Room(10, endless)
    room.live(1.0, honest=False)
    assert room.asked and set(room.asked) == {"liar-1"}
    room.live(3 * TURN)
    assert len(room.mine.graph.nodes) == 10
    assert not room.mine.dropped


def test_an_endless_answer_keeps_no_newcomer_out() -> None:
    room = Room(10, endless, joined=False)
    room.live(3 * TURN)
    assert room.mine.joined and len(room.mine.graph.nodes) == 10


def test_what_does_not_live_here_is_not_kept_in_mind() -> None:
    room = Room(10, endless)
    room.live(2.0, honest=False)
    assert room.mine.inquiry.fetch is not None and not room.mine.inquiry.fetch._live


def test_an_answer_goes_on_where_it_was_when_others_had_their_turn() -> None:
    begun: list[int] = []

    def slow(request: Request) -> Piece:
        begin = request.begin
        begun.append(begin[1])
        end = None if begin[1] > 40 else ("nobody-1", begin[1] + 1, "")
        whole = [("nobody-1", 1, 9)] if begin == START else None
        return Piece(begin, end, whole=whole)

    room = Room(10, slow)
    room.live(1.0, honest=False)
    room.live(4 * TURN)
    assert set(room.asked) == {"liar-1", "honest-1"}
    assert begun[:42] == list(range(42)), "it began again"
    assert room.mine.graph.store.context.vector["nobody-1"] == 9


def test_an_answer_without_end_of_what_cannot_be_joined_is_not_listened_to() -> None:
    def writes(request: Request) -> Piece:
        begin = request.begin
        made = [("nobody-1", begin[1] + number + 1) for number in range(1000)]
        sent = [Write(("nothing-1", dot[1]), "seen", 1, "nobody-1", dot, 1) for dot in made]
        whole = [("nobody-1", 1, 10**6)] if begin == START else None
        return Piece(begin, ("nobody-1", begin[1] + 1000, ""), writes=sent, whole=whole)

    bound, fetching.MAX_UNJOINED = fetching.MAX_UNJOINED, 5000
    try:
        room = Room(10, writes)
        room.live(2.5, honest=False)
    finally:
        fetching.MAX_UNJOINED = bound
    assert room.mine.dropped == {"liar-1": 1}
    assert room.mine.inquiry.fetch is None or not room.mine.inquiry.fetch.is_useless


def test_additions_that_are_refused_count_too() -> None:
    fetch = fetching.Fetch("peer-1", CausalContext(), insists=True)
    graph = Graph("me-1")
    adds = [Add(("a-1", number + 1), f"n{number}", "cube") for number in range(10)]
    graph.join(Piece(START, adds=adds[:4]).as_delta(), 0.0)
    fetch.note_joined(Piece(START, adds=adds, whole=[]), graph.store)
    assert fetch._refused == 6 and not fetch.is_useless


def test_a_piece_that_was_lost_is_asked_for_again_and_not_all_before_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dsr.crdt.pieces.MAX_EXAMINED", 10)
    mine, holder = Synchroniser(Graph("me-1")), Synchroniser(Graph("holder-1"), joined=True)
    for number in range(40):
        holder.graph.add_node(f"n{number}", "cube", {}, 0.0)
    mine.peer_appeared("holder-1", 0.0)
    begins: list[Place] = []
    now = 0.0
    while not mine.joined and now < 60.0:
        now += STEP
        mine.receive_digest("holder-1", holder.digest(now), now, now)
        for ask in [each for each in mine.tick(now, now) if isinstance(each, Ask)]:
            begins.append(decode_request(ask.payload).begin)
            if len(begins) % 2 == 0:  # each other answer is lost
                continue
            piece = holder.answer("me-1", ask.payload)
            assert piece is not None
            mine.receive_reply("holder-1", ask.number, encode_piece(piece), now)
    assert mine.joined and len(mine.graph.nodes) == 40
    assert begins == sorted(begins) and begins.count(START) == 1


def test_who_tells_again_and_again_that_something_is_missing_is_asked_for_it() -> None:
    """Digests that follow each other sooner than a delta may take must not put the question off."""
    mine, holder = Synchroniser(Graph("me-1"), joined=True), Synchroniser(Graph("holder-1"), joined=True)
    holder.graph.add_node("cup", "cube", {}, 0.0)
    mine.peer_appeared("holder-1", 0.0)
    asked_at = []
    for now in (number / 20 for number in range(1, 11)):
        mine.receive_digest("holder-1", holder.digest(now), now, now)
        if any(isinstance(each, Ask) for each in mine.tick(now, now)):
            asked_at.append(now)
    assert asked_at and GRACE <= asked_at[0] <= 2 * GRACE + 0.05


def test_a_peer_that_broke_off_its_answer_and_left_keeps_no_gaps_open() -> None:
    """While an answer is unfinished, what it lacks is a gap that somebody can fill; not when nobody will."""
    mine, holder = Synchroniser(Graph("me-1"), joined=True), Synchroniser(Graph("holder-1"), joined=True)
    for number in range(1, 900):
        holder.graph.join(Delta(context=[("dead-1", 4 * number, 4 * number)]), 0.0)
    mine.graph.join(Delta(context=[("dead-1", 4 * number + 2, 4 * number + 2) for number in range(1, 900)]), 0.0)
    lie = CausalContext([("nobody-1", 1, 5)]).summary()
    mine.peer_appeared("liar-1", 0.0)
    mine.peer_appeared("holder-1", 0.0)
    for step in range(1, 1200):
        now = step / 10
        if step < 150 and step % 10 == 6:
            mine.receive_digest("liar-1", encode_digest(Digest("liar-1", now, lie, 0, ())), now, now)
        if step == 150:
            assert "liar-1" in mine.peers
            mine.peer_gone("liar-1", now)
        if step > 160 and step % 10 == 2:
            mine.receive_digest("holder-1", holder.digest(now), now, now)
        for ask in [each for each in mine.tick(now, now) if isinstance(each, Ask)]:
            piece = Piece(START, (ask.peer, 1, ""), whole=[("nobody-1", 1, 5)])
            if ask.peer == "holder-1":
                piece = holder.answer("me-1", ask.payload) or piece
            if ask.peer == "holder-1" or decode_request(ask.payload).begin == START:
                mine.receive_reply(ask.peer, ask.number, encode_piece(piece), now)
    assert mine.graph.store.context.gaps("dead-1") <= MAX_GAPS + 1


@pytest.mark.parametrize("holders", [1, 2])
def test_all_that_is_asked_for_comes_though_each_answer_takes_more_than_a_turn(
    holders: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A removal came to the holders without its dot: only who asks for everything learns of it."""
    monkeypatch.setattr("dsr.crdt.pieces.MAX_EXAMINED", 10)
    peers = {f"h{number}-1": Synchroniser(Graph(f"h{number}-1"), joined=True) for number in range(holders)}
    mine, first = Synchroniser(Graph("me-1"), joined=True), peers["h0-1"]
    for number in range(200):
        delta = first.graph.add_node(f"n{number}", "cube", {}, 0.0)
        for synchroniser in (*peers.values(), mine):
            if synchroniser is not first:
                synchroniser.graph.join(delta, 0.0)
    for rid, peer in peers.items():
        peer.graph.store.join(Delta(removed=[*mine.graph.nodes["n199"].created]))
        mine.peer_appeared(rid, 0.0)
    under_way: list[tuple[float, Ask, Piece]] = []
    for step in range(1, 1000):
        now = step / 10
        for place, (rid, peer) in enumerate(peers.items()):
            if step % 10 == place + 2:
                mine.receive_digest(rid, peer.digest(now), now, now)
        for ask in [each for each in mine.tick(now, now) if isinstance(each, Ask)]:
            piece = peers[ask.peer].answer("me-1", ask.payload)
            assert piece is not None
            under_way.append((now + 0.3, ask, piece))
        for come in [each for each in under_way if each[0] <= now]:
            under_way.remove(come)
            mine.receive_reply(come[1].peer, come[1].number, encode_piece(come[2]), now)
    assert "n199" not in mine.graph.nodes and mine.graph.store.fingerprint == first.graph.store.fingerprint
    assert not mine.lacking.everything


class Crowd:
    """A replica, a holder whose answers take `delay` s, and liars that give some pieces, and never the next.

    Each of the `pieces` of a liar tells of 150 made-up ranges.
    """

    def __init__(self, nodes: int, *, joined: bool, delay: float = 0.0, pieces: int = 1) -> None:
        self.mine = Synchroniser(Graph("me-1"), joined=joined)
        self.delay, self.now, self._steps, self._pieces = delay, 0.0, 0, pieces
        self._holder = Synchroniser(Graph("holder-1"), joined=True)
        for number in range(nodes):
            self._holder.graph.add_node(f"n{number}", "cube", {}, 0.0)
        self._under_way: list[tuple[float, Ask, Piece]] = []

    def step(self, liars: list[str], *, holder_speaks: bool) -> None:
        """Let 0.1 s pass; these liars speak now, and perhaps the holder."""
        self._steps += 1
        self.now = self._steps / 10
        lie = CausalContext([("nobody-1", 1, 5)]).summary()
        for rid in liars:
            self.mine.receive_digest(rid, encode_digest(Digest(rid, self.now, lie, 0, ())), self.now, self.now)
        if holder_speaks:
            self.mine.receive_digest("holder-1", self._holder.digest(self.now), self.now, self.now)
        for ask in [each for each in self.mine.tick(self.now, self.now) if isinstance(each, Ask)]:
            if ask.peer == "holder-1":
                piece = self._holder.answer("me-1", ask.payload)
                assert piece is not None
                self._under_way.append((self.now + self.delay, ask, piece))
            elif (piece := self._lie(ask, decode_request(ask.payload).begin)) is not None:
                self._under_way.append((self.now, ask, piece))
        for come in [each for each in self._under_way if each[0] <= self.now]:
            self._under_way.remove(come)
            self.mine.receive_reply(come[1].peer, come[1].number, encode_piece(come[2]), self.now)

    def _lie(self, ask: Ask, begin: Place) -> Piece | None:
        """The next piece of a liar's answer, if there is one more."""
        if self._pieces == 1:
            return Piece(START, (ask.peer, 1, ""), whole=[("nobody-1", 1, 5)]) if begin == START else None
        if begin[0] or begin[1] >= 150 * self._pieces:
            return None
        counters = (2 * (begin[1] + number) + 1 for number in range(150))
        whole = [("nobody-1", counter, counter) for counter in counters]
        return Piece(begin, ("", begin[1] + 150, ""), whole=whole)


def test_a_liar_that_answers_no_more_keeps_nobody_from_who_speaks_when_its_turn_ends() -> None:
    """A turn lasts for a whole number of seconds, and so do the times between digests."""
    crowd = Crowd(1, joined=True)
    number = 0
    while number < 400 and not crowd.mine.graph.nodes:
        number += 1
        crowd.step(["liar-1"] if number % 10 == 0 else [], holder_speaks=number % 10 == 2 and number > 10)
    assert number < 150


@pytest.mark.parametrize("withdraws", [False, True])
@pytest.mark.parametrize("joined", [False, True])
def test_a_liar_that_comes_under_ever_new_ids_is_not_asked_before_who_waits(
    joined: bool, withdraws: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dsr.crdt.pieces.MAX_EXAMINED", 10)
    crowd, ids = Crowd(60, joined=joined, delay=2.5), deque[str](maxlen=20)
    crowd.mine.peer_appeared("holder-1", 0.0)
    for number in range(2000):
        if number % 10 == 5:
            if len(ids) == 20:
                crowd.mine.peer_gone(ids[0], crowd.now)
            ids.append(f"liar-{number}")
            crowd.mine.peer_appeared(ids[-1], crowd.now)
        crowd.step(list(ids) if number % 10 == 6 else [], holder_speaks=number % 10 == 2)
        if withdraws and number % 10 == 7 and ids:
            crowd.mine.peer_gone(ids[-1], crowd.now)
    assert len(crowd.mine.graph.nodes) == 60


@pytest.mark.parametrize("joined", [False, True])
def test_what_liars_have_made_up_keeps_no_place_of_an_answer_for_long(
    joined: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nine of them give thirty pieces each, and then none, but speak on."""
    monkeypatch.setattr("dsr.crdt.pieces.MAX_EXAMINED", 10)
    crowd, liars = Crowd(100, joined=joined, delay=0.9, pieces=30), [f"liar{number}-1" for number in range(9)]
    for rid in (*liars, "holder-1"):
        crowd.mine.peer_appeared(rid, 0.0)
    for number in range(8000):
        crowd.step(liars if number % 10 == 6 else [], holder_speaks=number % 10 == 2)
        if len(crowd.mine.graph.nodes) == 100:
            break
    assert len(crowd.mine.graph.nodes) == 100
