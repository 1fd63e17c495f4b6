"""Parts of a graph: made, asked for, read and written as one graph, and given back."""

from __future__ import annotations

import pytest

from dsr import (
    AgentError,
    ConfigError,
    Memory,
    NodeNotFoundError,
    PartError,
    PartInfo,
    PartNotFoundError,
    Pose,
    SchemaError,
    TransportError,
)
from dsr.crdt.delta import Add, Delta
from dsr.network.keys import part_of, part_rid
from dsr.parts.graph import PartedGraph
from tests.dsr.conftest import Net
from tests.dsr.test_interrupts import interrupted_at


def house(net: Net) -> tuple[Memory, Memory]:
    """A memory that made two parts and holds them, with things in them, and one that holds none yet."""
    a, b = net.join("a", interest=()), net.join("b", interest=())
    net.pump(1.0)
    a.create_part("kitchen")
    a.create_part("hall", types=("ball",))
    a.add_node("world", "world")
    a.add_node("cup", "cube", "kitchen", mass=1.0)
    a.add_node("ball", "ball")
    a.add_edge("world", "cup", "RT", pose=Pose((1, 0, 0)))
    a.add_edge("cup", "ball", "RT", pose=Pose((0, 1, 0)))
    net.pump(1.5)
    return a, b


def test_a_process_holds_what_it_asks_for_and_nothing_else(net: Net) -> None:
    a, b = house(net)
    assert b.parts() == a.parts() == [
        PartInfo("hall", ("ball",), "a", a.parts()[0].created), PartInfo("kitchen", (), "a", a.parts()[1].created)
    ]  # fmt: skip
    assert [node.name for node in b.nodes()] == ["world"] and b.edges() == [] and b.interest == ()
    b.hold_part("kitchen")
    net.pump(1.0)
    assert {node.name for node in b.nodes()} == {"world", "cup"} and b.joined
    assert [edge.key for edge in b.edges()] == [("world", "cup", "RT")]
    b.hold_part("hall")
    net.pump(1.0)
    assert b.transform("world", "ball").t == (1, 1, 0)
    assert list(b.interest) == ["kitchen", "hall"]


def test_all_that_is_held_is_one_graph(net: Net) -> None:
    a, b = house(net)
    b.hold_part("kitchen", "hall")
    net.pump(1.0)
    b.update_node("cup", mass=2.0)
    b.update_poses("RT", {("world", "cup"): Pose((2, 0, 0)), ("cup", "ball"): Pose((0, 2, 0))})
    b.add_edge("ball", "cup", "on")
    net.pump(1.5)
    assert a.node("cup")["mass"] == 2.0 and a.transform("world", "ball").t == (2, 2, 0)
    assert [a.part(each) for each in (a.node("world"), a.node("cup"), a.node("ball"))] == ["", "kitchen", "hall"]
    assert [a.part(edge) for edge in sorted(a.edges(), key=lambda edge: edge.key)] == ["hall", "kitchen", ""]
    assert a.remove_node("cup") and a.edges() == []
    net.pump(1.0)
    assert b.edges() == [] and "cup" not in b and "ball" in b


def test_who_names_no_part_is_as_ever(net: Net) -> None:
    a, _ = house(net)
    plain = net.join("plain")
    net.pump(1.0)
    assert plain.joined and [node.name for node in plain.nodes()] == ["world"] and plain.edges() == []
    plain.add_node("table", "table")
    plain.add_edge("world", "table", "RT", pose=Pose())
    net.pump(1.0)
    assert "table" in a and a.part(a.node("table")) == ""
    with pytest.raises(PartError, match="holds no parts"):
        plain.hold_part("kitchen")
    with pytest.raises(PartError, match="holds no parts"):
        plain.add_node("cup", "cube", "kitchen")


def test_errors_say_what_is_wrong(net: Net) -> None:
    a, b = house(net)
    with pytest.raises(PartNotFoundError, match="no part 'kithcen'; did you mean 'kitchen'"):
        b.hold_part("kithcen")
    with pytest.raises(PartError, match="'kitchen' is not held here: hold_part"):
        b.add_node("plate", "cube", "kitchen")
    with pytest.raises(PartError, match="'hall' is not held here"):
        b.add_node("ball_2", "ball")
    with pytest.raises(PartError, match="'kitchen' is not held here; held: none"):
        b.leave_part("kitchen")
    with pytest.raises(PartError, match="'cup' is in part 'kitchen', not in part 'hall'"):
        a.add_node("cup", "cube", "hall")
    with pytest.raises(PartError, match="exists already"):
        a.create_part("kitchen")
    with pytest.raises(ConfigError, match="'the kitchen'"):
        a.create_part("the kitchen")
    with pytest.raises(ConfigError, match="'a-b'"):
        a.create_part("a-b")
    with pytest.raises(SchemaError, match="node type"):
        a.create_part("lab", types=("cupp",))
    with pytest.raises(NodeNotFoundError):
        b.node("cup")
    assert b.interest == () and len(a.parts()) == 2


def test_a_part_that_exists_is_held_as_it_is(net: Net) -> None:
    a, b = house(net)
    b.create_part("hall", types=("cube",), exist_ok=True)
    net.pump(1.0)
    assert "ball" in b and b.parts()[0].types == ("ball",) and len(a.parts()) == 2


def test_a_part_that_is_left_goes_out_of_sight_and_comes_back_whole(net: Net) -> None:
    a, b = house(net)
    b.hold_part("kitchen", "hall")
    net.pump(1.0)
    watch = b.watch(existing=False)
    b.leave_part("kitchen")
    assert {(change.kind, change.name or change.dst) for change in watch.poll()} == {
        ("removed", "cup"), ("removed", "ball"),
    }  # fmt: skip
    assert {node.name for node in b.nodes()} == {"world", "ball"} and b.edges() == []
    net.pump(2.0)
    a.update_node("cup", mass=3.0)
    net.pump(2.0)
    assert {node.name for node in a.nodes()} == {"world", "cup", "ball"} and len(a.edges()) == 2
    b.hold_part("kitchen")
    net.pump(2.0)
    assert b.node("cup")["mass"] == 3.0 and len(b.edges()) == 2
    assert a.statistics.malformed == b.statistics.malformed == 0


def test_what_is_written_before_a_part_is_left_arrives(net: Net) -> None:
    a, b = house(net)
    b.hold_part("kitchen")
    net.pump(1.0)
    b.update_node("cup", mass=9.0)
    b.add_node("plate", "cube", "kitchen")
    b.leave_part("kitchen")
    net.pump(1.0)
    assert a.node("cup")["mass"] == 9.0 and "plate" in a


def test_a_question_that_is_under_way_is_not_answered_as_if_all_were_removed(net: Net) -> None:
    """The first holder of a part leaves it, when it has been asked for what is in it."""
    a, b = house(net)
    b.hold_part("kitchen")
    replica = a._held.replicas["kitchen"]  # type: ignore[union-attr]
    store = replica.graph.store
    a.leave_part("kitchen")
    assert len(store.entries) == len(store.written_dots()) == 2
    store.join(Delta([Add(("late-kitchen.1", 1), "late", "cube")], context=[("late-kitchen.1", 1, 1)]))
    assert "late" not in a and not a._graph.store.by_key.get("late")


def test_one_who_holds_both_parts_buries_an_edge_and_who_holds_one_hears_of_it(net: Net) -> None:
    """An edge is made by one while another one removes the node at its end; a third one holds the edge's part only."""
    a, b = house(net)
    third = net.join("third", interest=())
    net.pump(1.0)
    for memory, parts in ((b, ("kitchen", "hall")), (third, ("kitchen",))):
        memory.hold_part(*parts)
    net.pump(1.0)
    net.network.partition(["a", "third"], ["b"])
    a.add_edge("cup", "ball", "on")
    b.remove_node("ball")
    net.pump(1.0)
    key = ("cup", "ball", "on")
    assert kept(third, key) and not kept(b, key)
    net.network.heal()
    net.pump(4.0)
    assert not any(kept(memory, key) for memory in (a, b, third))
    assert "ball" not in a and third.statistics.repairs <= 1


def test_without_the_other_part_nothing_is_buried(net: Net) -> None:
    """Only who does not hold the part of the edge removes the node at its end: nobody knows both."""
    a, b = house(net)
    b.hold_part("hall")
    net.pump(1.0)
    a.leave_part("hall")
    b.remove_node("ball")
    net.pump(3.0)
    assert kept(a, ("cup", "ball", "RT")) and [edge.key for edge in a.edges()] == [("world", "cup", "RT")]
    a.hold_part("hall")
    net.pump(3.0)
    assert not kept(a, ("cup", "ball", "RT"))


def test_who_may_not_remove_an_edge_keeps_it(net: Net) -> None:
    a, b = house(net)
    b.hold_part("hall")
    net.pump(1.0)
    graph(a).may_bury = lambda entry: False
    a.leave_part("hall")
    b.remove_node("ball")
    net.pump(3.0)
    a.hold_part("hall")
    net.pump(3.0)
    assert kept(a, ("cup", "ball", "RT")) and len(a.edges()) == 1


def test_edges_into_parts_that_are_not_held_are_not_looked_at_by_each_change(net: Net) -> None:
    a, b = house(net)
    for number in range(20):
        a.add_node(f"cup_{number}", "cube", "kitchen")
        a.add_edge("world", f"cup_{number}", "RT", pose=Pose())
    net.pump(1.5)
    assert b.edges() == [] and not graph(b)._unattached and len(graph(b)._beyond["kitchen"]) == 21
    plain = net.join("plain")
    net.pump(1.5)
    assert plain.edges() == [] and not plain._graph._unattached and len(plain._graph.store.entries) == 24
    a.remove_node("cup_1")
    a.remove_node("world")
    net.pump(1.5)
    assert len(plain._graph.store.entries) == len(graph(b).store.entries) == 2  # the list of parts


def test_a_state_that_was_taken_of_all_parts_is_restored_in_those_that_are_held(net: Net) -> None:
    a, _ = house(net)
    snapshot, other = a.snapshot(), Net()
    c = other.join("c", interest=("kitchen",))
    c.restore(snapshot)
    assert {node.name for node in c.nodes()} == {"world", "cup"} and [each.name for each in c.parts()] == [
        "hall", "kitchen",
    ]  # fmt: skip


def test_a_fork_begins_as_what_is_held_here_and_is_one_world(net: Net) -> None:
    a, b = house(net)
    fork = a.fork("idea")
    fork.update_node("cup", mass=5.0)
    net.pump(1.5)
    theirs = b.world("idea")
    net.pump(1.5)
    assert theirs.node("cup")["mass"] == 5.0 and theirs.transform("world", "ball").t == (1, 1, 0)
    assert a.node("cup")["mass"] == 1.0 and "cup" not in b


def test_an_overlay_shows_what_its_holder_holds_below(net: Net) -> None:
    a, b = house(net)
    layer = a.fork("layer", follow=True)
    layer.update_node("cup", mass=7.0)
    net.pump(1.5)
    theirs = b.world("layer")
    net.pump(1.5)
    assert "cup" not in theirs and "world" in theirs
    b.hold_part("kitchen")
    net.pump(1.5)
    assert theirs.node("cup")["mass"] == 7.0 and b.node("cup")["mass"] == 1.0
    b.leave_part("kitchen")
    net.pump(1.5)
    assert "cup" not in theirs and layer.node("cup")["mass"] == 7.0


def test_dots_of_another_part_are_left_out(net: Net) -> None:
    a, _ = house(net)
    kitchen = graph(a).parts["kitchen"]
    kitchen.join(Delta([Add(("x-hall.1", 1), "odd", "cube")], context=[("x-hall.1", 1, 1)]), 0.0)
    graph(a).join(Delta([Add(("x-kitchen.1", 1), "odd", "cube")], context=[("x-kitchen.1", 1, 1)]), 0.0)
    assert "odd" not in a and kitchen.store.foreign == graph(a).store.foreign == 1
    assert ("x-hall.1", 1) not in kitchen.store.context


def test_a_broken_off_change_leaves_all_parts_as_they_were(net: Net) -> None:
    a, _ = house(net)
    before = {node.name: dict(node) for node in a.nodes()}, sorted(edge.key for edge in a.edges())
    graph(a)._recover()
    assert ({node.name: dict(node) for node in a.nodes()}, sorted(edge.key for edge in a.edges())) == before
    assert a.transform("world", "ball").t == (1, 1, 0)


def test_a_replica_id_names_its_part_and_its_agent() -> None:
    rid, again = (part_rid("arm-1-7f3a", "kitchen", number) for number in (1, 2))
    assert rid.startswith("arm-1-kitchen.") and part_of(rid) == "kitchen" and rid != again
    assert [part_of(each) for each in ("arm-7f3a", "a.b-7f3aw1", "x.y", "r1", f"{rid}r000001deadbeef")] == [
        "", "", "", "", "kitchen",
    ]  # fmt: skip


def test_a_record_that_makes_no_sense_is_no_part(net: Net) -> None:
    a, _ = house(net)
    a.write_record(".part.odd", "part_record", "nonsense")
    a.write_record(".part.a-b", "part_record", "{}")
    a.write_record(".part.own", "part_record", '{"types": ["part_record", "world_record"]}')
    assert [each.name for each in a.parts()] == ["hall", "kitchen", "own"]
    a.create_part("lab")
    assert a.part(a.nodes("part_record")[-1]) == ""


def test_a_part_that_the_network_refuses_is_not_held(net: Net, monkeypatch: pytest.MonkeyPatch) -> None:
    a, b = house(net)

    def refuse(*_: object) -> None:
        raise TransportError("no more tokens")

    with monkeypatch.context() as patched, pytest.raises(TransportError, match="no more tokens"):
        patched.setattr(b.transport, "announce", refuse)
        b.hold_part("kitchen")
    net.pump(1.5)
    with pytest.raises(PartError, match="not held"):
        b.add_node("plate", "cube", "kitchen")
    assert b.interest == () and "cup" not in b
    b.hold_part("kitchen")
    b.add_node("plate", "cube", "kitchen")
    net.pump(1.5)
    assert "plate" in a and "cup" in b


def test_leaving_that_is_interrupted_leaves_nothing_in_sight_and_can_be_repeated(net: Net) -> None:
    a, b = house(net)
    line, interrupted = 1, True
    while interrupted:
        b.hold_part("kitchen")
        net.pump(1.0)
        b.update_node("cup", mass=float(line))
        interrupted = interrupted_at(line, lambda: b.leave_part("kitchen"))
        assert ("cup" in b) == ("kitchen" in graph(b).parts) == bool(graph(b).edges_out.get("world"))
        if interrupted and line % 2 and "kitchen" in b.interest:
            b.leave_part("kitchen")
            assert "cup" not in b and b.interest == ()
        line += 3
    net.pump(3.0)
    assert line > 50 and a.node("cup")["mass"] == line - 3


def test_the_list_is_read_again_after_an_interrupt(net: Net) -> None:
    a, _ = house(net)
    line, interrupted = 1, True
    while interrupted:
        a.write_record(".part.lab", "part_record", f'{{"created": {line}}}')
        interrupted = interrupted_at(line, a.parts)
        assert [(each.name, each.created) for each in a.parts()][2:] == [("lab", line)]
        line += 1
    assert line > 5


def test_into_a_part_that_is_not_granted_nothing_is_written(net: Net) -> None:
    a, b = house(net)
    b.hold_part("kitchen", "hall")
    net.pump(1.0)

    def check(part: str) -> None:
        if part == "hall":
            raise AgentError("not granted")

    graph(b).check_part = check
    b.update_node("cup", mass=4.0)
    with pytest.raises(AgentError, match="not granted"):
        b.update_node("ball", mass=4.0)
    a.add_edge("ball", "cup", "on")
    net.pump(1.0)
    with pytest.raises(AgentError, match="not granted"):
        b.remove_node("ball")
    assert b.remove_node("cup") and [edge.key for edge in b.edges()] == []
    net.pump(3.0)
    assert "cup" not in a and not kept(b, ("ball", "cup", "on")) and not kept(a, ("ball", "cup", "on"))


def kept(memory: Memory, key: tuple[str, str, str]) -> bool:
    return key in memory._graph.store.by_key


def graph(memory: Memory) -> PartedGraph:
    assert isinstance(memory._graph, PartedGraph)
    return memory._graph
