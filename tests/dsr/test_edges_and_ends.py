"""Edges and their ends, whichever comes first: seen at once when both are there, and gone as soon as that is known."""

from __future__ import annotations

from dsr.crdt.context import CausalContext
from dsr.crdt.delta import Add, Delta
from dsr.crdt.pieces import START, Piece
from dsr.graph.graph import _LOOKS, Graph
from dsr.replication.claims import MAX_GAPS
from dsr.replication.outputs import Ask
from dsr.replication.piece_wire import encode_piece
from dsr.replication.sync import Synchroniser
from dsr.replication.wire import Digest, encode_digest
from tests.dsr.conftest import Net

MANY = 2 * _LOOKS
"""Edges of which a change without additions looks at a part alone."""


def edge(dot: tuple[str, int], src: tuple[str, int], dst: tuple[str, int], name: str = "a") -> Add:
    return Add(dot, (name, "b", "on"), "on", (src,), (dst,))


def test_an_edge_that_came_before_its_own_incarnation_of_a_hub_is_seen_with_that() -> None:
    """The hub is there already, as another agent made it; the edge is bound to an incarnation that comes later."""
    graph = Graph("me-1")
    nodes = [Add(("x-1", 1), "a", "cube"), Add(("x-1", 2), "b", "cube")]
    graph.join(Delta(nodes, context=[("x-1", 1, 2)]), 0.0)
    graph.join(Delta([edge(("y-1", 2), ("y-1", 1), ("x-1", 2))], context=[("y-1", 2, 2)]), 0.0)
    assert not graph.edges
    graph.join(Delta([Add(("y-1", 1), "a", "cube")], context=[("y-1", 1, 1)]), 0.0)
    assert list(graph.edges) == [("a", "b", "on")]


def waiting(count: int, end: tuple[str, int]) -> Delta:
    """Edges that wait for an end."""
    adds = [edge(("y-1", number + 1), end, ("y-1", count + 1), f"a{number}") for number in range(count)]
    return Delta([*adds, Add(("y-1", count + 1), "b", "cube")], context=[("y-1", 1, count + 1)])


def test_the_end_of_an_answer_decides_about_all_edges_at_once() -> None:
    graph = Graph("me-1")
    graph.join(waiting(MANY, ("gone-1", 7)), 0.0)
    graph.join(Delta(context=[("gone-1", 1, 6)]), 0.0)
    assert len(graph._unattached) == MANY
    live = frozenset(graph.store.entries)
    graph.join(Delta(context=[("gone-1", 7, 7)], live=live, examined=[("gone-1", 1, 7)]), 0.0)
    assert not graph._unattached and list(graph.store.by_key) == ["b"]


def test_what_is_given_up_takes_the_edges_that_waited_for_it() -> None:
    """The end of an answer leaves too many gaps: of those given up one was the end of many edges."""
    synchroniser, now = Synchroniser(Graph("me-1"), joined=True), 10.0
    graph = synchroniser.graph
    graph.join(waiting(MANY, ("gone-1", 2)), 0.0)
    graph.join(Delta(context=[("gone-1", 3, 3)]), 0.0)
    context = CausalContext([("gone-1", 4 * number + 1, 4 * number + 1) for number in range(MAX_GAPS + 1)])
    seen = [*context.ranges(), ("peer-1", 1, 1)]
    synchroniser.peer_appeared("peer-1", now)
    synchroniser.receive_digest("peer-1", encode_digest(Digest("peer-1", now, context.summary(), 0, ())), now, now)
    asks = [output for output in synchroniser.tick(now + 0.5, now) if isinstance(output, Ask)]
    kept = sorted(graph.store.entries)
    piece = Piece(START, kept=kept, examined=[("y-1", 1, MANY + 1)], whole=[*seen, ("y-1", 1, MANY + 1)])
    synchroniser.receive_reply("peer-1", asks[0].number, encode_piece(piece), now)
    assert ("gone-1", 2) in graph.store.context, "nothing is given up, so this shows nothing"
    assert not graph._unattached and list(graph.store.by_key) == ["b"]


def test_an_edge_of_an_overlay_that_dies_before_it_is_told_leaves_no_trace(net: Net) -> None:
    """A node and an edge at it come in one change, of which the other end turns out to be gone by the same change."""
    overlay = net.join("me").fork("layer", follow=True).replica.graph
    ends = ("y-1", 10), ("y-1", 11)
    overlay.join(Delta([edge(("y-1", 1), *ends)], context=[("y-1", 1, 1)]), 0.0)
    both = [Add(("y-1", 10), "a", "cube"), edge(("y-1", 12), *ends)]
    overlay.join(Delta(both, context=[("y-1", 10, 12)]), 0.0)
    assert list(overlay.store.by_key) == ["a"] and not overlay._unattached
    assert not overlay.incident
