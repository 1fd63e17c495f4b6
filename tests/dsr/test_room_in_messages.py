"""Whatever somebody has put into a graph, others can ask for it and be answered: what they send is short enough."""

from __future__ import annotations

from collections.abc import Iterator
from unittest import mock

import pytest

from dsr import Memory
from dsr.crdt import pieces
from dsr.crdt.context import CausalContext
from dsr.crdt.delta import MAX_ENDS, Add, Delta, Write
from dsr.crdt.pieces import START, Piece, all_pieces, seen_by
from dsr.errors import WireError
from dsr.graph.graph import Graph
from dsr.network.keys import Keys
from dsr.replication.fetching import Fetch
from dsr.replication.peers import MAX_PEERS
from dsr.replication.piece_wire import Request, decode_piece, decode_request, encode_piece, encode_request
from dsr.replication.sync import Synchroniser
from dsr.replication.wire import (
    MAX_ADD,
    MAX_NAME,
    MAX_STRUCTURE,
    MOST_NAMED,
    Digest,
    decode_delta,
    decode_digest,
    decode_kept,
    encode_delta,
    encode_digest,
)
from tests.dsr.conftest import Net

LIAR = "liar-1"
WIDE = "\U0001f600"
"""A letter of four bytes."""
Sent = Iterator[tuple[str, Delta]]


def long_names() -> Sent:
    """Nodes of long names and types: a hundred bytes each, if one counts as usual."""
    for first in range(1, 1200, 400):
        adds = [Add((LIAR, first + n), f"{first + n:04}" + WIDE * 252, WIDE * MAX_NAME) for n in range(400)]
        yield LIAR, Delta(adds, context=[(LIAR, first, first + 399)])


def long_attributes() -> Sent:
    """One node with many attributes of long names, and no values."""
    yield LIAR, Delta([Add((LIAR, 1), "n", "cube")], context=[(LIAR, 1, 1)])
    for first in range(2, 1202, 400):
        names = [f"{first + n:04}" + WIDE * 252 for n in range(400)]
        writes = [Write((LIAR, 1), name, 1, LIAR, (LIAR, first + n), 0) for n, name in enumerate(names)]
        yield LIAR, Delta(writes=writes, context=[(LIAR, first, first + 399)])


def many_ends() -> Sent:
    """Edges that each name as many creation dots as they may."""
    ends = tuple(("nobody-1", number + 1) for number in range(100)) * (MAX_ENDS // 100)
    for first in range(1, 301, 150):
        adds = [Add((LIAR, first + n), ("a", f"b{first + n}", "on"), "on", ends, ends) for n in range(150)]
        yield LIAR, Delta(adds, context=[(LIAR, first, first + 149)])


def long_ids() -> Sent:
    """Replicas of long names, each with nothing, with a node, or with a write to one."""
    yield LIAR, Delta([Add((LIAR, 1), "n", "cube")], context=[(LIAR, 1, 1)])
    for number in range(900):
        rid = f"liar-{number:04}" + WIDE * 240
        adds = [Add((rid, 1), f"n{number}", "cube")] if number % 3 == 1 else []
        writes = [Write((LIAR, 1), f"a{number}", 1, rid, (rid, 1), 0)] if number % 3 == 2 else []
        yield rid, Delta(adds, writes, context=[(rid, 1, 1)])


def many_gaps() -> Sent:
    """Replicas that have lost every other message."""
    for number in range(80):
        rid = f"liar-{number}"
        yield rid, Delta(context=[(rid, 2 * n + 2, 2 * n + 2) for n in range(999)])


KINDS = [long_names, long_attributes, many_ends, long_ids, many_gaps]


@pytest.mark.parametrize("kind", KINDS, ids=[kind.__name__ for kind in KINDS])
def test_a_newcomer_joins_and_a_change_that_was_lost_is_repaired(net: Net, kind: type[Sent]) -> None:
    a, evil = net.join("a"), net.network.connect("evil")
    a.replica.synchroniser.nobody_there()
    a.add_node("before", "cube")
    for rid, delta in kind():
        evil.publish(Keys("g").delta(rid), encode_delta(delta))
    net.pump()
    young = net.join("young")
    net.pump(8.0)
    assert young.joined and "before" in young
    net.network.cut("a", "young")
    a.add_node("after", "cube")
    net.pump(0.1)
    assert "after" not in young
    net.network.heal()
    net.pump(3.0)
    assert "after" in young
    assert _held(young) == _held(a) and not young.dropped and not a.dropped


def _held(memory: Memory) -> tuple[int, int]:
    store = memory.replica.graph.store
    return store.context.hash, store.fingerprint


@pytest.mark.parametrize("kind", KINDS, ids=[kind.__name__ for kind in KINDS])
def test_pieces_and_requests_are_read_by_others(kind: type[Sent]) -> None:
    holder, mine = Synchroniser(Graph("holder-1"), joined=True), Graph("mine-1")
    for rid, delta in kind():
        holder.receive_delta(rid, encode_delta(delta), 0.0)
    assert not holder.dropped
    store, fetch = holder.graph.store, Fetch("holder-1", CausalContext(), insists=True)
    for piece in all_pieces(store, CausalContext()):
        read = decode_piece(encode_piece(piece))
        assert fetch.take(read)
        mine.join(read.as_delta(), 0.0)
        fetch.note_joined(read, mine.store)
    mine.join(fetch.rest(), 0.0)
    assert mine.store.context == store.context and mine.store.entries.keys() == store.entries.keys()
    request = decode_request(encode_request(Request("mine-1", CausalContext(seen_by(store)), START, True)))
    assert store.context.covers(request.seen)


def test_a_request_tells_first_what_is_known_of_those_who_made_something() -> None:
    graph = Graph("me-1")
    graph.join(Delta(context=[(f"gone-{number}", 1, 1) for number in range(40)]), 0.0)
    graph.add_node("n", "cube", {}, 0.0)
    with mock.patch.object(pieces, "MAX_ASKED", 200):
        told = seen_by(graph.store)
    assert told[0] == ("me-1", 1, 1) and 1 < len(told) < 10


def test_pieces_about_what_was_seen_end() -> None:
    fetch = Fetch("liar-1", CausalContext(), insists=True)
    ranges = [(f"r-{number}", 1, 1) for number in range(10)]
    with mock.patch("dsr.replication.fetching.MAX_UNJOINED", 25):
        for number in range(3):
            assert fetch.take(Piece(("", 10 * number, ""), ("", 10 * number + 10, ""), whole=ranges))
            assert fetch.is_useless == (number == 2)
    assert not fetch.take(Piece(("", 30, ""), None))  # what has been seen so far is not told


def test_an_edge_that_no_answer_has_room_for_is_refused() -> None:
    ids = [f"{number:03}" + WIDE * 240 for number in range(MAX_ADD // 960)]
    ends = tuple((rid, 1) for rid in ids)
    add = Add((LIAR, 1), ("a", "b", "on"), "on", ends, ends)
    with pytest.raises(WireError, match="ends of more than"):
        decode_delta(encode_delta(Delta([add])))
    other = Add((LIAR, 2), "n", "cube")
    assert decode_kept(encode_delta(Delta([add, other]))).adds == [other]
    few = Add((LIAR, 1), ("a", "b", "on"), "on", ends[:200], ends[:150])
    assert decode_delta(encode_delta(Delta([few]))).adds == [few]


def test_the_longest_edge_that_an_honest_replica_makes_has_room() -> None:
    ids = [f"{64 * 'a'}-{64 * 'p'}.{number:08x}r000001{number:08x}" for number in range(2 * MAX_ENDS)]
    dots = [(rid, 1 << 52) for rid in ids]
    add = Add((LIAR, 1), (MAX_NAME * WIDE,) * 3, MAX_NAME * WIDE, tuple(dots[:MAX_ENDS]), tuple(dots[MAX_ENDS:]))
    assert decode_delta(encode_delta(Delta([add]))).adds == [add]
    graph = Graph("me-1")
    graph.join(Delta([add], context=[(LIAR, 1, 1), *((f"z-{n}" + WIDE * 200, 1, 1) for n in range(700))]), 0.0)
    sizes = [len(encode_piece(piece)) for piece in all_pieces(graph.store, CausalContext())]
    assert max(sizes) > MAX_ADD // 2
    assert max(sizes) < MAX_STRUCTURE


def test_a_digest_is_short_however_many_clocks_are_ahead() -> None:
    synchroniser = Synchroniser(Graph("me-1"), joined=True)
    for number in range(MAX_PEERS):
        rid = f"{number:04}{WIDE * 200}-1"
        seen = CausalContext().summary()
        synchroniser.receive_digest(rid, encode_digest(Digest(rid, 100.0, seen, 0, ())), 0.0, 0.0)
    digest = synchroniser.digest(0.0)
    assert len(digest) < MAX_STRUCTURE // 8
    named = decode_digest(digest).ahead
    assert len(named) == MOST_NAMED and named[0].startswith("0000"), "those that came first"


def test_who_waits_for_many_names_few(net: Net) -> None:
    synchroniser = Synchroniser(Graph("me-1"))
    for number in range(MAX_PEERS):
        synchroniser.peer_appeared(f"{number:04}{WIDE * 200}-1", 0.0)
    piece = synchroniser.answer("b-1", encode_request(Request("b-1", CausalContext(), START)))
    assert piece is not None and len(decode_piece(encode_piece(piece)).waits_for) == MOST_NAMED
