"""What a message costs follows its length, whatever it says: nobody can have one message stop all others."""

from __future__ import annotations

import time
from collections.abc import Callable

import msgspec
import pytest

from dsr import Memory, Pose
from dsr.crdt.context import CausalContext, DotRange, apart, without
from dsr.crdt.delta import MAX_ENDS, Add, Delta, Write
from dsr.crdt.dots import OrderedDots
from dsr.crdt.store import MAX_MADE, Incarnation
from dsr.crdt.summary import Summary
from dsr.errors import WireError
from dsr.graph.elements import Edge, Node
from dsr.graph.graph import Graph
from dsr.replication.piece_wire import decode_request
from dsr.replication.sync import Synchroniser
from dsr.replication.wire import Digest, decode_delta, encode_delta, encode_digest
from dsr.security.gate import Gate
from dsr.security.policy import Grant, checked
from dsr.worlds.overlay import Overlay
from tests.dsr.conftest import Net

LIAR = "liar-1"
COUNT = 3000
FACTOR = 40.0
"""By how much a change may cost more than the addition of a node; what was squared cost it a thousand times."""


def cost(action: Callable[[], object]) -> float:
    """Processor time, s: others on this machine do not count."""
    begin = time.process_time()
    action()
    return time.process_time() - begin


def additions(count: int, name: Callable[[int], str] = "n{}".format, first: int = 1) -> Delta:
    adds = [Add((LIAR, first + number), name(number), "cube") for number in range(count)]
    return Delta(adds=adds, context=[(LIAR, first, first + count - 1)])


@pytest.fixture
def alone() -> float:
    """What `cost_to_others` is in a graph where nobody else is, s."""
    synchroniser = Synchroniser(Graph("me-1"), joined=True)
    return min(cost_to_others(synchroniser, agent) for agent in OTHERS)


@pytest.fixture
def fair() -> float:
    """Processor time of the addition of `COUNT` nodes, s."""
    return cost(lambda: sent(Synchroniser(Graph("me-1"), joined=True), additions(COUNT)))


def cost_to_others(synchroniser: Synchroniser, agent: str) -> float:
    """Processor time of `COUNT / 30` nodes that another agent adds, each in a message of its own, s."""

    def others() -> None:
        for number in range(1, COUNT // 30 + 1):
            delta = Delta(adds=[Add((agent, number), f"{agent}-{number}", "cube")], context=[(agent, number, number)])
            sent(synchroniser, delta, agent)

    return cost(others)


OTHERS = ("other-1", "other-2", "other-3")


def sent(synchroniser: Synchroniser, delta: Delta, sender: str = LIAR) -> None:
    synchroniser.receive_delta(sender, encode_delta(delta), 0.0)
    assert not synchroniser.dropped


def test_one_node_made_many_times_in_one_message(fair: float) -> None:
    synchroniser = Synchroniser(Graph("me-1"), joined=True)
    many = additions(COUNT, lambda number: "n")
    assert cost(lambda: sent(synchroniser, many)) < FACTOR * fair
    assert len(synchroniser.graph.nodes["n"].created) == MAX_MADE
    gone = Delta(removed=[add.dot for add in many.adds], context=[(LIAR, COUNT + 1, COUNT + 1)])
    assert cost(lambda: sent(synchroniser, gone)) < FACTOR * fair
    assert not synchroniser.graph.nodes and not synchroniser.graph.store.entries


def test_one_node_made_by_many_in_a_message_each(fair: float) -> None:
    graph, makers = Graph("me-1"), [f"liar{number}-1" for number in range(COUNT // 3)]

    def make() -> None:
        for maker in makers:
            graph.join(Delta([Add((maker, 1), "n", "cube")], context=[(maker, 1, 1)]), 0.0)

    assert cost(make) < FACTOR * fair
    assert len(graph.nodes["n"].created) == len(makers)


def test_many_nodes_made_under_dots_of_others_in_one_message(fair: float) -> None:
    synchroniser = Synchroniser(Graph("me-1"), joined=True)
    many = 4 * COUNT
    sent(synchroniser, additions(many))
    assert cost(lambda: sent(synchroniser, additions(many, "other{}".format))) < FACTOR * fair
    assert not synchroniser.graph.nodes


def test_one_edge_made_many_times_in_one_message(fair: float) -> None:
    synchroniser = Synchroniser(Graph("me-1"), joined=True)
    sent(synchroniser, additions(1))
    end = ((LIAR, 1),)
    adds = [Add((LIAR, number + 2), ("n0", "n0", "on"), "on", end, end) for number in range(COUNT)]
    many = Delta(adds=adds, context=[(LIAR, 2, COUNT + 1)])
    assert cost(lambda: sent(synchroniser, many)) < FACTOR * fair
    assert list(synchroniser.graph.edges) == [("n0", "n0", "on")]
    gone = Delta(removed=[add.dot for add in adds], context=[(LIAR, COUNT + 2, COUNT + 2)])
    assert cost(lambda: sent(synchroniser, gone)) < FACTOR * fair
    assert not synchroniser.graph.edges and not synchroniser.graph.incident


@pytest.mark.parametrize("taken", [False, True])
def test_a_node_with_many_attributes_that_is_made_again(net: Net, fair: float, taken: bool) -> None:
    """A message of 30 bytes kept all writers waiting for 0.6 s, and for 1.5 s where an overlay says something of it."""
    memory: Memory = net.join("me")
    overlay = memory.fork("dream", follow=True)
    synchroniser, count = memory.replica.synchroniser, 10 * COUNT
    writes = [Write((LIAR, 1), f"a{number}", 1, LIAR, (LIAR, number + 2), 0) for number in range(count)]
    sent(synchroniser, Delta([Add((LIAR, 1), "n", "cube")], writes, context=[(LIAR, 1, count + 1)]))
    if taken:
        overlay.update_node("n", mass=1.0)

    def again() -> None:
        for rid in (f"{agent}-{number}" for agent in ("a", "z") for number in range(2 * MAX_MADE)):
            delta = Delta([Add((rid, 1), "n", "cube")], [Write((rid, 1), "mass", 9, rid, (rid, 2), 2.0)])
            sent(synchroniser, Delta(delta.adds, delta.writes, context=[(rid, 1, 2)]), rid)

    assert cost(again) < FACTOR / 4 * fair
    assert memory.node("n")["mass"] == 2.0 and overlay.node("n")["mass"] == (1.0 if taken else 2.0)
    assert memory.node("n")["a0"] == overlay.node("n")["a0"] == 0


def test_a_node_with_many_edges_that_is_made_again(fair: float) -> None:
    synchroniser = Synchroniser(Graph("me-1"), joined=True)
    sent(synchroniser, additions(1))
    end = ((LIAR, 1),)
    edges = [Add((LIAR, number + 2), ("n0", "n0", f"t{number}"), f"t{number}", end, end) for number in range(COUNT)]
    sent(synchroniser, Delta(adds=edges, context=[(LIAR, 2, COUNT + 1)]))

    def again(count: int, first: int) -> None:
        for number in range(count):
            sent(synchroniser, additions(1, first=first + number))

    assert cost(lambda: again(MAX_MADE - 1, COUNT + 2)) < FACTOR / 4 * fair
    assert len(synchroniser.graph.edges) == COUNT
    assert cost(lambda: again(50, 2 * COUNT)) < FACTOR / 4 * fair
    assert not synchroniser.graph.edges, "they hang from the oldest of too many"


def test_digests_have_edges_whose_ends_never_come_looked_at_no_oftener_than_once_a_second() -> None:
    """Of 30 bytes each cost 25 ms, with all writers waiting."""
    synchroniser, looks = Synchroniser(Graph("me-1"), joined=True), 0
    sent(synchroniser, additions(1))
    nobody, ends = (("nobody-1", 7),), ((LIAR, 1),)
    edges = [Add((LIAR, number), ("x", "n0", f"t{number}"), f"t{number}", nobody, ends) for number in range(2, 1002)]
    sent(synchroniser, Delta(edges, context=[(LIAR, 2, 1001)]))
    graph, settle = synchroniser.graph, synchroniser.graph._settle

    def counted(entry: Incarnation) -> None:
        nonlocal looks
        looks += 1
        settle(entry)

    graph._settle = counted  # type: ignore[method-assign]
    for number in range(20):
        seen = Summary((), graph.store.context.hash)
        digest = encode_digest(Digest(LIAR, 0.0, seen, 7 + number, ()))
        synchroniser.receive_digest(LIAR, digest, number / 10, 0.0)
        synchroniser.tick(number / 10 + 0.05, 0.0)
    assert 1 <= looks <= 5 * len(edges)


def test_edges_whose_ends_never_come_cost_others_nothing(alone: float) -> None:
    synchroniser = Synchroniser(Graph("me-1"), joined=True)
    nowhere = (("nobody-1", 7),)
    adds = [Add((LIAR, number + 1), ("a", f"b{number}", "on"), "on", nowhere, nowhere) for number in range(5 * COUNT)]
    sent(synchroniser, Delta(adds=adds, context=[(LIAR, 1, 5 * COUNT)]))

    assert min(cost_to_others(synchroniser, agent) for agent in OTHERS) < FACTOR * alone
    sent(synchroniser, Delta(context=[("nobody-1", 1, 9)]), "nobody-1")  # nothing of nobody's is left
    synchroniser.make_durable()
    assert not synchroniser.graph._unattached and len(synchroniser.graph.store.entries) == 3 * (COUNT // 30)


def test_edges_that_name_many_ends_cost_others_nothing(alone: float) -> None:
    synchroniser = Synchroniser(Graph("me-1"), joined=True)
    nowhere = tuple(("nobody-1", number + 1) for number in range(100)) * (MAX_ENDS // 100)
    for first in (1, 151):
        adds = [Add((LIAR, first + n), ("a", f"b{first + n}", "on"), "on", nowhere, nowhere) for n in range(150)]
        sent(synchroniser, Delta(adds=adds, context=[(LIAR, first, first + 149)]))

    assert min(cost_to_others(synchroniser, agent) for agent in OTHERS) < FACTOR * alone
    assert min(cost(synchroniser.make_durable) for _ in range(3)) < FACTOR * alone
    sent(synchroniser, Delta(context=[("nobody-1", 1, 100)]), "nobody-1")  # nothing of nobody's is left
    for _ in range(30):
        synchroniser.make_durable()
    assert not synchroniser.graph._unattached and len(synchroniser.graph.store.entries) == 3 * (COUNT // 30)


def test_a_chain_of_frames_is_read_as_fast_as_many_frames() -> None:
    def chain(length: int, hangs_from: Callable[[int], int]) -> float:
        memory: Memory = Net().join("me")
        synchroniser = memory.replica.synchroniser
        synchroniser.nobody_there()
        memory.add_node("world", "world")
        memory.add_edge("world", memory.add_node("box", "cube").name, "RT", pose=Pose())
        memory.transform("world", "box")  # somebody looks at frames
        sent(synchroniser, additions(length))
        edges, writes = [], []
        for number in range(1, length):
            dot, above = (LIAR, length + 2 * number), hangs_from(number)
            key = (f"n{above}", f"n{number}", "RT")
            edges.append(Add(dot, key, "RT", ((LIAR, above + 1),), ((LIAR, number + 1),)))
            writes.append(Write(dot, "pose", 1, LIAR, (LIAR, dot[1] + 1), Pose((1, 0, 0))))
        delta = Delta(edges, writes, context=[(LIAR, length + 1, 3 * length)])
        taken = cost(lambda: sent(synchroniser, delta))
        assert len(memory.edges("RT")) == length
        return taken

    beside = min(chain(COUNT, lambda number: 0) for _ in range(2))
    in_a_row = min(chain(COUNT, lambda number: number - 1) for _ in range(2))
    assert in_a_row < 4 * beside  # what was squared took fifty times as long


def test_many_small_ranges_of_one_reply_are_looked_at_once_each() -> None:
    def looking(spans: int) -> float:
        dots = OrderedDots((LIAR, (number + 1000) << 10) for number in range(spans))
        return cost(lambda: [list(dots.between(LIAR, 2 * n + 1, 2 * n + 1)) for n in range(10 * COUNT)])

    few = min(looking(1) for _ in range(3))
    assert min(looking(COUNT // 3) for _ in range(3)) < 4 * few  # 50 times as long before
    crowded = OrderedDots((LIAR, number) for number in range(1, 1 << 10))
    late = min(cost(lambda: [list(crowded.between(LIAR, 1023, 1023)) for _ in range(10 * COUNT)]) for _ in range(3))
    assert late < 4 * few


def test_a_digest_that_differs_finds_no_edge_that_should_be_gone() -> None:
    synchroniser = Synchroniser(Graph("me-1"), joined=True)
    nowhere = (("nobody-1", 7),)
    adds = [Add((LIAR, number + 1), ("a", f"b{number}", "on"), "on", nowhere, nowhere) for number in range(300)]
    sent(synchroniser, Delta(adds=adds, context=[(LIAR, 1, 300)]))
    sent(synchroniser, Delta(context=[("nobody-1", 1, 9)]), "nobody-1")
    assert synchroniser.graph._unattached, "nothing waits, so this shows nothing"
    peer = Synchroniser(Graph("peer-1"), joined=True)
    for delta, sender in ((Delta(context=[(LIAR, 1, 300)]), LIAR), (Delta(context=[("nobody-1", 1, 9)]), "nobody-1")):
        sent(peer, delta, sender)
    synchroniser.receive_digest("peer-1", peer.digest(0.0), 0.0, 0.0)
    assert not list(synchroniser.lacking.have_more(1.0))
    assert not synchroniser.graph.store.entries


def test_ends_of_edges_are_few() -> None:
    many = tuple(("nobody-1", number + 1) for number in range(2 * MAX_ENDS + 1))
    for ends in ((many, many[:1]), (many[:1], many)):
        with pytest.raises(WireError):
            decode_delta(encode_delta(Delta(adds=[Add((LIAR, 1), ("a", "b", "on"), "on", *ends)])))


def test_edges_at_a_node_made_too_often_are_bound_to_the_newest() -> None:
    graph = Graph("me-1")
    dots = [(f"liar{MAX_ENDS + number}-1", 1) for number in range(2 * MAX_ENDS + 10)]
    adds = [Add(dot, "n", "cube") for dot in sorted(dots)]
    graph.join(Delta(adds=adds, context=[(rid, 1, 1) for rid, _ in dots]), 0.0)
    made = graph.add_edge("n", "n", "on", {}, 0.0)
    assert made.adds[0].sources == tuple(sorted(dots)[-MAX_ENDS:])
    assert decode_delta(encode_delta(made)).adds == made.adds


def test_writes_to_nothing_between_gaps_cost_the_gate_nothing(fair: float) -> None:
    gate = Gate(checked({"liar": Grant(("cube",), (), ("seen",))}))
    synchroniser = Synchroniser(Graph("me-1"), gate)
    count = 3 * COUNT
    writes = [Write((LIAR, 10**6 + number), "seen", 1, LIAR, (LIAR, 2 * number + 1), 0) for number in range(count)]
    delta = Delta(writes=writes, context=[(LIAR, 2 * number + 1, 2 * number + 1) for number in range(2 * count)])
    assert cost(lambda: sent(synchroniser, delta)) < FACTOR * fair


def test_ranges_in_any_order_are_read_as_fast() -> None:
    ranges = [(LIAR, 2 * number + 1, 2 * number + 1) for number in range(20 * COUNT)]
    ordered, turned = (msgspec.msgpack.encode((1, "a", each, ("", 0, ""), False)) for each in (ranges, ranges[::-1]))
    best = min(cost(lambda: decode_request(ordered)) for _ in range(3))
    assert min(cost(lambda: decode_request(turned)) for _ in range(3)) < 3 * best
    assert decode_request(turned).seen == CausalContext(ranges)


def test_what_was_seen_is_told_once() -> None:
    delta = Delta(context=[(LIAR, 1, 10**9)] * 3 + [("other-1", 4, 5), (LIAR, 7, 8)])
    assert sorted(decode_delta(encode_delta(delta)).context) == [(LIAR, 1, 10**9), ("other-1", 4, 5)]


def test_ranges_that_are_apart_stay() -> None:
    ranges: list[DotRange] = [("b-1", 1, 3), ("a-1", 1, 1), ("b-1", 5, 9), ("a-1", 3, 3)]
    assert apart(ranges) is ranges
    assert apart([("a-1", 3, 4), ("a-1", 1, 2)]) == [("a-1", 1, 4)]


def test_dots_are_taken_out_of_ranges() -> None:
    ranges: list[DotRange] = [("a-1", 1, 5), ("b-1", 2, 2), ("a-1", 8, 9)]
    dots = [("a-1", 9), ("a-1", 1), ("a-1", 3), ("b-1", 2), ("c-1", 1), ("a-1", 3)]
    assert list(without(ranges, dots)) == [("a-1", 2, 2), ("a-1", 4, 5), ("a-1", 8, 8)]


def test_an_overlay_looks_at_each_dot_once(net: Net, fair: float) -> None:
    memory: Memory = net.join("me")
    overlay = memory.fork("dream", follow=True)
    base, layer = memory.replica.synchroniser, overlay.replica.synchroniser
    count = 900
    sent(base, additions(count))
    known = memory.add_node("known", "cube").created
    hiding = Delta(removed=list(known) * 40 * count, context=[(LIAR, 1, count)])
    assert cost(lambda: sent(layer, hiding)) < FACTOR * fair
    assert not overlay.nodes("cube") and len(memory.nodes("cube")) == count + 1
    wide = Delta(context=[(LIAR, 10**6 * number, 10**6 * number + 998) for number in range(1, 900)])
    assert cost(lambda: sent(layer, wide)) < FACTOR * fair / 10


def test_what_an_overlay_is_told_to_be_seen_costs_nothing_for_each_element_of_its_parent(
    net: Net, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A message of 30 bytes had all that the parent shows looked at."""
    memory: Memory = net.join("me")
    overlay = memory.fork("dream", follow=True)
    sent(memory.replica.synchroniser, additions(300))
    looks, concerns = 0, Overlay._concerns

    def counted(self: Overlay, element: Node | Edge) -> bool:
        nonlocal looks
        looks += 1
        return concerns(self, element)

    monkeypatch.setattr(Overlay, "_concerns", counted)
    wide = Delta(context=[("other-1", 1, 10_000)])
    sent(overlay.replica.synchroniser, wide, "other-1")
    overlay.replica.graph.join(Delta(context=[("other-1", 1, 20_000)], live=frozenset(), examined=[]), 0.0)
    assert looks == 0 and len(overlay.nodes()) == 300
    overlay.replica.graph.join(Delta(context=[(LIAR, 11, 10_000)], live=frozenset(), examined=[]), 0.0)
    assert len(overlay.nodes()) == 10, "an answer may hide what nobody removes"


def test_an_overlay_that_hides_nothing_of_a_node_looks_at_no_edge_for_another_incarnation(
    net: Net, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A message of 30 bytes cost 2.4 us for each edge at the node, in each overlay."""
    memory: Memory = net.join("me")
    memory.add_node("hub", "cube")
    memory.add_node("other", "cube")
    ends = [tuple(memory.node(name).created) for name in ("hub", "other")]
    edges = [Add((LIAR, number + 1), ("hub", "other", f"t{number}"), f"t{number}", *ends) for number in range(300)]
    sent(memory.replica.synchroniser, Delta(edges, context=[(LIAR, 1, 300)]))
    overlay, looks = memory.fork("dream", follow=True), 0
    shows_ends = Overlay._shows_ends

    def counted(self: Overlay, entry: Incarnation) -> bool:
        nonlocal looks
        looks += 1
        return shows_ends(self, entry)

    monkeypatch.setattr(Overlay, "_shows_ends", counted)
    for number in range(4):
        sent(memory.replica.synchroniser, Delta([Add((f"b{number}-1", 1), "hub", "cube")]), f"b{number}-1")
    sent(memory.replica.synchroniser, Delta(removed=[("b0-1", 1)], context=[("b0-1", 1, 2)]), "b0-1")
    assert looks < 100 and len(overlay.edges()) == len(memory.edges()) == 300
    overlay.remove_node("hub")
    assert not overlay.edges() and len(memory.edges()) == 300
    sent(memory.replica.synchroniser, Delta([Add(("c-1", 1), "hub", "cube")]), "c-1")
    assert "hub" in overlay and not overlay.edges()


def test_edges_that_an_overlay_has_taken_cost_nothing_for_each_edge_of_its_parent(net: Net, fair: float) -> None:
    """Each one that was looked at again had two tables of the whole parent compared."""
    memory: Memory = net.join("me")
    memory.add_node("hub", "cube")
    synchroniser, hub = memory.replica.synchroniser, tuple(memory.node("hub").created)
    sent(synchroniser, additions(COUNT))
    edges = [Add((LIAR, COUNT + n + 1), ("hub", f"n{n}", "on"), "on", hub, ((LIAR, n + 1),)) for n in range(COUNT)]
    sent(synchroniser, Delta(edges, context=[(LIAR, COUNT + 1, 2 * COUNT)]))
    overlay, taken = memory.fork("dream", follow=True), range(30)
    for number in taken:
        overlay.update_edge("hub", f"n{number}", "on", source="me")

    def again() -> None:
        for number in taken:
            sent(synchroniser, Delta([Add((f"b{number}-1", 1), "hub", "cube")]), f"b{number}-1")

    assert cost(again) < FACTOR / 4 * fair  # eight times that before
    overlay.remove_edge("hub", "n0", "on")
    assert len(overlay.edges("on")) == len(overlay.edges(src="hub")) == COUNT - 1 and len(memory.edges("on")) == COUNT
    assert not overlay.edges(dst="n0") and [edge.src for edge in overlay.edges(dst="n1")] == ["hub"]


def test_types_that_are_gone_leave_no_trace(net: Net) -> None:
    memory: Memory = net.join("me")
    synchroniser = memory.replica.synchroniser
    adds = [Add((LIAR, number + 1), f"n{number}", f"type {number}") for number in range(100)]
    sent(synchroniser, Delta(adds=adds, context=[(LIAR, 1, 100)]))
    other = [Add((LIAR, number + 101), f"n{number}", f"other {number}") for number in range(100)]
    sent(synchroniser, Delta(adds=other, context=[(LIAR, 101, 200)]))
    removed = [add.dot for add in adds + other]
    sent(synchroniser, Delta(removed=removed, context=[(LIAR, 201, 201)]))
    assert not synchroniser.graph.nodes_by_type
