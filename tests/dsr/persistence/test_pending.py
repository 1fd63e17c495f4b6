"""What is pending is written in an order in which joining it gives what was joined."""

from __future__ import annotations

import pytest

from dsr.crdt.context import CausalContext, Dot
from dsr.crdt.delta import Delta, Write
from dsr.crdt.pieces import reply_to
from dsr.graph.graph import Graph
from dsr.persistence.pending import PendingWrites


def test_a_reply_does_not_make_void_what_was_joined_before_it() -> None:
    graph, other, pending = Graph("a-1"), Graph("b-1"), PendingWrites()
    graph.store.recorder = pending.add
    other.join(graph.add_node("first", "cube", {"mass": 1.0}, 1.0), 1.0)
    other.add_node("second", "cube", {}, 2.0)
    graph.join(reply_to(other.store, graph.store.context), 2.0)
    graph.add_node("third", "cube", {}, 3.0)
    graph.join(reply_to(other.store, CausalContext()), 3.0)
    again = Graph("a-2")
    for delta in pending.take():
        again.join(delta, 3.0)
    assert again.nodes.keys() == graph.nodes.keys() == {"first", "second", "third"}
    assert again.store.context == graph.store.context and not pending


@pytest.mark.parametrize("dots", [[None, ("b-2", 9), ("a-1", 3)], [("a-1", 3), None, ("b-2", 9)]])
def test_of_a_write_that_several_made_durable_the_greatest_dot_stays(dots: list[Dot | None]) -> None:
    """As in the store: else a replica that was restored would differ from the others."""
    pending = PendingWrites()
    for dot in dots:
        pending.add(Delta(writes=[Write(("a-1", 1), "seen", 7, "c-1", dot, 1.0)]))
    (taken,) = pending.take()
    assert [write.dot for write in taken.writes] == [("b-2", 9)]
