"""What a sender may claim to have seen: bounded for each, at no cost that stays, and never at the cost of agreement."""

from __future__ import annotations

import pytest

from dsr import Faults, Memory
from dsr.crdt import pieces
from dsr.crdt.context import CausalContext
from dsr.crdt.delta import Add, Delta
from dsr.crdt.pieces import START
from dsr.crdt.summary import LISTED
from dsr.network.transport import Transport
from dsr.replication import claims
from dsr.replication.claims import MAX_EARLY, MAX_GAPS, MAX_NEWCOMERS
from dsr.replication.piece_wire import Request, decode_request, encode_piece, encode_request
from dsr.replication.wire import Digest, encode_delta, encode_digest
from tests.dsr.conftest import Net, reply_of

HEAL = 5.0


class Liar:
    """A peer without a graph, that sends what it likes and counts what it is asked."""

    def __init__(self, net: Net, rid: str = "liar-1") -> None:
        self.net, self.rid = net, rid
        self.transport: Transport = net.network.connect(rid)
        self.keys = net.memories[0].keys
        self.reply: Delta | None = None
        self.asked = 0
        self.transport.serve(self.keys.sync(rid), self._answer)
        self.transport.announce(self.keys.presence("liar", rid))

    def _answer(self, _key: str, payload: bytes) -> bytes | None:
        decode_request(payload)
        self.asked += 1
        return None if self.reply is None else reply_of(self.reply)

    def send(self, delta: Delta, rid: str | None = None) -> None:
        self.transport.publish(self.keys.delta(rid or self.rid), encode_delta(delta))

    def digest(self, context: CausalContext, fingerprint: int = 0) -> None:
        payload = encode_digest(Digest(self.rid, self.net.clock.now(), context.summary(), fingerprint, ()))
        self.transport.publish(self.keys.digest(self.rid), payload)


def seen(memory: Memory) -> CausalContext:
    return memory.replica.graph.store.context


def digest_size(memory: Memory) -> int:
    return len(memory.replica.synchroniser.digest(0.0))


def check_equal(net: Net, *memories: Memory) -> None:
    net.pump(HEAL)
    for memory in memories[1:]:
        assert seen(memory) == seen(memories[0])
        graphs = [m.replica.graph for m in (memories[0], memory)]
        assert graphs[0].store.fingerprint == graphs[1].store.fingerprint
        assert {n: dict(v) for n, v in graphs[0].nodes.items()} == {n: dict(v) for n, v in graphs[1].nodes.items()}


def test_a_delta_accounts_for_its_senders_dots_alone(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    a.add_node("x", "cube")
    net.pump(2.0)
    liar = Liar(net)
    before = list(seen(a).ranges())
    liar.send(Delta(context=[(f"ghost-{number}", 1, 1) for number in range(5000)]))
    liar.send(Delta(adds=[Add(("ghost-1", 1), "y", "cube")], context=[("ghost-1", 1, 1)]))
    liar.send(Delta(adds=[Add(("ghost-1", 1), "y", "cube")]))
    net.pump(2.0)
    assert list(seen(a).ranges()) == list(seen(b).ranges()) == before and a.dropped == {"liar-1": 3}


@pytest.mark.parametrize("counter", [1, 7])
def test_removals_of_what_never_was_are_few_and_the_others_leave_a_hole(net: Net, counter: int) -> None:
    a, b = net.join("a"), net.join("b")
    a.add_node("x", "cube")
    net.pump(2.0)
    liar = Liar(net)
    for number in range(20):
        dots = [(f"ghost-{number * 1000 + n}", counter) for n in range(1000)]
        liar.send(Delta(removed=dots, context=[("liar-1", number + 1, number + 1)]))
    net.pump(HEAL)
    assert seen(a).size <= MAX_EARLY + 10 and a.replica.synchroniser.claims.passed_over >= 19
    assert digest_size(a) < 4000
    a.remove_node("x")  # what has arrived is removed all the same
    check_equal(net, a, b)


def test_a_removal_that_came_first_counts_no_more_once_what_it_removed_has_come(net: Net) -> None:
    a, liar = net.join("a"), Liar(net)
    other = Liar(net, "other-1")
    for number in range(1, 3 * MAX_EARLY):
        liar.send(Delta(removed=[("other-1", number)], context=[("liar-1", number, number)]))
        other.send(Delta(adds=[Add(("other-1", number), "x", "cube")], context=[("other-1", number, number)]))
    net.pump(0.1)
    assert a.replica.synchroniser.claims.passed_over == 0 and "x" not in a and not seen(a).gaps("liar-1")


def test_a_removal_that_came_first_counts_no_more_once_a_reply_has_accounted_for_what_it_removed(net: Net) -> None:
    a, liar = net.join("a"), Liar(net)
    other = Liar(net, "other-1")
    for begin in (0, MAX_EARLY):
        numbers = range(begin + 1, begin + MAX_EARLY + 1)
        dots = [("other-1", number) for number in numbers]
        liar.send(Delta(removed=dots, context=[("liar-1", 1 + begin, 1 + begin)]))
        made = [("other-1", 1, numbers[-1])]
        other.reply = Delta(context=made)
        other.digest(CausalContext(made))
        net.pump(2.0)
    assert other.asked > 0
    assert a.replica.synchroniser.claims.passed_over == 0


def test_a_removal_that_came_first_and_was_passed_over_is_brought_by_the_repair(
    net: Net, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(claims, "MAX_EARLY", 0)
    a, b, c = net.join("a"), net.join("b"), net.join("c")
    net.pump(2.0)
    net.network.partition(["a", "b"], ["c"])
    a.add_node("x", "cube")
    net.pump(2.0)
    net.network.partition(["b", "c"], ["a"])
    b.remove_node("x")
    b.add_node("y", "cube")
    net.pump(0.05)
    net.network.heal()
    check_equal(net, a, b, c)
    assert "x" not in c and "y" in c


def test_gaps_among_a_senders_own_counters_are_bounded(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    net.pump(2.0)
    liar = Liar(net)
    liar.send(Delta(context=[("liar-1", 2 * number, 2 * number) for number in range(1, 60_001)]))
    for number in range(1, 2 * MAX_GAPS):
        add = Add(("liar-1", 3 * number), f"n{number}", "cube")
        liar.send(Delta(adds=[add], context=[] if number % 2 else [("liar-1", 3 * number, 3 * number)]))
    net.pump(1.0)
    assert seen(a).gaps("liar-1") == seen(b).gaps("liar-1") == MAX_GAPS
    assert len(a.nodes()) == MAX_GAPS and digest_size(a) < 4000
    liar.send(Delta(context=[("liar-1", 1, 6 * MAX_GAPS)]))  # and they close as ever
    net.pump(1.0)
    assert seen(a).gaps("liar-1") == 0


def test_gaps_are_bounded_while_answers_come_too(net: Net) -> None:
    """Much is asked for where messages are lost, and an answer tells nothing of what only the liar claims."""
    a, b = net.join("a"), net.join("b")
    net.pump(2.0)
    liar, number = Liar(net), 0
    for _ in range(100):
        for _ in range(50):
            number += 1
            liar.send(Delta(context=[("liar-1", 2 * number, 2 * number)]))
        net.pump(0.05, Faults(loss=0.1, delay=(0.1, 0.4)))
    net.pump(5.0)
    assert max(seen(memory).gaps("liar-1") for memory in (a, b)) <= 1.1 * MAX_GAPS
    assert a.statistics.repairs + b.statistics.repairs > 0, "nothing was asked for, so this shows nothing"


def test_newcomers_are_taken_in_at_a_bounded_pace_and_nothing_of_honest_ones_is_lost(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    net.pump(2.0)
    liar = Liar(net)
    for number in range(3 * MAX_NEWCOMERS):
        liar.send(Delta(context=[(f"ghost-{number}", 1, 1)]), f"ghost-{number}")
    net.pump(0.1)
    assert seen(a).size <= MAX_NEWCOMERS and digest_size(a) < 4000
    late = net.join("late")
    late.add_node("x", "cube")
    net.pump(3.0)
    assert "x" in a and "x" in b
    check_equal(net, a, b, late)


def test_a_reply_with_gaps_among_the_repliers_own_counters_is_refused(net: Net) -> None:
    a, _ = net.join("a"), net.join("b")
    net.pump(2.0)
    before = seen(a).size
    for name, context in {"own": [("own-1", 1, 1), ("own-1", 3, 3)], "late": [("late-1", 3, 3)]}.items():
        a.replica.synchroniser.receive_reply(f"{name}-1", 0, reply_of(Delta(context=context)), 0.0)
        assert a.dropped[f"{name}-1"] == 1
    assert seen(a).size == before


def test_of_gaps_among_the_counters_of_others_a_reply_brings_a_bounded_number(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    net.pump(2.0)
    liar = Liar(net)
    ghosts = [("ghost-1", 2 * number, 2 * number) for number in range(1, 20_000)]
    liar.reply = Delta(context=ghosts)
    for _ in range(20):
        liar.digest(CausalContext(ghosts))
        net.pump(1.0)
    assert MAX_GAPS <= seen(a).gaps("ghost-1") <= MAX_GAPS + 1 and digest_size(a) < 4000
    a.add_node("x", "cube")
    check_equal(net, a, b)


def test_who_was_left_in_the_middle_of_an_answer_gives_up_no_gap(net: Net, monkeypatch: pytest.MonkeyPatch) -> None:
    """The pieces that are missing hold what somebody else may bring, whoever answers next."""
    monkeypatch.setattr(claims, "MAX_GAPS", 5)
    monkeypatch.setattr(pieces, "MAX_EXAMINED", 20)
    a, c = net.join("a"), net.join("c")
    net.pump(2.0)
    net.network.partition(["a"], ["c"])
    for number in range(60):
        a.add_node(f"n{number}", "cube", mass=1.0)
        a.update_node(f"n{number}", mass=2.0)  # the dot of the first value is a gap until the last piece came
    net.pump(2.0)
    b = net.join("b")
    net.network.partition(["a", "b"], ["c"])
    while len(b.nodes()) < 20:
        net.pump(0.05)
    assert len(b.nodes()) < 60 and seen(b).gaps(a.rid) > 5
    net.network.partition(["b", "c"], ["a"])
    net.pump(15.0)
    c.add_node("other", "cube")
    net.pump(15.0)
    net.network.heal()
    net.pump(15.0)
    check_equal(net, a, b, c)
    assert len(b.nodes()) == len(c.nodes()) == 61


def test_what_was_lost_while_an_answer_came_is_no_gap_that_is_given_up(
    net: Net, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The replier has told nothing of it yet. What a newcomer gave up would be removed everywhere."""
    monkeypatch.setattr(claims, "MAX_GAPS", 5)
    monkeypatch.setattr(pieces, "MAX_EXAMINED", 5)
    holder, writer = net.join("holder", rid="z-holder"), net.join("writer", rid="a-writer")
    net.pump(2.0)
    for number in range(120):
        holder.add_node(f"n{number}", "cube")
    writer.add_node("first", "cube")
    net.pump(2.0)
    newcomer = net.join("newcomer")
    while len(newcomer.nodes()) < 20:
        net.pump(0.05)
    net.network.partition(["writer", "holder"], ["newcomer", "holder"])
    writer.add_node("x", "cube")
    net.pump(0.05)
    net.network.heal()
    for number in range(10):  # each removal is a dot that a newcomer does not believe to have seen
        writer.add_node(f"short_{number}", "cube")
        writer.remove_node(f"short_{number}")
        net.pump(0.05)
    assert not newcomer.joined and "x" not in newcomer and seen(newcomer).gaps("a-writer") > 5
    net.pump(15.0)
    check_equal(net, writer, holder, newcomer)
    assert "x" in newcomer and len(newcomer.nodes()) == 122


def test_replicas_of_which_nothing_is_left_are_taken_over_up_to_a_bound(
    net: Net, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(claims, "MAX_REPLICAS", 50)
    a = net.join("a")
    a.replica.synchroniser.nobody_there()
    liar = Liar(net)
    ghosts = [(f"ghost-{number:05}", 1, 9) for number in range(1000)]
    liar.reply = Delta(adds=[Add(("maker-1", 1), "x", "cube")], context=[*ghosts, ("maker-1", 1, 1)])
    liar.reply.live = frozenset([("maker-1", 1)])
    for _ in range(20):
        liar.digest(CausalContext(ghosts))
        net.pump(1.0)
    assert "x" in a and seen(a).size == 50
    b = net.join("b")
    b.add_node("y", "cube")
    net.pump(HEAL)
    assert "x" in b and "y" in a and abs(seen(b).size - 50) < 3
    requests = sum(peer.asked for memory in (a, b) for peer in memory.replica.synchroniser._peers.values())
    net.pump(60.0)  # what is left is no reason to ask one another for ever
    later = sum(peer.asked for memory in (a, b) for peer in memory.replica.synchroniser._peers.values())
    assert later - requests < 12


def test_a_reply_brings_many_replicas_of_which_nothing_is_left_by_and_by(
    net: Net, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(claims, "MAX_STRANGERS", 10)
    a, b = net.join("a"), net.join("b")
    net.pump(2.0)
    for number in range(50):
        seen(b).add_range(f"old-{number}", 1, 3)
    net.pump(2.0)
    assert 10 <= seen(a).size < 50
    net.pump(8.0)
    check_equal(net, a, b)
    newcomer = net.join("late")
    net.pump(1.0)
    assert newcomer.joined
    assert seen(newcomer).size == 50, "a newcomer gets all at once"


def test_what_is_refused_is_asked_for_ever_more_rarely(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    net.pump(2.0)
    liar = Liar(net)
    liar.reply = Delta(context=[("liar-1", 2, 2)])
    for _ in range(120):
        liar.digest(CausalContext([("ghost-1", 2, 2)]))
        net.pump(1.0)
    assert 4 <= liar.asked <= 2 * 12  # two replicas; once a digest would be 240
    a.add_node("x", "cube")
    check_equal(net, a, b)


def test_two_replicas_that_lack_different_messages_of_a_dead_one_agree(
    net: Net, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(claims, "MAX_GAPS", 10)
    a, b = net.join("a"), net.join("b")
    net.pump(2.0)
    liar = Liar(net, "dead-1")
    net.network.partition(["a", "dead-1"], ["b"])
    for number in range(10):
        dot = ("dead-1", 4 * number + 2)
        liar.send(Delta(adds=[Add(dot, f"a{number}", "cube")], context=[(*dot, dot[1])]))
    net.pump(0.1)
    net.network.partition(["b", "dead-1"], ["a"])
    for number in range(10):
        dot = ("dead-1", 4 * number + 4)
        liar.send(Delta(adds=[Add(dot, f"b{number}", "cube")], context=[(*dot, dot[1])]))
    net.pump(0.1)
    liar.transport.close()
    net.network.heal()
    check_equal(net, a, b)
    assert seen(a).gaps("dead-1") <= 10 and len(a.nodes()) == 20


def test_digests_cost_the_same_whatever_the_history(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    a.add_node("x", "cube")
    net.pump(2.0)
    few = digest_size(a)
    for memory in (a, b):
        for number in range(2000):
            seen(memory).add_range(f"old-{number}", 1, 1 << 30)
        for number in range(1, MAX_GAPS):
            seen(memory).add_range("holed-1", 3 * number, 3 * number)
    assert digest_size(a) < few + 40 * LISTED
    repairs, asked = a.statistics.repairs, [peer.asked for peer in a.replica.synchroniser._peers.values()]
    a.add_node("y", "cube")
    net.pump(5.0)
    assert "y" in b and a.statistics.repairs == repairs
    assert [peer.asked for peer in a.replica.synchroniser._peers.values()] == asked


def test_who_lacks_nothing_gets_next_to_nothing(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    for number in range(100):
        a.add_node(f"n{number}", "cube")
    net.pump(2.0)
    request = encode_request(Request(b.rid, seen(b), START))
    answer = a.replica.synchroniser.answer("b-1", request)
    assert answer is not None and len(encode_piece(answer)) < 40
    before = b.statistics.repairs
    b.replica.synchroniser.receive_reply(a.rid, 0, encode_piece(answer), 0.0)
    assert len(b.nodes()) == 100 and b.statistics.repairs == before
