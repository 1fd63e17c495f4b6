"""Worlds side by side: made, forked, opened by late joiners, listed, watched, deleted without trace."""

from __future__ import annotations

import gc
import sys
import threading
import weakref
from collections.abc import Iterator

import pytest

from dsr import (
    AgentError,
    ConfigError,
    Memory,
    NodeNotFoundError,
    Pose,
    TransportError,
    WorldError,
    WorldInfo,
    WorldNotFoundError,
)
from dsr.crdt.delta import Add, Delta
from dsr.graph.access import Access, WriteGuard
from tests.dsr.conftest import Net, tabletop


def test_a_memory_is_one_of_the_base_and_lists_all_worlds(net: Net) -> None:
    a = net.join("a")
    assert a.world_name == "base" and a.worlds() == [WorldInfo("base")] and a.world("base") is a
    net.pump(1.0)
    filtered = a.create_world("filtered")
    fork = a.fork("idea", of="base")
    assert (filtered.world_name, fork.world_name) == ("filtered", "idea")
    assert (
        a.worlds()
        == fork.worlds()
        == [
            WorldInfo("base"),
            WorldInfo("filtered", creator="a", created=net.clock.now()),
            WorldInfo("idea", "base", creator="a", created=net.clock.now()),
        ]
    )
    assert a.world("idea") is fork is filtered.world("idea")


def test_a_new_world_has_a_root_and_nothing_else(net: Net) -> None:
    a = net.join("a")
    tabletop(a)
    world = a.create_world("w")
    assert [(node.name, node.type) for node in world.nodes()] == [("world", "world")] and world.edges() == []


def test_a_fork_begins_as_its_parent_and_both_go_their_own_ways(net: Net) -> None:
    a = net.join("a")
    tabletop(a)
    fork = a.fork("idea")
    assert fork.node("cube_3").created == a.node("cube_3").created
    assert fork.transform("world", "cube_3").t == (0.3, 0.1, 0.02)
    fork.update_node("cube_3", mass=1.0)
    fork.update_edge("world", "cube_3", "RT", pose=Pose((1, 1, 1), stamp=6.0))
    a.remove_node("table")
    a.add_node("ball", "ball")
    assert a.node("cube_3")["mass"] == 0.05 and a.transform("world", "cube_3").t == (0.3, 0.1, 0.02)
    assert fork.transform("world", "cube_3").t == (1, 1, 1) and fork.transform("world", "table").t == (0.3, 0, 0)
    assert "ball" not in fork and "table" in fork


def test_forks_of_forks(net: Net) -> None:
    a = net.join("a")
    tabletop(a)
    first = a.fork("first")
    first.update_node("cube_3", mass=1.0)
    second = first.fork("second")
    a.update_node("cube_3", mass=2.0)
    first.update_node("cube_3", mass=3.0)
    assert [w.node("cube_3")["mass"] for w in (a, first, second)] == [2.0, 3.0, 1.0]
    assert a.worlds()[2].parent == "first"


def test_a_late_joiner_finds_opens_and_changes_a_world(net: Net) -> None:
    a = net.join("a")
    tabletop(a)
    fork = a.fork("idea")
    fork.update_node("cube_3", mass=1.0)
    net.pump(1.5)
    b = net.join("b")
    net.pump(0.3)
    theirs = b.world("idea")
    assert theirs.joined and theirs.node("cube_3")["mass"] == 1.0 and b.node("cube_3")["mass"] == 0.05
    theirs.update_node("cube_3", mass=2.0)
    theirs.add_node("ball", "ball")
    net.pump(0.1)
    assert fork.node("cube_3")["mass"] == 2.0 and "ball" in fork and "ball" not in a


def test_a_world_outlives_the_process_that_made_it_if_another_one_holds_it(net: Net) -> None:
    a, b, c = net.join("a"), net.join("b"), net.join("c")
    net.pump(1.5)
    a.create_world("w").add_node("ball", "ball")
    net.pump(0.1)
    b.world("w")
    a.close()
    net.pump(0.1)
    assert "ball" in c.world("w")


def test_what_nobody_holds_any_more_can_only_be_begun_anew(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    net.pump(1.5)
    a.create_world("w").add_node("ball", "ball")
    net.pump(0.1)
    a.close()
    net.pump(0.1)
    with pytest.raises(WorldNotFoundError, match="nobody holds it"):
        b.world("w")
    assert "ball" not in b.create_world("w", exist_ok=True)


def test_deleting_a_world_drops_it_everywhere(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    net.pump(1.5)
    a.fork("idea")
    net.pump(0.1)
    theirs = b.world("idea")
    a.delete_world("idea")
    net.pump(0.1)
    assert a.worlds() == b.worlds() == [WorldInfo("base")]
    with pytest.raises(WorldNotFoundError, match="valid: base"):
        b.world("idea")
    with pytest.raises(Exception, match="closed"):
        theirs.add_node("ball", "ball")


def test_a_world_that_is_made_again_begins_without_what_a_late_writer_wrote(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    net.pump(1.5)
    a.create_world("w").add_node("old", "ball")
    net.pump(0.1)
    theirs = b.world("w")
    net.network.partition(["a"], ["b"])
    a.delete_world("w")
    again = a.create_world("w")
    theirs.add_node("late", "ball")
    net.pump(1.0)
    net.network.heal()
    net.pump(3.0)
    for world in (again, b.world("w")):
        assert {node.name for node in world.nodes()} == {"world"}


def test_worlds_of_one_name_made_at_once_become_one(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    net.pump(1.5)
    net.network.partition(["a"], ["b"])
    ours, theirs = a.create_world("w"), b.create_world("w")
    ours.add_node("x", "ball")
    theirs.add_node("y", "ball")
    net.pump(1.0)
    net.network.heal()
    net.pump(5.0)
    assert {n.name for n in ours.nodes()} == {n.name for n in theirs.nodes()} == {"world", "x", "y"}
    assert len(a.worlds()) == 2


def test_the_list_of_worlds_is_no_part_of_a_world_but_can_be_watched(net: Net) -> None:
    a = net.join("a")
    with a.watch() as everything, a.watch(node_type="world_record") as worlds:
        a.create_world("w")
        assert everything.poll() == [] and a.nodes() == []
        assert [change.kind for change in worlds.poll()] == ["added"]
        a.delete_world("w")
        assert [change.kind for change in worlds.poll()] == ["removed"]


def test_wrong_names_and_worlds_are_refused(net: Net) -> None:
    a = net.join("a")
    a.fork("idea")
    with pytest.raises(WorldNotFoundError, match="did you mean 'idea'"):
        a.world("ida")
    with pytest.raises(WorldNotFoundError):
        a.fork("other", of="none")
    with pytest.raises(WorldError, match="exists"):
        a.fork("idea")
    with pytest.raises(WorldError, match="exists"):
        a.create_world("base")
    with pytest.raises(ConfigError, match="world name"):
        a.create_world("a/b")
    with pytest.raises(WorldError, match="system's own"):
        a.delete_world("base")


def test_making_worlds_is_a_right_that_an_agent_declares(net: Net) -> None:
    free = net.join("free", guard=WriteGuard("free", Access(nodes=("world_record", "world"))))
    free.delete_world(free.create_world("w").world_name)
    bound = net.join("bound", guard=WriteGuard("bound", Access(nodes=("cube",))))
    with pytest.raises(AgentError, match="world_record"):
        bound.fork("idea")


def test_closing_the_base_closes_all_worlds(net: Net) -> None:
    a = net.join("a")
    worlds = [a.create_world("w"), a.fork("idea")]
    assert isinstance(worlds[0], Memory)
    a.close()
    for world in worlds:
        with pytest.raises(Exception, match="closed"):
            world.add_node("ball", "ball")


def test_what_polls_while_a_memory_closes_opens_no_world_anew(net: Net) -> None:
    """An overlay whose parent has closed is opened anew, but not when all are closing: nobody would close it."""
    a, b = net.join("a"), net.join("b")
    net.pump(1.5)
    idea = a.fork("idea")
    idea.fork("view", follow=True)
    idea.on_close(a.poll)
    net.pump(0.5)
    a.close()
    net.pump(0.5)
    assert b.worlds()[-1].name == "view"
    for world in ("idea", "view"):
        with pytest.raises(WorldNotFoundError, match="nobody holds it any more"):
            b.world(world)


def test_a_closed_memory_opens_no_world(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    a.create_world("w")
    net.pump(0.5)
    b.close()
    with pytest.raises(TransportError, match="is closed"):
        b.world("w")


def test_a_deleted_fork_leaves_no_memory_behind(net: Net) -> None:
    a = net.join("a")
    tabletop(a)
    fork = a.fork("idea")
    graph = weakref.ref(fork.replica.graph)
    a.update_node("cube_3", mass=1.0)
    a.delete_world("idea")
    assert fork.nodes() == [] and fork.closed and not fork.replica.graph.store.entries
    del fork
    gc.collect()
    assert graph() is None
    net.pump(0.1)
    assert a.replica.graph.store.owned is None


def test_a_fork_of_a_deleted_fork_keeps_what_it_reads(net: Net) -> None:
    a = net.join("a")
    tabletop(a)
    a.fork("first").update_node("cube_3", mass=1.0)
    second = a.fork("second", of="first")
    a.delete_world("first")
    gc.collect()
    a.update_node("cube_3", mass=2.0)
    a.remove_node("table")
    assert second.node("cube_3")["mass"] == 1.0 and "table" in second


def test_a_fork_of_a_deleted_empty_fork_stays_empty(net: Net) -> None:
    a = net.join("a")
    a.fork("first")
    second = a.fork("second", of="first")
    assert not second.nodes()
    a.delete_world("first")
    tabletop(a)
    assert a.nodes() and not second.nodes()


@pytest.fixture
def hurried_threads() -> Iterator[None]:
    """Threads that take turns a thousand times as often as usual."""
    usual = sys.getswitchinterval()
    sys.setswitchinterval(usual / 1000)
    yield
    sys.setswitchinterval(usual)


@pytest.mark.usefixtures("hurried_threads")
def test_what_is_read_without_a_lock_never_shows_what_the_parent_writes(net: Net) -> None:
    a = net.join("a")
    a.add_node("world", "world")
    for index in range(200):
        a.add_node(f"n{index}", "cube", mass=0.0)
        a.add_edge("world", f"n{index}", "RT", pose=Pose((0.0, 0, 0), stamp=1.0))
    fork = a.fork("idea")
    stop = threading.Event()

    def write() -> None:
        for index in range(200):
            a.update_node(f"n{index}", mass=1.0)
            a.update_edge("world", f"n{index}", "RT", pose=Pose((1.0, 0, 0), stamp=2.0))
            a.add_node(f"m{index}", "cube", mass=1.0)
            if index % 3 == 0 and index:
                a.remove_node(f"n{index}")
        stop.set()

    writer = threading.Thread(target=write)
    writer.start()
    while True:
        last = stop.is_set()
        nodes = fork.nodes("cube")
        assert len(nodes) == 200 and all(node["mass"] == 0.0 for node in nodes)
        assert len(fork.replica.graph.nodes_by_type["cube"]) == 200
        assert all(fork.transform("world", f"n{index}").t[0] == 0.0 for index in range(200))
        fork.poll()
        if last:
            break
    writer.join()


def test_what_was_deleted_says_so_and_hints_name_no_records(net: Net) -> None:
    a = net.join("a")
    tabletop(a)
    fork = a.fork("idea")
    with pytest.raises(NodeNotFoundError, match="valid: cube_3, table, world"):
        a.node("nothing")
    a.delete_world("idea")
    with pytest.raises(NodeNotFoundError, match="no node 'table'; world 'idea' was deleted"):
        fork.node("table")


def test_a_node_made_twice_in_a_fork_keeps_the_edges_that_the_fork_reads_from_its_parent(net: Net) -> None:
    memory = net.join("a")
    tabletop(memory)
    before = {edge.key: dict(edge) for edge in memory.edges()}
    fork = memory.fork("plan")
    again = Delta(adds=[Add(("other-1", 1), "table", "table")], context=[("other-1", 1, 1)])
    fork.replica.graph.join(again, net.clock.now())
    assert ("other-1", 1) in fork.node("table").created and len(memory.node("table").created) == 1
    assert {edge.key: dict(edge) for edge in fork.edges()} == before
    memory.remove_edge(*next(key for key in before if "table" in key))
    assert {edge.key: dict(edge) for edge in fork.edges()} == before
