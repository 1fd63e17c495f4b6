"""A peer that speaks in a replica's name: the replica refuses, takes another id, and loses nothing that it holds."""

from __future__ import annotations

from pathlib import Path

import pytest

from dsr import Memory, StateKeeper
from dsr.crdt.context import CausalContext
from dsr.crdt.delta import TOMBSTONE, Add, Delta, Write
from dsr.crdt.summary import Summary
from dsr.network import rendezvous
from dsr.network.keys import agent_of
from dsr.network.transport import Transport
from dsr.replication.impersonation import NEW_ID_PAUSE
from dsr.replication.peers import FORGET
from dsr.replication.renaming import next_id
from dsr.replication.wire import Digest, encode_delta, encode_digest
from tests.dsr.conftest import Net, reply_of, tabletop

MOST = 1 << 53
HEAL = 5.0
"""s within which replicas are equal again: two digests more than a lost message takes."""


def stranger(net: Net) -> Transport:
    return net.network.connect("stranger")


def burn(net: Net, memory: Memory, last: int = MOST) -> None:
    """Tell all others that they have seen whatever `memory` may ever write."""
    rid = memory.replica.graph.rid
    stranger(net).publish(memory.keys.delta(rid), encode_delta(Delta(context=[(rid, 1, last)])))


def content(memory: Memory) -> dict[str, object]:
    nodes = {node.name: (node.type, dict(node)) for node in memory.nodes()}
    return {**nodes, **{str(edge.key): dict(edge) for edge in memory.edges()}}


def check_equal(net: Net, *memories: Memory) -> None:
    net.pump(HEAL)
    first = memories[0].replica.graph
    for memory in memories[1:]:
        assert content(memory) == content(memories[0])
        assert memory.replica.graph.store.context == first.store.context
        assert memory.replica.graph.store.fingerprint == first.store.fingerprint


def test_a_claim_to_have_seen_all_that_a_replica_will_write_stops_it_no_longer_than_a_poll(
    net: Net, caplog: pytest.LogCaptureFixture
) -> None:
    victim, other = net.join("victim"), net.join("other")
    net.pump(2.0)
    tabletop(victim)
    net.pump(2.0)
    old = victim.replica.graph.rid
    burn(net, victim)
    net.pump(0.1)
    victim.add_node("later", "cube", mass=1.0)
    check_equal(net, victim, other)
    assert "later" in other and "cube_3" in other
    new = victim.replica.graph.rid
    assert new != old and agent_of(new) == "victim" and other.peers == [new] and victim.rid == old
    assert victim.dropped == {old: 1} and f"in the name of {old}" in caplog.text


def test_what_was_written_before_it_was_noticed_is_written_anew(net: Net) -> None:
    victim, other = net.join("victim"), net.join("other")
    tabletop(victim)
    net.pump(2.0)
    net.network.partition(["other", "stranger"], ["victim"])
    burn(net, victim)
    net.pump(0.5)
    victim.add_node("alone", "cube", mass=1.0)
    victim.add_node("table_2", "table")
    victim.add_edge("table_2", "alone", "on", since=1.0)
    victim.update_node("cube_3", mass=7.0)
    victim.update_edge("world", "cube_3", "RT", translation=(9.0, 0.0, 0.0), rotation=(0, 0, 0, 1), stamp=9.0)
    victim.remove_node("table")
    net.pump(0.5)
    net.network.heal()
    check_equal(net, victim, other)
    assert other.node("alone")["mass"] == 1.0 and other.edge("table_2", "alone", "on")["since"] == 1.0
    assert other.node("cube_3")["mass"] == 7.0 and other.edge("world", "cube_3", "RT").pose.t[0] == 9.0
    assert "table" not in other and victim.replica.synchroniser.new_ids == 1


def test_samples_that_are_not_durable_yet_are_kept_and_reach_everybody(net: Net) -> None:
    victim, other = net.join("victim"), net.join("other")
    tabletop(victim)
    net.pump(2.0)
    net.network.partition(["other"], ["victim", "stranger"])
    burn(net, victim)
    victim.update_edge("world", "cube_3", "RT", translation=(5.0, 0.0, 0.0), rotation=(0, 0, 0, 1), stamp=7.0)
    net.pump(0.05)
    net.network.heal()
    check_equal(net, victim, other)
    assert other.edge("world", "cube_3", "RT").pose.t[0] == 5.0
    registers = [w for e in victim.replica.graph.store.entries.values() for w in e.registers.values()]
    assert all(write.dot for write in registers)


@pytest.mark.parametrize("how", ["removed", "digest", "reply", "add", "write"])
def test_each_way_to_claim_it_is_noticed(net: Net, how: str) -> None:
    victim, other = net.join("victim"), net.join("other")
    tabletop(victim)
    net.pump(2.0)
    rid, keys, liar = victim.replica.graph.rid, victim.keys, stranger(net)
    counter = victim.replica.graph.counter
    beyond = (rid, counter + 1)
    if how == "removed":
        liar.publish(keys.delta("liar-1"), encode_delta(Delta(removed=[beyond], context=[("liar-1", 1, 1)])))
    elif how == "add":
        false = Delta(adds=[Add(beyond, "false", "cube")], context=[(*beyond, MOST)])
        liar.publish(keys.delta(rid), encode_delta(false))
    elif how == "write":
        write = Write(next(iter(victim.node("cube_3").created)), "note", 1 << 40, rid, beyond, "false")
        liar.publish(keys.delta(rid), encode_delta(Delta(writes=[write], context=[(*beyond, counter + 1)])))
    elif how == "digest":
        seen = Summary(((rid, ((1, counter + 1),)),), 0)
        liar.publish(keys.digest("liar-1"), encode_digest(Digest("liar-1", net.clock.now(), seen, 0, ())))
    else:
        reply = reply_of(Delta(context=[(rid, 1, MOST)]))
        liar.serve(keys.sync("liar-1"), lambda key, payload: reply)
        digest = Digest("liar-1", net.clock.now(), CausalContext([("ghost-1", 1, 1)]).summary(), 0, ())
        liar.publish(keys.digest("liar-1"), encode_digest(digest))
    net.pump(1.0)
    assert victim.replica.graph.rid != rid
    for number in range(3):
        victim.add_node(f"later_{number}", "cube")
    net.pump(HEAL)
    assert all(f"later_{number}" in memory for number in range(3) for memory in (victim, other))


def test_messages_in_its_name_that_claim_nothing_new_are_refused_and_change_no_id(net: Net) -> None:
    victim, other = net.join("victim"), net.join("other")
    tabletop(victim)
    net.pump(2.0)
    rid = victim.replica.graph.rid
    false = Delta(adds=[Add((rid, 1), "false", "cube")], context=[(rid, 1, 1)])
    stranger(net).publish(victim.keys.delta(rid), encode_delta(false))
    check_equal(net, victim, other)
    assert "false" not in victim and victim.dropped == {rid: 1} and victim.replica.graph.rid == rid


def test_who_was_cut_off_is_not_told_by_a_stranger_to_have_seen_what_others_have(net: Net) -> None:
    victim, other, away = net.join("victim"), net.join("other"), net.join("away")
    net.pump(2.0)
    net.network.partition(["away"], ["victim", "other", "stranger"])
    net.pump(HEAL)  # it counts as gone
    tabletop(victim)
    net.pump(2.0)
    assert victim.peers == [other.replica.graph.rid] and victim.replica.synchroniser.delivered
    before = content(victim)
    net.network.heal()
    burn(net, victim, victim.replica.graph.counter)
    check_equal(net, victim, other, away)
    assert content(away) == before


def test_a_newcomer_is_not_told_by_a_stranger_to_have_seen_what_it_has_not(net: Net) -> None:
    victim, other = net.join("victim"), net.join("other")
    tabletop(victim)
    net.pump(2.0)
    before = content(victim)
    newcomer = net.join("newcomer")
    burn(net, victim, victim.replica.graph.counter)
    check_equal(net, victim, other, newcomer)
    assert content(newcomer) == before


@pytest.mark.parametrize("said", ["again", "changed"])
def test_what_it_added_said_by_a_stranger_costs_others_no_edges(net: Net, said: str) -> None:
    """A replica that is gone may not have it; so a stranger may have told that one something else."""
    victim, other, gone = net.join("victim"), net.join("other"), net.join("gone")
    net.pump(2.0)
    net.memories.remove(gone)
    gone.close()
    tabletop(victim)
    net.pump(2.0)
    other.add_node("thing", "cube")
    other.add_edge("thing", "cube_3", "on", since=1.0)
    other.add_edge("table", "thing", "on", since=2.0)
    net.pump(2.0)
    before = content(victim)
    rid = victim.replica.graph.rid
    made = [entry for entry in victim.replica.graph.store.entries.values() if entry.dot[0] == rid]
    adds = [
        Add(one.dot, "false" if said == "changed" and isinstance(one.key, str) else one.key, one.type, one.sources,
            one.destinations)
        for one in made
    ]  # fmt: skip
    context = [(rid, 1, victim.replica.graph.counter)]
    stranger(net).publish(victim.keys.delta(rid), encode_delta(Delta(adds=adds, context=context)))
    check_equal(net, victim, other)
    assert victim.replica.synchroniser.new_ids == 1
    assert content(other) == before


def test_who_was_cut_off_is_not_forgotten_for_a_crowd_that_comes_and_goes(
    net: Net, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dsr.replication.peers.MAX_PEERS", 3)
    victim, away = net.join("victim"), net.join("away")
    net.pump(2.0)
    net.network.partition(["away"], ["victim", "stranger"])
    net.pump(HEAL)
    tabletop(victim)
    before = content(victim)
    liar, seen = stranger(net), victim.replica.graph.store.context.summary()
    for number in (*range(6), 5):  # all have seen everything, and the last one comes back
        rid = f"crowd{number}-1"
        liar.publish(victim.keys.digest(rid), encode_digest(Digest(rid, net.clock.now(), seen, 0, ())))
        net.pump(FORGET + 1.0)
    peers = victim.replica.synchroniser._peers
    assert len(peers.away) == 3 and away.rid not in peers.away
    net.network.heal()
    burn(net, victim, victim.replica.graph.counter)
    check_equal(net, victim, away)
    assert content(away) == before


def test_whoever_goes_on_in_its_name_makes_it_take_few_ids(net: Net) -> None:
    victim, other = net.join("victim"), net.join("other")
    net.pump(2.0)
    for number in range(60):
        burn(net, victim)
        victim.add_node(f"node_{number}", "cube")
        net.pump(0.5)
    assert 2 <= victim.replica.synchroniser.new_ids <= 1 + 30.0 / NEW_ID_PAUSE
    net.pump(NEW_ID_PAUSE)
    check_equal(net, victim, other)
    assert len(other.nodes("cube")) == 60


@pytest.mark.parametrize("follow", [True, False])
def test_replicas_of_worlds_take_another_id_too(net: Net, follow: bool) -> None:
    victim, other = net.join("victim"), net.join("other")
    tabletop(victim)
    net.pump(2.0)
    mine = victim.fork("dream", follow=follow)
    net.pump(2.0)
    theirs = other.world("dream")
    net.pump(2.0)
    burn(net, mine)
    mine.add_node("at_once", "cube")
    mine.update_node("cube_3", mass=3.0)
    net.pump(0.5)
    mine.add_node("later", "cube")
    net.pump(HEAL)
    assert "at_once" in theirs and "later" in theirs and theirs.node("cube_3")["mass"] == 3.0
    assert content(mine) == content(theirs) and victim.replica.synchroniser.new_ids == 0
    assert mine.replica.synchroniser.new_ids == 1


def test_an_id_that_was_claimed_before_it_was_taken_is_not_taken(net: Net) -> None:
    victim, other = net.join("victim"), net.join("other")
    net.pump(2.0)
    liar = stranger(net)
    for number in range(1, 4):
        rid = f"{victim.rid}w{number}"
        liar.publish(victim.keys.delta(rid), encode_delta(Delta(context=[(rid, 1, MOST)])))
    net.pump(2.0)
    fork = victim.fork("dream")
    fork.add_node("x", "cube")
    net.pump(2.0)
    theirs = other.world("dream")
    net.pump(2.0)
    assert "x" in fork and "x" in theirs


def test_a_kept_state_is_whole_after_another_id_was_taken(net: Net, tmp_path: Path) -> None:
    victim, other = net.join("victim"), net.join("other")
    net.pump(2.0)
    keeper = StateKeeper(victim, tmp_path / "state", threaded=False)
    tabletop(victim)
    net.pump(2.0)
    burn(net, victim)
    victim.update_edge("world", "cube_3", "RT", translation=(5.0, 0.0, 0.0), rotation=(0, 0, 0, 1), stamp=7.0)
    victim.add_node("at_once", "cube")
    net.pump(0.5)
    victim.add_node("later", "cube")
    keeper.flush()
    keeper.abandon()  # a crash: the journal is what is left
    again = Net().join("again")
    StateKeeper(again, tmp_path / "state", threaded=False)
    assert content(again) == content(victim) and "later" in again
    check_equal(net, victim, other)


def test_values_taken_away_before_it_was_noticed_stay_away(net: Net) -> None:
    victim, other = net.join("victim"), net.join("other")
    tabletop(victim)
    net.pump(2.0)
    net.network.partition(["other", "stranger"], ["victim"])
    burn(net, victim)
    victim.remove_attribute("cube_3", "mass")
    net.pump(0.2)
    net.network.heal()
    check_equal(net, victim, other)
    writes = [e.registers["mass"] for e in other.node("cube_3")._entries]
    assert {write.value for write in writes} == {TOMBSTONE} and "mass" not in other.node("cube_3")


def test_a_later_id_of_a_replica_is_the_greater_one_and_of_the_same_agent() -> None:
    first = "arm-1-5f0c12aa"
    ids = [first]
    for _ in range(5):
        ids.append(next_id(ids[-1]))
    assert ids == sorted(set(ids)) and {agent_of(rid) for rid in ids} == {"arm-1"}
    assert len({len(rid) for rid in ids[1:]}) == 1 and all(rid.startswith(first) for rid in ids)


def test_a_process_is_found_under_its_new_id() -> None:
    registration = rendezvous.Registration("g", "a-1", "tcp/127.0.0.1:1", has_memory=True)
    registration.rename("a-1r000001")
    assert [member.rid for member in rendezvous.members("g")] == ["a-1r000001"]
    registration.close()
    assert rendezvous.members("g") == []


def test_who_speaks_in_its_name_again_and_again_lets_nobody_grow(net: Net) -> None:
    """One short digest for each new id must not double what everybody holds."""
    victim, other = net.join("victim"), net.join("other")
    net.pump(2.0)
    tabletop(victim)
    net.pump(2.0)
    other.add_edge("table", "cube_3", "on", since=1.0)
    other.update_node("cube_3", mass=2.0)
    net.pump(2.0)
    before, held = content(victim), len(victim.replica.graph.store.entries)
    liar, keys = stranger(net), victim.keys
    liar.announce(keys.presence("stranger", "stranger-1"))
    for number in range(60):
        seen = CausalContext([(victim.replica.graph.rid, 1, MOST)]).summary()
        liar.publish(keys.digest("stranger-1"), encode_digest(Digest("stranger-1", net.clock.now(), seen, 0, ())))
        net.pump(1.0)
        if number == 30:
            other.add_edge("table", "world", "on", since=2.0)
            before = content(victim) | content(other)
    assert victim.statistics.new_ids >= 6
    assert len(victim.replica.graph.store.entries) <= 2 * held + 2
    assert content(victim) == before
    check_equal(net, victim, other)


@pytest.mark.parametrize("hears_of_the_second_id", [True, False])
def test_what_others_write_to_an_element_stays_after_a_second_id(net: Net, hears_of_the_second_id: bool) -> None:
    """They have seen only what it was under the first id."""
    victim, other = net.join("victim"), net.join("other")
    net.pump(2.0)
    victim.add_node("cup", "cube", mass=1.0)
    net.pump(0.05)
    liar = stranger(net)
    liar.announce(victim.keys.presence("stranger", "stranger-1"))

    def claim_all(seconds: float) -> None:
        seen = CausalContext([(victim.replica.graph.rid, 1, MOST)]).summary()
        digest = Digest("stranger-1", net.clock.now(), seen, 0, ())
        liar.publish(victim.keys.digest("stranger-1"), encode_digest(digest))
        net.pump(seconds)

    net.network.partition(["other"], ["victim", "stranger"])
    claim_all(0.2)
    other.update_node("cup", mass=7.0)
    other.add_node("spoon", "cube")
    other.add_edge("cup", "spoon", "on", since=1.0)
    if hears_of_the_second_id:
        net.network.heal()
        net.pump(HEAL)
        claim_all(NEW_ID_PAUSE + 0.5)
    else:
        net.pump(NEW_ID_PAUSE + 0.5)
        claim_all(0.2)
        net.network.heal()
    check_equal(net, victim, other)
    assert victim.statistics.new_ids == 2
    assert victim.node("cup")["mass"] == 7.0 and [edge.key for edge in victim.edges("on")] == [("cup", "spoon", "on")]
    assert len(victim.node("cup").created) <= 2


def test_what_was_to_be_told_under_the_id_before_is_not_told_under_the_next(
    net: Net, caplog: pytest.LogCaptureFixture
) -> None:
    """A thread may take another id between the making of a digest and its sending."""
    victim, other = net.join("victim"), net.join("other")
    victim.add_node("x", "cube")
    net.pump(2.0)
    now, replica = net.clock.monotonic() + 2.0, victim.replica
    (digest,) = replica.synchroniser.speak(now, net.clock.now())
    replica.take_id()
    net.pump(0.1)
    replica._perform(digest)
    check_equal(net, victim, other)
    assert not other.dropped and other.peers == [replica.graph.rid]
