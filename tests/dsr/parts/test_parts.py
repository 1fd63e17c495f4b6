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
from dsr.crdt.context import CausalContext
from dsr.crdt.delta import Add, Delta
from dsr.graph.elements import Node
from dsr.graph.graph import Graph
from dsr.graph.schema import PART_RECORD
from dsr.network.keys import Keys, part_of, part_rid
from dsr.parts.graph import PartedGraph
from dsr.parts.registry import node_name, read_record, to_attribute
from dsr.replication.wire import Digest, encode_delta, encode_digest
from dsr.security.gate import Gate
from dsr.security.policy import Grant, checked, standard_grants
from tests.dsr.conftest import Net, reply_of
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


def test_dots_of_another_part_are_dropped_by_everybody_alike(net: Net, caplog: pytest.LogCaptureFixture) -> None:
    """Else those who hold no parts would keep what the others leave out, and all would ask each other for ever."""
    a, b = house(net)
    plain, evil = net.join("plain"), net.network.connect("evil")
    b.hold_part("kitchen")
    net.pump(2.0)
    base, kitchen, rid = Keys("g"), Keys("g", part="kitchen"), "evil-hall.1"
    add = Delta([Add((rid, 1), "odd", "cube")], context=[(rid, 1, 1)])
    removal = Delta(removed=[("x-hall.1", 7)], context=[("evil-1", 1, 1)])
    for keys, sender, delta in ((base, rid, add), (kitchen, rid, add), (base, "evil-1", removal)):
        evil.publish(keys.delta(sender), encode_delta(delta))
    evil.serve(base.sync("evil-1"), lambda *_: reply_of(add))
    evil.announce(base.presence("evil", "evil-1"))
    seen = CausalContext(add.context).summary()
    evil.publish(base.digest("evil-1"), encode_digest(Digest("evil-1", net.clock.now(), seen, 1, ())))
    net.pump(5.0)
    for memory in (a, b, plain):
        assert "odd" not in memory and not any("hall" in rid for rid, _, _ in memory._graph.store.context.ranges())
    assert a.dropped[rid] == 1 and b.replica.synchroniser.dropped[rid] == plain.dropped[rid] == 1
    assert plain.dropped["evil-1"] > 1
    asked = [memory.replica.synchroniser.inquiry._requests for memory in (a, b, plain)]
    evil.close()
    net.pump(20.0)
    more = [memory.replica.synchroniser.inquiry._requests for memory in (a, b, plain)]
    assert max(later - before for later, before in zip(more, asked, strict=True)) <= 2


def test_a_state_with_parts_is_refused_where_none_can_be_held(net: Net) -> None:
    a, _ = house(net)
    other = Net().join("plain")
    with pytest.raises(PartError, match="a snapshot with parts hall, kitchen: this memory holds no parts"):
        other.restore(a.snapshot())
    assert not other.nodes("part_record") and other.nodes() == []


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


def test_a_type_that_a_part_claims_stops_nobody_who_does_not_hold_it(net: Net) -> None:
    """Whoever may list a part could stop all others from making objects otherwise."""
    a, b = house(net)
    a.write_record(".part.aaa", "part_record", '{"types": ["object", "ball", "nonsense"]}')
    net.pump(1.0)
    b.add_node("chair", "object")
    b.add_node("ball_2", "ball")
    a.add_node("ball_3", "ball")
    net.pump(1.0)
    assert [b.part(b.node(name)) for name in ("chair", "ball_2")] == ["", ""]
    assert a.part(a.node("ball_3")) == "hall"  # it holds the part that lists the type later, and not the other one
    a.hold_part("aaa")
    a.add_node("ball_4", "ball")
    assert a.part(a.node("ball_4")) == "aaa"
    graph(a).check_part = lambda part: _refuse(part, "aaa")
    a.add_node("ball_5", "ball")
    assert a.part(a.node("ball_5")) == "hall"


def _refuse(part: str, refused: str) -> None:
    if part == refused:
        raise AgentError("not granted")


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


def test_leaving_that_is_interrupted_and_repeated_loses_no_write(net: Net) -> None:
    a, b = house(net)
    a.add_node("plate", "cube", "kitchen")
    a.add_edge("cup", "plate", "RT", pose=Pose())
    line, interrupted = 1, True
    while interrupted:
        b.hold_part("kitchen")
        net.pump(1.0)
        b.update_node("cup", mass=float(line))
        b.update_edge("cup", "plate", "RT", pose=Pose((line, 0, 0)))
        interrupted = interrupted_at(line, lambda: b.leave_part("kitchen"))
        if "kitchen" in b.interest:
            b.leave_part("kitchen")
        net.pump()
        assert a.node("cup")["mass"] == line, line
        assert a.edge("cup", "plate", "RT").pose == Pose((line, 0, 0)), line
        line += 2
    assert line > 100


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


def test_a_closed_memory_takes_no_part(net: Net) -> None:
    _, b = house(net)
    b.close()
    with pytest.raises(TransportError, match="is closed"):
        b.hold_part("kitchen")
    assert b.interest == ()


def test_an_edge_whose_own_end_turns_out_to_be_removed_is_buried() -> None:
    """It came before its source, which was removed before it came here, and waits for a part that is not held, too."""
    parted, plain = PartedGraph("p-1"), Graph("q-1")
    source, end, edge = ("w-1", 1), ("w-hall.1", 1), ("w-1", 2)
    add = Delta([Add(edge, ("cup", "ball", "on"), "on", (source,), (end,))], context=[("w-1", 2, 2)])
    for one in (parted, plain):
        one.join(add, 0.0)
        assert edge in one.store.entries
        one.join(Delta(removed=[source], context=[("v-1", 1, 1)]), 0.0)
        assert not one.store.entries and not one._unattached
    assert not parted._beyond and parted.store.fingerprint == plain.store.fingerprint == 0


def test_an_edge_that_waits_for_two_parts_is_buried_when_both_have_told() -> None:
    graph = PartedGraph("p-1")
    source, ends, edge = ("w-1", 1), (("w-hall.1", 1), ("w-lab.1", 1)), ("w-1", 2)
    adds = [Add(source, "cup", "cube"), Add(edge, ("cup", "ball", "on"), "on", (source,), ends)]
    graph.join(Delta(adds, context=[("w-1", 1, 2)]), 0.0)
    assert set(graph._beyond) == {"hall", "lab"}
    hall = graph.hold("hall", "p-hall.1")
    hall.join(Delta(removed=[ends[0]], context=[("v-hall.1", 1, 1)]), 0.0)
    assert edge in graph.store.entries and "hall" not in graph._beyond
    lab = graph.hold("lab", "p-lab.1")
    lab.join(Delta(removed=[ends[1]], context=[("v-lab.1", 1, 1)]), 0.0)
    assert graph.make_durable().removed == [edge] and not graph._beyond


def test_edges_that_are_gone_leave_no_trace_of_the_parts_for_which_they_waited(net: Net) -> None:
    a, b = house(net)
    assert set(graph(b)._beyond) == {"kitchen"}
    a.remove_node("cup")
    net.pump(1.5)
    assert graph(b)._beyond == {}


def test_of_the_list_of_parts_only_what_has_changed_is_read_again(net: Net, monkeypatch: pytest.MonkeyPatch) -> None:
    """One short message must not have everybody read all that anybody has ever listed."""
    a, b = house(net)
    for number in range(20):
        a.create_part(f"room_{number:02}", types=("ball",))
    net.pump(1.0)
    assert len(b.parts()) == 22
    read: list[str] = []

    def noted(node: Node) -> PartInfo | None:
        read.append(node.name)
        return read_record(node)

    monkeypatch.setattr("dsr.parts.registry.read_record", noted)
    b.write_record(node_name("room_07"), PART_RECORD, to_attribute(PartInfo("room_07", ("cube",), "b", 1.0)))
    assert next(info for info in b.parts() if info.name == "room_07").types == ("cube",)
    assert read == [node_name("room_07")]
    listed = b._parts("test").listed
    assert "room_07" not in listed.claiming("ball") and len(listed.claiming("ball")) == 20
    assert listed.claiming("cube") == ["room_07"] and not listed.claiming(PART_RECORD)


def test_what_another_has_made_of_a_name_in_another_part_keeps_nobody_from_making_a_node(net: Net) -> None:
    """Where rights are told, one message would else keep the maker from its name for ever."""
    grants = {
        "cook": Grant(("part_record", "cube"), (), ("mass",), trusted=True), "guest": Grant(("ball",)),
        **standard_grants(),
    }  # fmt: skip
    cook, guest = (net.join(agent, interest=(), gate=Gate(checked(grants))) for agent in ("cook", "guest"))
    net.pump(1.0)
    cook.create_part("kitchen", types=("cube",))
    net.pump(1.0)
    guest.add_node("cup", "ball")
    guest.add_node("plate", "ball")
    net.pump(1.0)
    cook.add_node("cup", "cube", "kitchen", mass=1.0)
    cook.add_node("plate", "cube", mass=2.0)
    net.pump(1.0)
    for name in ("cup", "plate"):
        made = {dot for dot in cook.node(name).created if dot[0].startswith("cook")}
        assert {part_of(rid) for rid, _ in made} == {"kitchen"}
    with pytest.raises(PartError, match="in part 'kitchen'"):
        cook.add_node("cup", "cube", "")
    guest.hold_part("kitchen")
    net.pump(1.0)
    assert guest.node("cup")["mass"] == 1.0 and guest.node("plate")["mass"] == 2.0
