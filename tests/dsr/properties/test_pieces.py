"""Answers in pieces: any of them, in any order, repeated or lost, with changes between them, lose nothing and agree."""

from __future__ import annotations

import random
from unittest import mock

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.years.showing import state
from dsr.crdt import pieces
from dsr.crdt.context import CausalContext, Dot
from dsr.crdt.delta import Delta
from dsr.crdt.pieces import START, Piece, Place, piece_of, reply_to, seen_by
from dsr.graph.graph import Graph
from dsr.replication.fetching import Fetch
from dsr.replication.piece_wire import decode_piece, encode_piece
from tests.dsr.properties.soup import START as NOW

NAMES = ["a", "b", "c", "d", "e", "f"]


class Room:
    """Three replicas: each change reaches each other one at once, or never; the rest is left to answers in pieces."""

    def __init__(self, seed: int, *, examined: int, weight: int) -> None:
        self.random = random.Random(seed)
        self.graphs = [Graph(f"r-{number}") for number in range(3)]
        self.old: list[tuple[int, Piece]] = []
        """Pieces that were asked for, and who asked: they may come late, and again."""
        self.alive: set[Dot] = set()
        """Creation dots of all nodes."""
        self.removed: set[Dot] = set()
        self._now = NOW
        self._limits = mock.patch.multiple(pieces, MAX_EXAMINED=examined, MAX_WEIGHT=weight)

    def change(self) -> None:
        """One change of one replica."""
        graph = self.random.choice(self.graphs)
        self._now += 0.1
        delta = self._make(graph)
        self.alive |= {add.dot for add in delta.adds if isinstance(add.key, str)}
        self.removed.update(delta.removed)
        for other in self.graphs:
            if other is not graph and self.random.random() < 0.4:
                other.join(delta, self._now)

    def _make(self, graph: Graph) -> Delta:
        names, value = list(graph.nodes), self.random.randrange(100)
        kind = self.random.randrange(6)
        if kind == 0 or not names:
            return graph.add_node(self.random.choice(NAMES), "cube", {"seen": value}, self._now)
        name, other = self.random.choice(names), self.random.choice(names)
        if kind == 1:
            return graph.remove_node(name)
        if kind == 2:
            return graph.add_edge(name, other, "on", {"since": float(value)}, self._now)
        if kind == 3:
            return graph.make_durable()
        return graph.write(graph.node(name), {"seen": value, "mass": float(value), "note": value * "x"}, self._now)

    def fetch(self, asker: int, asked: int, *, whole: bool) -> bool:
        """One replica asks another one; unless `whole`, it may be broken off. Whether all came."""
        mine, theirs = self.graphs[asker], self.graphs[asked]
        fetch = Fetch("peer", CausalContext(mine.store.context.ranges()), insists=True)
        while fetch.begin is not None:
            if not whole and self.random.random() < 0.1:
                return False
            if not whole and self.random.random() < 0.3:  # the answer was paused, and goes on
                fetch.seen = CausalContext(seen_by(mine.store))
            with self._limits:
                piece = decode_piece(encode_piece(piece_of(theirs.store, fetch.seen, fetch.begin)))
            self.old.append((asker, piece))
            if not whole and self.random.random() < 0.5:
                self.change()
            mine.join(piece.as_delta(), self._now)
            assert fetch.take(piece)
            fetch.note_joined(piece, mine.store)
            if not whole and self.random.random() < 0.3:
                self.replay()
        mine.join(fetch.rest(), self._now)
        return True

    def replay(self) -> None:
        """A piece comes late, or again."""
        if self.old:
            asker, piece = self.random.choice(self.old)
            self.graphs[asker].join(piece.as_delta(), self._now)

    def converge(self) -> None:
        """All ask all, and nothing changes any more."""
        for graph in self.graphs:
            delta = graph.make_durable(0)
            for other in self.graphs:
                other.join(delta, self._now)
        for _ in range(2):
            for asker in range(3):
                for asked in range(3):
                    if asker != asked:
                        self.fetch(asker, asked, whole=True)


def random_history(seed: int, examined: int, weight: int) -> Room:
    """A room that has seen changes, fetches and late pieces, and has come to rest."""
    room = Room(seed, examined=examined, weight=weight)
    for _ in range(40):
        kind = room.random.randrange(4)
        if kind == 0:
            asker, asked = room.random.sample(range(3), 2)
            room.fetch(asker, asked, whole=False)
        elif kind == 1:
            room.replay()
        else:
            room.change()
    room.converge()
    return room


def check(room: Room) -> None:
    first = room.graphs[0]
    nodes = {entry.dot for entry in first.store.entries.values() if isinstance(entry.key, str)}
    assert nodes == room.alive - room.removed
    for graph in room.graphs[1:]:
        assert state(graph) == state(first)
        assert graph.store.context == first.store.context


limits = {"seed": st.integers(0, 2**32), "examined": st.integers(1, 4), "weight": st.sampled_from([1, 150, 10**6])}


@settings(max_examples=300, deadline=None)
@given(**limits)
def test_replicas_agree_whatever_becomes_of_the_pieces(seed: int, examined: int, weight: int) -> None:
    check(random_history(seed, examined, weight))


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32), examined=st.integers(1, 4))
def test_who_got_all_pieces_lacks_nothing_that_was_there(seed: int, examined: int) -> None:
    room = Room(seed, examined=examined, weight=10**6)
    for _ in range(30):
        room.change()
    asker, asked = room.graphs[0].store, room.graphs[1].store
    before = CausalContext(asked.context.ranges())
    room.fetch(0, 1, whole=False)
    assert room.fetch(0, 1, whole=True) and asker.context.covers(before)
    assert all(asked.find(dot) for dot in asker.entries if dot in before)


def test_nothing_is_sent_twice_after_an_interruption() -> None:
    graph, newcomer = Graph("a"), Graph("b")
    for number in range(20):
        graph.add_node(f"n{number}", "cube", {"seen": number}, NOW)
    with mock.patch.object(pieces, "MAX_EXAMINED", 4):
        place: Place = START
        for _ in range(3):
            piece = piece_of(graph.store, CausalContext(), place)
            newcomer.join(piece.as_delta(), NOW)
            assert piece.end is not None
            place = piece.end
    again = reply_to(graph.store, newcomer.store.context)
    assert [len(newcomer.nodes), len(again.adds), len(again.writes)] == [12, 8, 8]


def test_an_element_larger_than_a_piece_is_divided() -> None:
    graph = Graph("a")
    values = {"note": 50_000 * "x", "seen": 1, "mass": 1.0, "size": (0.1,) * 3, "record": 50_000 * "y"}
    graph.add_node("n", "cube", values, NOW)
    with mock.patch.object(pieces, "MAX_WEIGHT", 60_000):
        parts = list(pieces.all_pieces(graph.store, CausalContext()))
    assert len(parts) == 2 and sum(len(part.writes) for part in parts) == 5


def account_for_everything(original: object) -> object:
    """Known-bad: a piece accounts for all that its sender has seen."""

    def as_delta(self: Piece) -> Delta:
        delta: Delta = original(self)  # type: ignore[operator]
        delta.context += self.whole or []
        return delta

    return as_delta


def account_for_the_interval(original: object) -> object:
    """Known-bad: a piece accounts for all dots in its interval, those of writes to other elements included."""

    def as_delta(self: Piece) -> Delta:
        delta: Delta = original(self)  # type: ignore[operator]
        delta.context += self.examined
        return delta

    return as_delta


def remove_what_is_not_listed(original: object) -> object:
    """Known-bad: what a piece does not list as alive is removed, in its interval or not."""

    def as_delta(self: Piece) -> Delta:
        delta: Delta = original(self)  # type: ignore[operator]
        delta.examined = self.whole or self.examined
        return delta

    return as_delta


@pytest.mark.parametrize("mutant", [account_for_everything, account_for_the_interval, remove_what_is_not_listed])
def test_wrong_designs_are_caught(mutant: object) -> None:
    with mock.patch.object(Piece, "as_delta", mutant(Piece.as_delta)):  # type: ignore[operator]
        for seed in range(300):
            room = random_history(seed, 2, 10**6)
            try:
                check(room)
            except AssertionError:
                return
    pytest.fail("not caught")


def test_what_comes_late_between_two_pieces_goes_if_the_answerer_has_seen_it_removed() -> None:
    holder, maker, mine = Graph("holder"), Graph("maker"), Graph("mine")
    added, removed = maker.add_node("thing", "cube", {"seen": 1}, NOW), maker.remove_node("thing")
    for delta in (added, removed):
        holder.join(delta, NOW)
    fetch = Fetch("holder", CausalContext(), insists=True)
    piece = piece_of(holder.store, CausalContext())
    assert fetch.take(piece)
    mine.join(piece.as_delta(), NOW)
    mine.join(added, NOW)  # it was under way for long
    assert "thing" in mine.nodes
    mine.join(fetch.rest(), NOW)
    assert "thing" not in mine.nodes
    assert state(mine) == state(holder)


def test_the_end_of_an_answer_takes_nothing_that_lives_at_both() -> None:
    holder, mine = Graph("holder"), Graph("mine")
    mine.join(holder.add_node("thing", "cube", {}, NOW), NOW)
    fetch = Fetch("holder", CausalContext(mine.store.context.ranges()), insists=True)
    piece = piece_of(holder.store, mine.store.context)
    assert fetch.take(piece) and piece.kept
    mine.join(piece.as_delta(), NOW)
    fetch.note_joined(piece, mine.store)
    mine.join(fetch.rest(), NOW)
    assert "thing" in mine.nodes
