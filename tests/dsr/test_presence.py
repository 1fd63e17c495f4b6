"""False liveliness tokens: they hide nobody, hold nothing up, and are bounded."""

from __future__ import annotations

import pytest

from dsr.crdt.context import CausalContext
from dsr.crdt.pieces import START, Piece
from dsr.graph.graph import Graph
from dsr.replication.joining import UNJOINED_RETRY, Joining
from dsr.replication.outputs import Ask
from dsr.replication.peers import DEPARTURE, MAX_OF_AGENT, MAX_PEERS, SILENCE, Peers
from dsr.replication.piece_wire import encode_piece
from dsr.replication.sync import Synchroniser
from dsr.replication.wire import Digest, encode_digest
from dsr.worlds.presence import WorldPresence
from tests.dsr.conftest import Net


def test_a_withdrawn_token_of_somebody_who_goes_on_counts_for_nothing(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    net.pump(2.0)
    stranger = net.network.connect("stranger")
    missing = 0
    for _ in range(20):
        token = stranger.announce(a.keys.presence("b", b.rid))
        net.pump(0.05)
        token.close()
        for _ in range(10):
            net.pump(0.05)
            missing += b.rid not in a.peers
    assert missing == 0


def test_who_leaves_or_dies_is_gone_at_once(net: Net) -> None:
    a, b, c = net.join("a"), net.join("b"), net.join("c")
    net.pump(2.0)
    net.memories.remove(b)
    b.transport.close()
    net.pump(0.2)
    assert a.peers == [c.rid]
    net.memories.remove(c)
    c.close()
    net.pump(0.2)
    assert a.peers == []


def test_a_token_without_digests_holds_nothing_up_and_is_forgotten(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    net.pump(2.0)
    stranger = net.network.connect("stranger")
    stranger.announce(a.keys.presence("ghost", "ghost-1"))
    net.pump(1.0)
    a.add_node("x", "cube")
    net.pump(1.5)
    sync = a.replica.synchroniser
    assert "ghost-1" in a.peers and sync.delivered and sync.heard == [b.rid]
    net.pump(SILENCE)
    assert a.peers == [b.rid]


def test_a_first_replica_begins_although_there_are_tokens(net: Net) -> None:
    stranger = net.network.connect("stranger")
    stranger.announce("dsr/v1/g/live/ghost/ghost-1")
    memory = net.join("a")
    net.pump(1.0)
    memory.wait_joined(0.0)
    assert memory.joined


def test_tokens_are_bounded_for_each_agent_and_in_all(net: Net, caplog: pytest.LogCaptureFixture) -> None:
    a, b = net.join("a"), net.join("b")
    net.pump(2.0)
    stranger = net.network.connect("stranger")
    presence = WorldPresence(a)
    for number in range(3000):
        stranger.announce(a.keys.presence("ghost", f"ghost-{number}"))
    net.pump(0.1)
    assert len(a.peers) == MAX_OF_AGENT + 1
    for number in range(3000):
        stranger.announce(a.keys.presence(f"ghost{number}", f"ghost{number}-1"))
    net.pump(0.1)
    assert len(a.peers) == MAX_PEERS and b.rid in a.peers
    assert sum(map(len, presence._tokens.values())) <= MAX_PEERS
    assert sum("more replicas announce themselves" in record.getMessage() for record in caplog.records) == 2
    late = net.join("late")
    net.pump(1.0)
    assert late.rid in a.peers, "who speaks takes the place of a token"


def test_who_speaks_takes_the_place_of_a_token_of_its_own_agent_if_those_are_too_many(net: Net) -> None:
    a = net.join("a")
    stranger = net.network.connect("stranger")
    for number in range(2 * MAX_OF_AGENT):
        stranger.announce(a.keys.presence("late", f"late-{number}"))
    net.pump(0.1)
    late = net.join("late")
    net.pump(1.0)
    assert late.rid in a.peers and len(a.peers) == MAX_OF_AGENT


def test_one_that_neither_answers_nor_speaks_is_gone_in_the_end() -> None:
    peers = Peers()
    peers.heard("b-1", Digest("b-1", 0.0, CausalContext().summary(), 0, ()), 1.0)
    peers.withdrawn("b-1", 1.5)
    assert not list(peers.forget_gone(1.5 + DEPARTURE)) and list(peers.forget_gone(1.6 + DEPARTURE)) == ["b-1"]
    assert not peers and not peers._of_agent


def test_a_digest_that_was_under_way_when_the_token_went_keeps_nobody_alive() -> None:
    peers, digest = Peers(), Digest("b-1", 0.0, CausalContext().summary(), 0, ())
    peers.heard("b-1", digest, 1.0)
    peers.withdrawn("b-1", 1.5)
    peers.heard("b-1", digest, 1.6)
    assert not list(peers.forget_gone(1.6 + DEPARTURE)) and list(peers.forget_gone(1.7 + DEPARTURE)) == ["b-1"]


def test_a_newcomer_asks_those_who_had_not_joined_again_although_another_one_never_answers() -> None:
    joining, queued = Joining("new-1", lambda rid: True), {"silent-1": -1.0, "late-1": -1.0}
    for rid in queued:
        joining.appeared(rid)
    joining.declined("late-1", ["silent-1"])
    chosen = []
    for step in range(10):
        rid = joining.choose(queued, step * UNJOINED_RETRY)
        assert rid is not None
        queued[rid] = step
        chosen.append(rid)
    assert chosen[0] == "silent-1" and chosen.count("late-1") == 5


def test_a_newcomer_that_is_slow_does_not_ask_those_again_and_again_that_gave_all() -> None:
    joining, queued = Joining("new-1", lambda rid: True), {"first-1": -1.0, "second-1": -1.0, "liar-1": -1.0}
    for rid in queued:
        joining.appeared(rid)
        joining.declined(rid, ["liar-1"])
    joining.given_up = frozenset(["liar-1"])
    for step in range(4):
        rid = joining.choose(queued, step * 2.0 * UNJOINED_RETRY)
        assert rid is not None
        queued[rid] = step
        joining.exhausted(rid)
    assert queued["first-1"] >= 0.0 and queued["second-1"] >= 0.0
    assert joining.others == ["first-1", "second-1", *(["liar-1"] if queued["liar-1"] >= 0.0 else [])]


def test_an_answer_to_what_was_asked_before_the_token_went_keeps_nobody_alive() -> None:
    sync = Synchroniser(Graph("a-1"), joined=True)
    sync.peer_appeared("b-1", 0.0)
    digest = Digest("b-1", 0.0, CausalContext([("b-1", 1, 1)]).summary(), 1, ())
    sync.receive_digest("b-1", encode_digest(digest), 1.0, 0.0)
    asks = [output for output in sync.tick(1.5, 0.0) if isinstance(output, Ask)]
    assert [ask.peer for ask in asks] == ["b-1"]
    sync.peer_gone("b-1", 1.6)
    sync.receive_reply("b-1", asks[0].number, encode_piece(Piece(START, whole=[])), 0.0)
    assert sync._peers["b-1"].withdrawn_at == 1.6
    asks = [output for output in sync.tick(1.7, 0.0) if isinstance(output, Ask)]
    sync.request_done(asks[0].number)
    assert sync.peers == []
