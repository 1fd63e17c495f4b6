"""Overlays: their own first, everything else live from the parent, attribute by attribute; only that is replicated."""

from __future__ import annotations

import itertools
from typing import Any

import msgspec
import pytest

from dsr import NodeNotFoundError, Pose, WorldError, WorldInfo, WorldNotFoundError
from dsr.crdt import pieces
from dsr.crdt.context import CausalContext
from dsr.crdt.delta import MAX_ENDS, Add, Delta, Write
from dsr.crdt.store import MAX_MADE, MAX_WAITING, Store
from dsr.replication.wire import encode_delta
from dsr.worlds.layer import Layer
from dsr.worlds.overlay import Overlay
from dsr.worlds.registry import find_record, node_name, to_attribute
from tests.dsr.conftest import Net, tabletop


def test_an_overlay_shows_its_parent_live_but_for_what_it_says_itself(net: Net) -> None:
    a = net.join("a")
    tabletop(a)
    overlay = a.fork("view", follow=True)
    handle = overlay.node("cube_3")
    overlay.update_node("cube_3", mass=1.0)
    a.update_node("cube_3", mass=2.0, marker_id=4)
    a.add_node("ball", "ball")
    assert overlay.node("cube_3")["mass"] == handle["mass"] == 1.0 and handle["marker_id"] == 4
    assert "ball" in overlay and a.node("cube_3")["mass"] == 2.0
    assert [node.name for node in overlay.nodes("ball")] == ["ball"]
    a.update_edge("world", "cube_3", "RT", pose=Pose((1, 0, 0), stamp=6.0))
    assert overlay.transform("world", "cube_3").t == (1, 0, 0)
    overlay.update_edge("world", "cube_3", "RT", pose=Pose((2, 0, 0), stamp=6.0))
    a.update_edge("world", "cube_3", "RT", pose=Pose((3, 0, 0), stamp=7.0))
    assert overlay.transform("world", "cube_3").t == (2, 0, 0) == overlay.edge("world", "cube_3", "RT").pose.t
    assert a.transform("world", "cube_3").t == (3, 0, 0)


def test_removal_hides_and_what_the_parent_makes_anew_shows(net: Net) -> None:
    a = net.join("a")
    tabletop(a)
    overlay = a.fork("view", follow=True)
    overlay.remove_node("cube_3")
    assert "cube_3" not in overlay and "cube_3" in a and overlay.edges("RT", dst="cube_3") == []
    a.add_edge("table", "cube_3", "has")
    assert overlay.edges("has") == []
    with pytest.raises(NodeNotFoundError):
        overlay.node("cube_3")
    a.remove_node("cube_3")
    a.add_node("cube_3", "cube", mass=3.0)
    assert overlay.node("cube_3")["mass"] == 3.0


def test_what_an_overlay_says_of_an_element_goes_with_it(net: Net) -> None:
    a = net.join("a")
    tabletop(a)
    overlay = a.fork("view", follow=True)
    overlay.update_node("cube_3", mass=1.0)
    overlay.add_node("ghost", "ball")
    overlay.add_edge("cube_3", "ghost", "has")
    a.remove_node("cube_3")
    assert "cube_3" not in overlay and "ghost" in overlay and overlay.edges("has") == []
    a.add_node("cube_3", "cube")
    assert "mass" not in overlay.node("cube_3")


def test_an_attribute_taken_away_in_an_overlay_stays_hidden(net: Net) -> None:
    a = net.join("a")
    tabletop(a)
    overlay = a.fork("view", follow=True)
    overlay.remove_attribute("cube_3", "mass")
    a.update_node("cube_3", mass=2.0)
    assert "mass" not in overlay.node("cube_3") and a.node("cube_3")["mass"] == 2.0


def test_watches_of_an_overlay_tell_of_changes_in_both(net: Net) -> None:
    a = net.join("a")
    tabletop(a)
    overlay = a.fork("view", follow=True)
    with overlay.watch(existing=False) as watch:
        a.update_node("cube_3", mass=2.0)
        assert [(c.kind, c.name, c.attributes) for c in watch.poll()] == [("updated", "cube_3", {"mass"})]
        overlay.update_node("cube_3", mass=1.0)
        assert [(c.kind, c.name) for c in watch.poll()] == [("updated", "cube_3")]
        a.update_node("cube_3", mass=3.0)
        assert watch.poll() == []
        overlay.remove_node("cube_3")
        assert {(c.kind, c.element) for c in watch.poll()} == {("removed", "node"), ("removed", "edge")}
        a.update_node("cube_3", mass=4.0)
        a.remove_node("cube_3")
        assert watch.poll() == []
        a.remove_node("table")
        assert {(c.kind, c.element) for c in watch.poll()} == {("removed", "node"), ("removed", "edge")}


def test_a_late_joiner_gets_the_layer_and_looks_through_to_its_own_parent(net: Net) -> None:
    a = net.join("a")
    tabletop(a)
    overlay = a.fork("view", follow=True)
    overlay.update_node("cube_3", mass=1.0)
    overlay.add_node("ghost", "ball")
    overlay.remove_node("table")
    net.pump(1.5)
    b = net.join("b")
    net.pump(0.3)
    theirs = b.world("view")
    assert theirs.node("cube_3")["mass"] == 1.0 and "ghost" in theirs and "table" not in theirs and "table" in b
    a.update_node("cube_3", marker_id=9)
    theirs.update_node("cube_3", mass=5.0)
    net.pump(0.2)
    assert theirs.node("cube_3")["marker_id"] == 9 and overlay.node("cube_3")["mass"] == 5.0
    assert len(overlay.replica.graph.store.entries) == 1


def test_a_parent_that_is_followed_cannot_be_deleted_and_an_overlay_can(net: Net) -> None:
    a = net.join("a")
    tabletop(a)
    a.fork("middle")
    a.fork("view", of="middle", follow=True)
    with pytest.raises(WorldError, match="followed by view"):
        a.delete_world("middle")
    a.delete_world("view")
    a.delete_world("middle")
    a.update_node("cube_3", mass=7.0)


def test_overlays_of_overlays_and_forks_of_overlays(net: Net) -> None:
    a = net.join("a")
    tabletop(a)
    one = a.fork("one", follow=True)
    one.update_node("cube_3", mass=1.0)
    two = a.fork("two", of="one", follow=True)
    two.update_node("cube_3", marker_id=2)
    fork = a.fork("fork", of="two")
    a.update_node("cube_3", size=(1.0, 1.0, 1.0))
    one.update_node("cube_3", mass=4.0)
    assert dict(two.node("cube_3")) == {"mass": 4.0, "marker_id": 2, "size": (1.0, 1.0, 1.0)}
    assert fork.node("cube_3")["mass"] == 1.0 and fork.node("cube_3")["marker_id"] == 2
    assert fork.node("cube_3").created == a.node("cube_3").created
    assert fork.transform("world", "cube_3").t == two.transform("world", "cube_3").t == (0.3, 0.1, 0.02)
    a.remove_node("cube_3")
    assert "cube_3" not in two and "cube_3" in fork


def test_a_fork_of_an_overlay_holds_each_write_once_and_can_be_fetched_in_pieces(
    net: Net, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two have added the same thing at once: its two incarnations show the same values, of which one holds each.

    Who lost the connection after the first piece of an answer asks again, for what is unseen: a value that both
    incarnations held under one dot would be missing from the second one.
    """
    a, b = net.join("a"), net.join("b")
    tabletop(a)
    net.pump(1.0)
    for memory in (a, b):
        memory.add_node("ball", "ball", mass=1.0)
    net.pump(1.0)
    a.update_node("ball", mass=2.0)
    a.fork("view", follow=True).update_node("ball", marker_id=3)
    fork = a.fork("copy", of="view")
    store = fork.replica.graph.store
    assert len(store.by_key["ball"]) == 2 and fork.node("ball")["mass"] == 2.0 and fork.node("ball")["marker_id"] == 3
    dots = [write.dot for entry in store.entries.values() for write in entry.registers.values()]
    assert len(dots) == len(set(dots))
    monkeypatch.setattr(pieces, "MAX_EXAMINED", 1)
    for lost_after in range(1, len(store.entries)):
        new = Store()
        for piece in itertools.islice(pieces.all_pieces(store, CausalContext()), lost_after):
            new.join(piece.as_delta())
        new.join(pieces.reply_to(store, new.context))
        assert {dot: entry.registers for dot, entry in new.entries.items()} == {
            dot: entry.registers for dot, entry in store.entries.items()
        }


def test_an_overlay_made_while_its_parent_was_deleted_goes_and_no_later_world_is_its_parent(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    tabletop(a)
    a.fork("plan")
    net.pump(0.5)
    b.world("plan")
    overlay = b.fork("view", of="plan", follow=True)
    above = overlay.fork("above", follow=True)
    a.delete_world("plan")
    net.pump(0.5)
    assert overlay.closed and above.closed
    a.create_world("plan")
    net.pump(0.5)
    for memory in (a, b):
        with pytest.raises(WorldNotFoundError, match="'plan', which was deleted; delete 'view', too"):
            memory.world("view")
    a.delete_world("plan")
    b.delete_world("above")
    b.delete_world("view")
    net.pump(0.5)
    assert [world.name for world in b.worlds()] == ["base"]


def test_overlays_of_each_other_are_found_out_and_can_be_deleted(net: Net) -> None:
    memory = net.join("a")
    for name, parent in (("one", "other"), ("other", "one")):
        record = to_attribute(WorldInfo(name, parent, follows=True), f"channel_{name}")
        memory.write_record(node_name(name), "world_record", record)
    with pytest.raises(WorldNotFoundError, match="one, other show one another"):
        memory.world("one")
    memory.delete_world("one")
    memory.delete_world("other")


def test_a_write_costs_each_overlay_below_as_much(net: Net, monkeypatch: pytest.MonkeyPatch) -> None:
    top = net.join("a")
    tabletop(top)
    for depth in range(12):
        top = top.fork(f"view_{depth}", follow=True)
        top.update_node("cube_3", mass=float(depth))
    looked, split = 0, Overlay.split

    def counted(*args: Any) -> Any:
        nonlocal looked
        looked += 1
        return split(*args)

    monkeypatch.setattr(Overlay, "split", counted)
    top.update_node("cube_3", mass=20.0)
    assert top.node("cube_3")["mass"] == 20.0 and looked < 100


@pytest.mark.parametrize("length", [1, 10_000])
def test_what_the_end_of_an_answer_says_was_removed_is_hidden(net: Net, length: int) -> None:
    """Without naming it: who restores a journal, or gets the rest of an answer, learns of it only as seen."""
    memory = net.join("a")
    memory.add_node("cup", "cube")
    view = memory.fork("view", follow=True)
    ((rid, counter),) = memory.node("cup").created
    view.replica.graph.join(Delta(context=[(rid, counter, counter + length - 1)]), net.clock.now())
    assert "cup" not in view and "cup" in memory


def node(rid: str, counter: int = 1) -> Delta:
    """One more incarnation of the node `n`."""
    return Delta([Add((rid, counter), "n", "cube")], context=[(rid, counter, counter)])


@pytest.mark.parametrize("order", [(0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)])
@pytest.mark.parametrize("follow", [True, False])
def test_edges_of_one_incarnation_do_not_depend_on_the_order_of_arrival(
    net: Net, order: tuple[int, ...], follow: bool
) -> None:
    """An edge that is bound to one of two incarnations of a node, which two agents made at once, goes with that one."""
    graph = net.join("a").fork("view", follow=follow).replica.graph
    graph.add_node("x", "cube", {}, 0.0)
    (end,) = graph.nodes["x"].created
    edge = Add(("B-1", 2), ("n", "x", "on"), "on", (("B-1", 1),), (end,))
    changes = [node("A-1"), node("B-1"), Delta([edge], context=[("B-1", 2, 2)])]
    for place in order:
        graph.join(changes[place], 0.0)
    assert list(graph.edges) == [("n", "x", "on")] and not graph._unattached
    graph.join(Delta(removed=[("B-1", 1)], context=[("C-1", 1, 1)]), 0.0)
    assert list(graph.edges) == [] and "n" in graph.nodes and edge.dot not in graph.store.entries


def test_who_hides_one_incarnation_hides_the_edges_that_are_bound_to_it(net: Net) -> None:
    base = net.join("a")
    view, graph = base.fork("view", follow=True), base.replica.graph
    base.add_node("x", "cube")
    (end,) = base.node("x").created
    edge = Delta([Add(("B-1", 2), ("n", "x", "on"), "on", (("B-1", 1),), (end,))], context=[("B-1", 2, 2)])
    for change in (node("A-1"), node("B-1"), edge):
        graph.join(change, 0.0)
    assert view.edges("on") and base.edges("on")
    view.replica.graph.join(Delta(removed=[("B-1", 1)], context=[("C-1", 1, 1)]), 0.0)
    assert "n" in view and view.edges("on") == [] and base.edges("on")


def test_who_made_a_world_a_thousand_times_and_removes_that_takes_no_overlay_of_it(net: Net) -> None:
    """The entry of the overlay names dots of who else made the world, too."""
    a, b = net.join("a"), net.join("b")
    net.pump(2.0)
    a.add_node("cup", "cube")
    a.fork("sim")
    net.pump(1.0)
    key = node_name("sim")
    adds = [Add(("zliar-1", number), key, a._graph.nodes[key].type) for number in range(1, MAX_ENDS + 1)]
    a._graph.join(Delta(adds, context=[("zliar-1", 1, MAX_ENDS)]), 0.0)
    net.pump(5.0)
    assert len(b._graph.nodes[key].created) == MAX_MADE + 1
    b.fork("thought", of="sim", follow=True)
    net.pump(1.0)
    gone = Delta(removed=[add.dot for add in adds], context=[("zliar-1", MAX_ENDS + 1, MAX_ENDS + 1)])
    for memory in (a, b):
        memory._graph.join(gone, 0.0)
    net.pump(5.0)
    opened = a.world("thought")
    net.pump(2.0)
    assert "cup" in opened


def test_an_entry_names_no_more_dots_than_an_edge_has_at_one_end(net: Net) -> None:
    """Each entry of an open world is read again when the list changes: with 60 000 dots that would take 35 ms."""
    a = net.join("a")
    for name, count in (("honest", 2 * MAX_ENDS), ("liar", MAX_ENDS + 1)):
        below = [(f"r{number:05}-1", 1) for number in range(count)]
        record = to_attribute(WorldInfo(name, "sim", follows=True), "channel", below if name == "honest" else ())
        if name == "liar":
            record = msgspec.json.encode({**msgspec.json.decode(record), "below": below}).decode()
        a.write_record(node_name(name), "world_record", record)
    honest = find_record(a._graph, "honest")
    assert honest is not None and len(honest.below) == MAX_ENDS and (f"r{2 * MAX_ENDS - 1:05}-1", 1) in honest.below
    assert find_record(a._graph, "liar") is None


@pytest.mark.parametrize("durable", [True, False])
def test_what_is_written_to_elements_that_never_come_is_bounded(net: Net, durable: bool) -> None:
    """Nobody could see it or take it away."""
    a, liar = net.join("a"), "zz-1"
    a.add_node("cube", "cube", mass=1.0)
    overlay = a.fork("view", follow=True)
    (cube,) = a.node("cube").created
    step = 1000
    for first in range(1, 2 * MAX_WAITING, step):
        dots = [(liar, number) for number in range(first, first + step)]
        writes = [Write(("nobody-1", dot[1]), "note", 1, liar, dot if durable else None, "x") for dot in dots]
        context = [(liar, first, first + step - 1)] if durable else []
        overlay.replica.synchroniser.receive_delta(liar, encode_delta(Delta(writes=writes, context=context)), 0.0)
    net.pump(2.0)
    store = overlay.replica.graph.store
    assert isinstance(store, Layer) and len(store.patches) == MAX_WAITING
    assert ((liar, 2 * MAX_WAITING) in store.context) is False
    overlay.update_node("cube", mass=2.0)
    assert cube in store.patches and overlay.node("cube")["mass"] == 2.0


def test_what_was_kept_of_an_overlay_is_restored_whole(net: Net) -> None:
    """Also what was said of elements that the parent does not know yet, however much that is."""
    a = net.join("a")
    overlay = a.fork("view", follow=True)
    numbers = range(1, MAX_WAITING + 100)
    writes = [Write(("other-1", number), "note", 1, "a-0", ("a-0", number), "x") for number in numbers]
    graph = overlay.replica.graph
    graph.restore(Delta(writes=writes, context=[("a-0", 1, numbers[-1])]), 0.0)
    assert isinstance(graph.store, Layer) and len(graph.store.patches) == len(numbers)
    assert ("a-0", numbers[-1]) in graph.store.context
