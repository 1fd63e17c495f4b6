"""What a hostile or broken peer may send: it costs little more memory than it sent, and few lines of log."""

from __future__ import annotations

import logging
import threading

import pytest

from dsr import Access, AgentError, CycleError, Faults, Memory, NodeTypeError, Pose, SchemaError
from dsr.clock import ManualClock
from dsr.crdt import pieces
from dsr.crdt import store as store_module
from dsr.crdt.context import CausalContext
from dsr.crdt.delta import TOMBSTONE, Add, Delta, Write
from dsr.crdt.hlc import stamp_at
from dsr.crdt.pieces import START, Piece
from dsr.crdt.store import MAX_MADE, Store
from dsr.errors import WireError
from dsr.graph.access import WriteGuard
from dsr.graph.graph import Graph
from dsr.graph.schema import MAX_LENGTH, RECORDS
from dsr.graph.stamping import MAX_WRITTEN
from dsr.persistence.content import GraphContent, NodeContent
from dsr.persistence.pending import PendingWrites
from dsr.replication import sync
from dsr.replication.inquiry import MAX_PAUSED
from dsr.replication.peers import MAX_PEERS
from dsr.replication.piece_wire import Request, decode_piece, encode_request
from dsr.replication.sync import Synchroniser
from dsr.replication.wire import Digest, decode_delta, decode_kept, encode_delta, encode_digest
from dsr.security.gate import Gate
from dsr.security.policy import Grant, checked
from tests.dsr.conftest import Net


@pytest.fixture
def synchroniser() -> Synchroniser:
    return Synchroniser(Graph("me-1"))


def digest(rid: str, now: float = 0.0, fingerprint: int = 0, seen: CausalContext | None = None) -> bytes:
    return encode_digest(Digest(rid, now, (seen or CausalContext()).summary(), fingerprint, ()))


def test_made_up_replicas_take_no_memory(synchroniser: Synchroniser, caplog: pytest.LogCaptureFixture) -> None:
    for number in range(2 * MAX_PEERS):
        synchroniser.receive_digest(f"peer{number}-1", digest(f"peer{number}-1", now=99.0), 0.0, 0.0)
        synchroniser.receive_delta(f"peer{number}-1", b"nonsense", 0.0)
    assert len(synchroniser.peers) == MAX_PEERS
    assert len(synchroniser.dropped) == MAX_PEERS + 1
    assert sum(synchroniser.dropped.values()) == synchroniser.dropped["others"] + MAX_PEERS == 2 * MAX_PEERS
    assert len(caplog.records) <= 2 * MAX_PEERS


def test_a_clock_that_jumps_to_and_fro_is_logged_once(
    synchroniser: Synchroniser, caplog: pytest.LogCaptureFixture
) -> None:
    for number in range(100):
        synchroniser.receive_digest("peer", digest("peer", now=99.0 * (number % 2)), float(number), 0.0)
    assert [record.levelno for record in caplog.records] == [logging.WARNING]


def test_lies_about_the_state_are_logged_once(synchroniser: Synchroniser, caplog: pytest.LogCaptureFixture) -> None:
    synchroniser.joined = True
    for second in range(10):
        synchroniser.receive_digest("peer", digest("peer", fingerprint=5), float(second), 0.0)
        synchroniser.tick(second + 0.5, 0.0)
        synchroniser.request_done("peer")
    assert [record.levelno for record in caplog.records] == [logging.WARNING]


def test_a_reply_on_the_key_of_deltas_deletes_nothing(net: Net) -> None:
    memory, stranger = net.join("a"), net.network.connect("stranger")
    memory.add_node("x", "cube")
    reply = Delta(context=list(memory._graph.store.context.ranges()), live=frozenset())
    stranger.publish(memory.keys.delta("stranger"), encode_delta(reply))
    net.pump()
    assert "x" in memory and memory.dropped == {"stranger": 1}


def test_writes_to_what_never_comes_are_bounded_in_length_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store_module, "MAX_WAITING", 100)
    store = Store()
    for number in range(1, 200):
        write = Write(("nobody", number), "note", 1, "w", ("w", number), "x" * 1000)
        store.join(Delta(writes=[write], context=[("w", number, number)]))
    assert sum(map(len, store._waiting.values())) < 20 and store.lost_waiting > 180


@pytest.mark.parametrize("value", ["x" * (MAX_LENGTH + 1), "\ud800"])
def test_text_that_cannot_be_sent_is_refused_where_it_is_written(net: Net, value: str) -> None:
    memory = net.join("a")
    with pytest.raises(SchemaError, match="note"):
        memory.add_node("x", "cube", note=value)
    assert "x" not in memory


def test_values_without_end_are_refused(net: Net) -> None:
    write = Write(("w", 1), "note", 1, "w", ("w", 1), "x" * (MAX_LENGTH + 1))
    with pytest.raises(WireError):
        decode_delta(encode_delta(Delta(writes=[write])))


def test_all_attributes_can_be_read_while_another_thread_takes_them_away() -> None:
    """As for `dict(node)`, which may fail then."""
    from dsr import LocalNetwork

    clock = ManualClock()
    memory = Memory("g", "a", transport=LocalNetwork(clock).connect("a"), clock=clock)
    node = memory.add_node("x", "cube", mass=1.0)
    stop = threading.Event()

    def change() -> None:
        while not stop.is_set():
            memory.remove_attribute("x", "mass")
            memory.update_node("x", mass=1.0)

    thread = threading.Thread(target=change)
    thread.start()
    try:
        seen = [node.attributes for _ in range(5000)]
    finally:
        stop.set()
        thread.join()
    assert all(attributes in ({}, {"mass": 1.0}) for attributes in seen)


def test_values_of_the_wrong_kind_are_read_alike_everywhere(net: Net) -> None:
    """No replica drops by its own taste what another one holds: what no such attribute has all read as taken away."""
    a, b, stranger = net.join("a"), net.join("b"), net.network.connect("stranger")
    a.add_node("x", "cube", mass=1.0)
    a.add_node("y", "cube")
    a.add_edge("x", "y", "RT", translation=(1, 0, 0))
    net.pump(1.0)
    (node,), (edge,) = a.node("x")._entries, a.edge("x", "y", "RT")._entries
    writes = [
        Write(node.dot, "mass", 1 << 61, "stranger", ("stranger", 1), "heavy"),
        Write(edge.dot, "pose", 1 << 61, "stranger", ("stranger", 2), 7),
    ]
    delta = Delta(writes=writes, context=[("stranger", 1, 2)])
    stranger.publish(a.keys.delta("stranger"), encode_delta(delta))
    net.pump(1.0)
    late = net.join("late")
    net.pump(1.0)
    for memory in (a, b, late):
        assert "mass" not in memory.node("x") and "pose" not in memory.edge("x", "y", "RT")
        assert memory.edge("x", "y", "RT").get("translation") is None


@pytest.mark.parametrize("kind", sorted(RECORDS))
def test_a_record_that_nests_without_end_is_no_record_and_stops_nobody(net: Net, kind: str) -> None:
    a, b = net.join("a", interest=()), net.join("b", interest=())
    net.pump(0.5)
    a.write_record(f"{RECORDS[kind]}bad", kind, '{"x":' + "[" * 9000 + "]" * 9000 + "}")
    net.pump(0.5)
    a.add_node("cube", "cube")
    net.pump(0.5)
    assert "cube" in b and b.parts() == [] and [world.name for world in b.worlds()] == ["base"]
    b.schema.register_node_type("drone", "what flies")
    b.add_node("d1", "drone")
    net.pump(0.5)
    assert "d1" in a


def test_an_edge_is_bound_to_the_nodes_that_it_names(net: Net) -> None:
    """Else an edge is seen of which an end is not there: whoever follows it fails."""
    memory, liar = net.join("me"), "liar-1"
    ends = [tuple(memory.add_node(name, "cube").created) for name in ("a", "b")]
    memory.add_edge("a", "b", "on")
    keys = [("nowhere", "b", "on"), ("a", "nowhere", "on"), ("b", "a", "on"), ("a", "b", "near")]
    adds = [Add((liar, number + 1), key, key[2], *ends) for number, key in enumerate(keys)]
    edge = next(iter(memory.edge("a", "b", "on").created))
    adds.append(Add((liar, 5), ("a", "b", "in"), "in", (edge,), ends[1]))  # bound to an edge
    memory.replica.synchroniser.receive_delta(liar, encode_delta(Delta(adds=adds, context=[(liar, 1, 5)])), 0.0)
    assert {edge.key for edge in memory.edges()} == {("a", "b", "on"), ("a", "b", "near")}
    assert len(memory.replica.graph.store.entries) == 4, "what can never be seen is kept"
    assert not memory.dropped


@pytest.mark.parametrize("type", ["cube", "part_record"])
def test_no_other_node_takes_the_name_of_an_entry_about_the_graph(net: Net, type: str) -> None:
    """Else who may make cubes hides the list of worlds, and so deletes them for all."""
    memory = net.join("me")
    world, liar = memory.create_world("dream"), "zz-1"
    for number, (name, kind) in enumerate(((".world.dream", type), ("plain", "world_record"))):
        delta = Delta(adds=[Add((liar, number + 1), name, kind)], context=[(liar, number + 1, number + 1)])
        memory.replica.synchroniser.receive_delta(liar, encode_delta(delta), 0.0)
        with pytest.raises(WireError):
            decode_delta(encode_delta(delta))
    memory.poll()
    assert [info.name for info in memory.worlds()] == ["base", "dream"] and not world.closed
    assert memory.dropped[liar] == 2


def test_what_an_older_version_kept_of_such_nodes_is_left_out() -> None:
    delta = Delta(adds=[Add(("a-1", 1), ".world.dream", "cube"), Add(("a-1", 2), "b", "cube")], context=[("a-1", 1, 2)])
    kept = decode_kept(encode_delta(delta))
    assert kept.adds == delta.adds[1:] and kept.context == delta.context


def test_an_edge_is_of_the_type_that_its_key_tells(net: Net) -> None:
    """Rights are told by the type: who may write one kind of edges would write all."""
    memory, liar = net.join("me"), "liar-1"
    ends = [tuple(memory.add_node(name, "cube").created) for name in ("a", "b")]
    memory.add_edge("a", "b", "on")
    delta = Delta(adds=[Add((liar, 1), ("a", "b", "on"), "sees", *ends)], context=[(liar, 1, 1)])
    memory.replica.synchroniser.receive_delta(liar, encode_delta(delta), 0.0)
    assert len(memory.edge("a", "b", "on").created) == 1 and memory.dropped == {liar: 1}
    kept = decode_kept(encode_delta(delta))
    assert not kept.adds and kept.context == delta.context, "an older version may have kept it"


def test_who_is_called_by_a_pattern_is_not_asked_as_all_who_match(
    net: Net, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Answers of several would be taken for pieces of one: what one of them has seen, another one may not hold yet."""
    monkeypatch.setattr(pieces, "MAX_EXAMINED", 20)
    honest, stranger = [net.join("a"), net.join("b")], net.network.connect("stranger")
    stranger.announce(honest[0].keys.presence("x", "*"))
    for step in range(200):
        for memory in honest[:2]:
            memory.add_node(f"{memory.agent}{step}", "cube")
        if step % 50 == 25:
            honest.append(net.join(f"late{step}"))
        if step % 10 == 0:
            seen = CausalContext([("*", 1, step + 1)])
            stranger.publish(honest[0].keys.digest("*"), digest("*", net.clock.now(), 5, seen))
        net.pump(0.05, Faults(loss=0.1, delay=(0.0, 0.3)))
    net.pump(20.0)
    assert [len(memory.nodes()) for memory in honest] == [400] * len(honest)
    assert all("*" not in memory.peers for memory in honest)


def test_a_circle_with_edges_of_others_keeps_nobody_from_writing_what_it_measures(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    net.pump(1.0)
    for name in ("world", "arm", "hand"):
        a.add_node(name, "object")
    a.add_edge("world", "arm", "RT", pose=Pose())
    net.pump(1.0)
    b.add_edge("hand", "arm", "RT", pose=Pose(stamp=5.0))
    net.pump(1.0)
    a.add_edge("arm", "hand", "RT", pose=Pose((1, 0, 0)))
    with pytest.raises(CycleError, match="'hand' -> 'arm' -> 'hand'"):
        a.transform("world", "hand")
    with pytest.raises(CycleError, match="remove another one first"):
        a.add_edge("hand", "world", "RT", pose=Pose())
    b.remove_edge("hand", "arm", "RT")
    net.pump(1.0)
    assert a.transform("world", "hand").t == b.transform("world", "hand").t == (1, 0, 0)


@pytest.mark.parametrize("gated", [False, True])
def test_replicas_that_were_told_different_things_under_one_dot_end_equal(net: Net, gated: bool) -> None:
    """A dot of two meanings has none: each of them removes what it holds under it."""
    policy = checked({name: Grant(("*",), ("*",), ("*",), trusted=name != "liar") for name in ("a", "b", "c", "liar")})
    gates = [Gate(policy) if gated else None for _ in range(3)]
    a, b, c = (net.join(name, gate=gate) for name, gate in zip("abc", gates, strict=True))
    net.pump(2.0)
    for name in ("world", "honest"):
        a.add_node(name, "world" if name == "world" else "cube")
    net.pump(1.0)
    ends = [tuple(a.node(name).created) for name in ("world", "honest")]
    told = [
        [Add(("liar-1", 1), "x", "cube"), Add(("liar-1", 2), ("world", "honest", "on"), "on", *ends)],
        [Add(("liar-1", 1), "y", "cube"), Add(("liar-1", 2), ("world", "honest", "in"), "in", *ends)],
        [Add(("liar-1", 1), "x", "ball"), Add(("liar-1", 2), ("honest", "world", "on"), "on", *ends[::-1])],
    ]
    for memory, adds in zip((a, b, c), told, strict=True):
        delta = encode_delta(Delta(adds, context=[("liar-1", 1, 2)]))
        memory.replica.synchroniser.receive_delta("liar-1", delta, net.clock.now())
    net.pump(6.0)
    late = net.join("d", gate=Gate(policy) if gated else None)
    net.pump(6.0)
    for memory in (a, b, c, late):
        assert {node.name for node in memory.nodes()} == {"world", "honest"} and memory.edges() == []
        assert memory.replica.graph.store.fingerprint == a.replica.graph.store.fingerprint


def test_of_two_values_under_one_dot_whoever_gets_both_shows_the_same() -> None:
    stores = [Store(), Store()]
    add = Delta([Add(("a-1", 1), "x", "cube")], context=[("a-1", 1, 1)])
    values: list[object] = [1, 1.0, True, "1", b"1", (1.0,), Pose(), Pose((1, 0, 0)), TOMBSTONE]
    for first in values:
        for second in values:
            for store, order in zip(stores, ((first, second), (second, first)), strict=True):
                store.__init__()  # type: ignore[misc]
                store.join(add)
                pending = PendingWrites()
                for value in order:
                    delta = Delta(writes=[Write(("a-1", 1), "note", 5, "z-1", ("z-1", 1), value)])
                    store.join(delta)
                    pending.add(delta)
                (kept,) = pending.take()[0].writes
                assert repr(kept.value) == repr(store.entries["a-1", 1].registers["note"].value)
            one, other = (store.entries["a-1", 1].registers["note"].value for store in stores)
            assert type(one) is type(other) and repr(one) == repr(other)


def test_who_makes_one_thing_thousands_of_times_makes_no_write_long(net: Net) -> None:
    """One message: each write goes to all incarnations, and each look at the node looks at all."""
    a, b = net.join("a"), net.join("b")
    a.add_node("arm", "arm")
    a.add_node("world", "world")
    a.add_edge("world", "arm", "RT", pose=Pose())
    net.pump(1.0)
    ends = [tuple(a.node(name).created) for name in ("world", "arm")]
    adds = [Add(("liar-1", number), "arm", "arm") for number in range(1, 301)]
    adds += [Add(("liar-1", number), ("world", "arm", "RT"), "RT", *ends) for number in range(301, 601)]
    for memory, order in ((a, adds), (b, adds[::-1])):
        for first in range(0, 600, 50):
            part = sorted(add.dot for add in order[first : first + 50])
            delta = Delta(order[first : first + 50], context=[("liar-1", part[0][1], part[-1][1])])
            memory.replica.synchroniser.receive_delta("liar-1", encode_delta(delta), net.clock.now())
    net.pump(5.0)
    for memory in (a, b, net.join("c")):
        net.pump(1.0)
        for element in (memory.node("arm"), memory.edge("world", "arm", "RT")):
            assert len(element.created) == 1 + MAX_MADE
    written = len(a.replica.graph.write(a.node("arm"), {"status": "well"}, net.clock.now()).writes)
    assert written == 1 + MAX_MADE


def test_what_many_made_up_replicas_have_made_makes_no_write_long_and_the_newest_write_is_shown(net: Net) -> None:
    """One answer may hold thousands of incarnations of a node, each by another replica."""
    a, b = net.join("a"), net.join("b")
    dots = [*a.add_node("arm", "arm").created]
    net.pump(1.0)
    late = stamp_at(net.clock.now() + 60.0)
    adds = [Add((f"liar{number}-1", 1), "arm", "arm") for number in range(500)]
    writes = [Write(add.dot, "status", late, "z-1", None, "theirs") for add in adds]
    for memory in (a, b):
        memory.replica.graph.join(Delta(adds, writes, context=[(*add.dot, 1) for add in adds]), net.clock.now())
    delta = a.replica.graph.write(a.node("arm"), {"status": "mine"}, net.clock.now())
    assert len(delta.writes) == MAX_WRITTEN and dots[0] in {write.owner for write in delta.writes}
    a.replica.commit(delta)
    net.pump(3.0)
    assert a.node("arm")["status"] == b.node("arm")["status"] == "mine"


def test_who_asks_by_a_pattern_gets_no_long_answers(net: Net) -> None:
    memory, stranger = net.join("a"), net.network.connect("stranger")
    memory.add_node("x", "cube")
    replies: list[str] = []
    request = encode_request(Request("stranger-1", CausalContext(), START, insists=True))
    for key in (memory.keys.sync("*"), memory.keys.sync(memory.rid)):
        stranger.request(key, request, lambda place, _reply: replies.append(place), lambda: None, 1.0)
        net.pump(0.1)
    assert replies == [memory.keys.sync(memory.rid)]


def test_answers_are_read_while_writers_work(net: Net, monkeypatch: pytest.MonkeyPatch) -> None:
    """Long ones take as long as a hundred writes."""
    memory = net.join("a")
    free: list[bool] = []

    def try_to_lock() -> None:
        free.append(memory.replica.lock.acquire(blocking=False))
        if free[-1]:
            memory.replica.lock.release()

    def decode(payload: bytes) -> Piece:
        writer = threading.Thread(target=try_to_lock)
        writer.start()
        writer.join()
        return decode_piece(payload)

    monkeypatch.setattr(sync, "decode_piece", decode)
    other = net.join("b")
    other.add_node("x", "cube")
    net.pump(3.0)
    assert free and all(free)


def test_liars_that_answer_one_question_without_end_take_no_memory(net: Net) -> None:
    memory = net.join("a")
    memory.add_node("x", "cube")
    replica, places = memory.replica, threading.Semaphore(MAX_PAUSED)
    for _ in range(100):
        replica._take_in("liar-1", 1, b"nonsense", places)
    assert len(replica._inbox) < 10 and replica.skipped > 90
    net.pump(1.0)
    late = net.join("b")
    net.pump(3.0)
    late.add_node("y", "cube")
    net.pump(3.0)
    assert "y" in memory and "x" in late and memory.dropped["liar-1"] < 10


def test_a_liar_that_floods_one_question_leaves_the_answers_to_others(net: Net) -> None:
    replica = net.join("a").replica
    flooded, honest = threading.Semaphore(MAX_PAUSED), threading.Semaphore(MAX_PAUSED)
    for _ in range(100):
        replica._take_in("liar-1", 1, b"nonsense", flooded)
    skipped = replica.skipped
    replica._take_in("b-1", 2, b"nonsense", honest)
    assert skipped > 90 and replica.skipped == skipped


def test_what_others_have_hung_in_a_circle_keeps_nobody_from_loading_a_file(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    for name in ("x", "y"):
        a.add_node(name, "cube")
    net.pump(1.0)
    a.add_edge("x", "y", "RT", pose=Pose())
    b.add_edge("y", "x", "RT", pose=Pose())
    net.pump(1.0)
    loader = net.join("loader")
    net.pump(1.0)
    GraphContent("g", nodes={"z": NodeContent("cube", {})}).put_into(loader)
    assert "z" in loader


@pytest.mark.parametrize("durable", [True, False])
def test_of_two_values_under_one_stamp_all_show_the_same(net: Net, durable: bool) -> None:
    a, b, liar = net.join("a"), net.join("b"), "zz-1"
    net.pump(1.0)
    for name in ("x", "y"):
        a.add_node(name, "cube")
    a.add_edge("x", "y", "RT", translation=(0, 0, 0))
    net.pump(1.0)
    (edge,) = a.edge("x", "y", "RT")._entries
    stamp = edge.registers["pose"].stamp + (1 << 30)

    def send(number: int, memory: Memory) -> None:
        dot = (liar, number) if durable else None
        write = Write(edge.dot, "pose", stamp, liar, dot, Pose((float(number), 0.0, 0.0)))
        delta = Delta(writes=[write], context=[(liar, number, number)] if durable else [])
        memory.replica.synchroniser.receive_delta(liar, encode_delta(delta), net.clock.now())

    watch = a.watch(edge_type="RT")
    watch.poll()
    send(1, a)
    send(2, b)
    if durable:
        send(2, a)
        send(1, b)
        assert [change.kind for change in watch.poll()] == ["updated"]
    net.pump(10.0)
    late = net.join("late")
    net.pump(2.0)
    shown = {memory.edge("x", "y", "RT").pose.t for memory in (a, b, late)}
    assert len(shown) == 1


def test_who_made_a_node_goes_on_with_it_whatever_others_make_of_it(net: Net) -> None:
    """Of the types of a node that several have made all see one. Before, its owner failed in each tick."""
    guard = WriteGuard("arm", Access(("body",), (), ("mass",)))
    arm, liar = net.join("arm", guard=guard), net.join("zz")
    net.pump(1.0)
    arm.add_node("link", "body", mass=1.0)
    delta = Delta(adds=[Add(("zz-9", 1), "link", "event")], context=[("zz-9", 1, 1)])
    for memory in (arm, liar):
        memory.replica.synchroniser.receive_delta("zz-9", encode_delta(delta), 0.0)
        assert memory.node("link").type == "event"
    arm.add_node("link", "body", mass=2.0)
    arm.update_node("link", mass=3.0)
    arm.remove_attribute("link", "mass")
    with pytest.raises(NodeTypeError, match="'event', not a 'cube'"):
        liar.add_node("link", "cube")
    with pytest.raises(AgentError, match="of type 'event'"):
        arm.update_node("link", status="mine")
    with pytest.raises(AgentError, match="of type 'event'"):
        arm.remove_node("link")  # with it would go what the other one made


@pytest.mark.parametrize("kind", ["delta", "digest", "request"])
def test_a_long_message_is_read_while_writers_go_on(net: Net, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    """The longest take 0.2 s to read. Whoever sent them all the time held up each write by that."""
    memory, liar = net.join("me"), "liar-1"
    memory.add_node("x", "cube")
    synchroniser, written = memory.replica.synchroniser, threading.Event()
    decode = getattr(sync, f"decode_{kind}")

    def write() -> None:
        memory.update_node("x", mass=2.0)
        written.set()

    def slowly(payload: bytes) -> object:
        threading.Thread(target=write).start()
        assert written.wait(10.0)
        return decode(payload)

    monkeypatch.setattr(sync, f"decode_{kind}", slowly)
    monkeypatch.setattr(memory.replica, "_sender", threading.current_thread())  # messages are joined as they come
    if kind == "request":
        asked = encode_request(Request(liar, CausalContext(), START, insists=True))
        assert memory.replica._answer(memory.keys.sync(memory.rid), asked)
        return
    stranger = net.network.connect("stranger")
    if kind == "delta":
        added = Delta([Add((liar, 1), "y", "cube")], context=[(liar, 1, 1)])
        stranger.publish(memory.keys.delta(liar), encode_delta(added))
    else:
        stranger.publish(memory.keys.digest(liar), digest(liar))
    net.network.deliver()
    assert "y" in memory if kind == "delta" else synchroniser.heard == [liar]
