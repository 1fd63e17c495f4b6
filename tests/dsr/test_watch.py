"""Subscriptions: filtered, conflated, and nothing that came or went is missed."""

from __future__ import annotations

import threading

import pytest

from dsr import Change, Node, Pose
from tests.dsr.conftest import Net


def summary(changes: list[Change]) -> list[tuple[str, str, tuple[str, ...]]]:
    return [(change.kind, change.name, tuple(sorted(change.attributes))) for change in changes]


def test_begins_with_what_is_there(net: Net) -> None:
    memory = net.join("a")
    memory.add_node("cube_3", "cube", mass=1.0)
    assert summary(memory.watch().poll()) == [("added", "cube_3", ("mass",))]
    assert memory.watch(existing=False).poll() == []


def test_a_thousand_updates_are_one_change(net: Net) -> None:
    memory = net.join("a")
    memory.add_node("cube_3", "cube")
    watch = memory.watch(existing=False)
    for index in range(1000):
        memory.update_node("cube_3", mass=float(index), seen=index)
    assert summary(watch.poll()) == [("updated", "cube_3", ("mass", "seen"))]
    assert watch.poll() == []


def test_a_thousand_creations_are_a_thousand_changes(net: Net) -> None:
    memory, reader = net.join("a"), net.join("b")
    watch = reader.watch(node_type="cube")
    for index in range(1000):
        memory.add_node(f"c{index}", "cube")
    net.pump()
    assert [change.name for change in watch.poll()] == [f"c{index}" for index in range(1000)]


def test_what_came_and_went_is_told(net: Net) -> None:
    memory = net.join("a")
    watch = memory.watch()
    memory.add_node("x", "cube", mass=1.0)
    memory.remove_node("x")
    assert summary(watch.poll()) == [("added", "x", ("mass",)), ("removed", "x", ())]
    memory.add_node("x", "cube")
    watch.poll()
    memory.remove_node("x")
    memory.add_node("x", "cube")
    assert [kind for kind, *_ in summary(watch.poll())] == ["removed", "added"]


def test_filters_by_type_and_attribute(net: Net) -> None:
    memory = net.join("a")
    nodes, edges = memory.watch(node_type=("cube", "box")), memory.watch(edge_type="RT")
    mass = memory.watch(node_type="cube", attribute="mass")
    both = memory.watch(node_type="cube", edge_type="RT")
    memory.add_node("world", "world")
    memory.add_node("c", "cube", seen=1)
    memory.add_edge("world", "c", "RT", pose=Pose())
    memory.add_edge("world", "c", "has")
    assert [change.name for change in nodes.poll()] == ["c"]
    assert [(c.element, c.src, c.dst, c.type) for c in edges.poll()] == [("edge", "world", "c", "RT")]
    assert mass.poll() == [] and len(both.poll()) == 2
    memory.update_node("c", mass=1.0, seen=2)
    assert summary(mass.poll()) == [("updated", "c", ("mass",))]


def test_what_is_not_wanted_wakes_nobody_and_its_removal_is_told(net: Net) -> None:
    memory = net.join("a")
    woken: list[int] = []
    watch = memory.watch(
        node_type="cube", notify=lambda: woken.append(1),
        where=lambda node: isinstance(node, Node) and node.name != "cube_3",
    )  # fmt: skip
    memory.add_node("cube_3", "cube", mass=1.0)
    memory.update_node("cube_3", mass=2.0)
    assert not woken and watch.poll() == []
    memory.add_node("cube_4", "cube")
    assert woken and summary(watch.poll()) == [("added", "cube_4", ())]
    memory.remove_node("cube_3")
    assert summary(watch.poll()) == [("removed", "cube_3", ())]


def test_an_edge_goes_with_its_node(net: Net) -> None:
    memory = net.join("a")
    memory.add_node("world", "world")
    memory.add_node("c", "cube")
    memory.add_edge("world", "c", "has")
    watch = memory.watch(edge_type="has", existing=False)
    memory.remove_node("c")
    assert summary(watch.poll()) == [("removed", "c", ())]


def test_iteration_waits_and_ends_with_the_memory(net: Net) -> None:
    memory = net.join("a")
    names: list[str] = []
    watch = memory.watch()
    reader = threading.Thread(target=lambda: names.extend(change.name for change in watch))
    reader.start()
    memory.add_node("x", "cube")
    memory.add_node("y", "cube")
    while len(names) < 2 and reader.is_alive():
        reader.join(0.01)
    memory.close()
    reader.join(5.0)
    assert not reader.is_alive() and sorted(names) == ["x", "y"]


def test_a_slow_reader_costs_the_writer_no_memory(net: Net) -> None:
    memory = net.join("a")
    memory.add_node("x", "cube")
    watch = memory.watch()
    for index in range(5000):
        memory.update_node("x", seen=index)
    assert len(watch._pending) == 1


def test_next_gives_up_after_its_timeout(net: Net) -> None:
    assert net.join("a").watch().next(timeout=0.0) is None


@pytest.mark.parametrize("attribute", ["mass", ["mass", "seen"]])
def test_a_closed_watch_is_silent(net: Net, attribute: str | list[str]) -> None:
    memory = net.join("a")
    with memory.watch(attribute=attribute) as watch:
        pass
    memory.add_node("x", "cube", mass=1.0)
    assert watch.next() is None


def test_an_attribute_of_what_came_again_is_told(net: Net) -> None:
    memory = net.join("a")
    memory.add_node("x", "cube", mass=1.0)
    watch = memory.watch(attribute="mass", existing=False)
    memory.remove_node("x")
    memory.add_node("x", "cube", mass=2.0)
    assert summary(watch.poll()) == [("removed", "x", ()), ("updated", "x", ("mass",))]


def test_an_update_before_a_removal_does_not_hide_it(net: Net) -> None:
    memory = net.join("a")
    memory.add_node("x", "cube", mass=1.0)
    watch = memory.watch(existing=False)
    memory.update_node("x", mass=2.0)
    memory.remove_node("x")
    memory.add_node("x", "cube", seen=1)
    assert summary(watch.poll()) == [("removed", "x", ()), ("added", "x", ("seen",))]


def test_a_node_whose_type_changes_goes_for_one_reader_and_comes_for_the_other(net: Net) -> None:
    """Two agents create it at once; one type wins everywhere."""
    a, b = net.join("a"), net.join("b")
    b.add_node("x", "box", mass=2.0)
    a.add_node("x", "cube", mass=1.0)
    winner, loser = (a, b) if a.rid > b.rid else (b, a)
    kind, other = winner.node("x").type, loser.node("x").type
    gone, come = loser.watch(node_type=other, existing=False), loser.watch(node_type=kind)
    net.pump()
    assert [(c.kind, c.type) for c in gone.poll()] == [("removed", other)]
    assert [(c.kind, c.type, c.attributes) for c in come.poll()] == [("added", kind, {"mass"})]
    assert [node.name for node in loser.nodes(kind)] == ["x"] and loser.nodes(other) == []


def test_what_was_closed_gathers_nothing(net: Net) -> None:
    memory = net.join("a")
    watch = memory.watch()
    watch.close()
    memory.add_node("x", "cube")
    assert watch.poll() == []


def test_each_change_tells_the_type_of_its_moment(net: Net) -> None:
    memory = net.join("a")
    memory.add_node("x", "cube")
    watch = memory.watch(existing=False)
    memory.remove_node("x")
    memory.add_node("x", "ball")
    assert [(change.kind, change.type) for change in watch.poll()] == [("removed", "cube"), ("added", "ball")]


def test_each_of_two_who_wait_gets_one_of_two_changes(net: Net) -> None:
    memory, found = net.join("a"), []
    watch = memory.watch(node_type="cube", existing=False)
    threads = [threading.Thread(target=lambda: found.append(watch.next(10.0))) for _ in range(2)]
    for thread in threads:
        thread.start()
    with memory.batch():
        memory.add_node("x", "cube")
        memory.add_node("y", "cube")
    for thread in threads:
        thread.join(10.0)
    assert sorted(change.name for change in found if change is not None) == ["x", "y"]


def test_a_watch_that_comes_later_is_told_of_the_same_kinds_of_changes(net: Net) -> None:
    memory = net.join("a")
    memory.add_node("x", "cube", mass=1.0)
    first = memory.watch(attribute="mass", existing=False)
    memory.update_node("x", mass=2.0)
    second = memory.watch(attribute="mass", existing=False)
    first.close()
    memory.update_node("x", mass=3.0)
    assert summary(second.poll()) == [("updated", "x", ("mass",))] and first.poll() == []
