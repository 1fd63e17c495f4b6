"""Several memories of one graph: joining, partitions, batches, streams, what one of them does to the others."""

from __future__ import annotations

import contextlib
from typing import Any
from unittest import mock

import pytest

from dsr import ClockDriftError, Faults, ManualClock, Pose, TransportError
from dsr.crdt import pieces
from dsr.crdt.delta import Delta, Write
from dsr.network.transport import Qos
from dsr.replication.wire import decode_delta, encode_delta
from tests.dsr.conftest import Net, tabletop


def test_a_newcomer_gets_everything(net: Net) -> None:
    first = net.join("a")
    tabletop(first)
    net.pump(1.5)
    first.update_edge("world", "cube_3", "RT", pose=Pose((9, 9, 9), stamp=6.0))
    late = net.join("late")
    net.pump(0.3)
    assert late.joined and late.transform("world", "cube_3").t == (9, 9, 9)
    assert late.peers == [first.rid] and first.peers == [late.rid]


def test_a_newcomer_asks_for_the_next_piece_before_it_joins_the_last_one(net: Net, monkeypatch: Any) -> None:
    """Else one replica of the two waits for the other all the time."""
    monkeypatch.setattr(pieces, "MAX_EXAMINED", 10)
    first = net.join("a")
    first.replica.synchroniser.nobody_there()
    for index in range(35):
        first.add_node(f"node_{index}", "cube", mass=1.0)
    net.pump()
    steps: list[str] = []
    late = net.join("late")
    join, request = late._graph.join, late.transport.request
    with (
        mock.patch.object(late._graph, "join", lambda *given: (steps.append("join"), join(*given))),
        mock.patch.object(late.transport, "request", lambda *given: (steps.append("ask"), request(*given))),
    ):
        net.pump(1.0)
    assert late.joined and len(late.nodes()) == 35
    assert steps[:7] == ["ask", "ask", "join", "ask", "join", "ask", "join"]


def test_a_piece_that_cannot_be_joined_is_not_counted_as_seen(net: Net, monkeypatch: Any) -> None:
    monkeypatch.setattr(pieces, "MAX_EXAMINED", 10)
    first = net.join("a")
    first.replica.synchroniser.nobody_there()
    for index in range(35):
        first.add_node(f"node_{index}", "cube", mass=1.0)
    net.pump()
    late = net.join("late")
    fails, join = iter([False, True]), late._graph.join

    def sometimes(delta: Delta, now: float) -> None:
        if next(fails, False):
            raise MemoryError
        join(delta, now)

    with mock.patch.object(late._graph, "join", sometimes):
        for _ in range(100):
            with contextlib.suppress(MemoryError):
                net.pump(0.1)
    assert late.joined and len(late.nodes()) == len(first.nodes()) == 35


def test_both_sides_of_a_partition_merge(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    tabletop(a)
    net.pump(0.5)
    net.network.partition(["a"], ["b"])
    for index in range(100):
        a.add_node(f"a_{index}", "ball")
        b.add_node(f"b_{index}", "ball")
        net.clock.advance(0.001)
    a.update_node("cube_3", mass=1.0)
    b.update_node("cube_3", mass=2.0)
    net.pump(5.0)
    assert len(a.nodes("ball")) == 100
    net.network.heal()
    net.pump(2.0)
    for memory in (a, b):
        assert len(memory.nodes("ball")) == 200 and memory.node("cube_3")["mass"] == 2.0


def test_concurrent_creation_is_one_node_and_keeps_both_writers_attributes(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    a.add_node("cube_3", "cube", mass=1.0)
    b.add_node("cube_3", "box", marker_id=3)
    net.pump()
    assert dict(a.node("cube_3")) == dict(b.node("cube_3")) == {"mass": 1.0, "marker_id": 3}
    assert a.node("cube_3").type == b.node("cube_3").type
    assert len(a.nodes()) == len(a.nodes(a.node("cube_3").type)) == 1


def test_removal_beats_a_concurrent_write_and_a_new_creation_beats_the_removal(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    a.add_node("cube_3", "cube", mass=1.0)
    net.pump()
    a.remove_node("cube_3")
    b.update_node("cube_3", mass=2.0)
    net.pump()
    assert "cube_3" not in a and "cube_3" not in b
    a.add_node("cube_3", "cube")
    net.pump()
    assert "mass" not in b.node("cube_3")


def test_batches_leave_as_one_message(net: Net) -> None:
    a, seen = net.join("a"), []
    net.network.connect("tap").subscribe("dsr/v1/g/d/*", lambda key, payload: seen.append(payload))
    with a.batch():
        tabletop(a)
    net.pump()
    assert len(seen) == 1


def test_streams_send_the_newest_sample_only_and_make_durable(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    tabletop(a)
    net.pump(0.1)
    streamed: list[bytes] = []
    net.network.connect("tap").subscribe("dsr/v1/g/rt/*", lambda key, payload: streamed.append(payload))
    for index in range(10):
        a.update_edge("world", "cube_3", "RT", pose=Pose((index, 0, 0), stamp=10.0 + index))
    from dsr import Faults

    net.pump(0.1, Faults(loss=1.0))
    assert b.transform("world", "cube_3").t[0] == 0.3
    net.pump(1.5)
    assert b.transform("world", "cube_3").t[0] == 9 and not streamed


def test_malformed_messages_are_counted_and_change_nothing(net: Net, caplog: pytest.LogCaptureFixture) -> None:
    a = net.join("a")
    tabletop(a)
    net.pump()
    noise = net.network.connect("noise")
    for key in ("d/bad", "rt/bad", "dig/bad"):
        for payload in (b"", b"\xc1", b"x" * 100):
            noise.publish(f"dsr/v1/g/{key}", payload)
    replies: list[bytes] = []
    noise.request(f"dsr/v1/g/sync/{a.rid}", b"nonsense", lambda _, r: replies.append(r), lambda: None, 1.0)
    before = a.snapshot()
    net.pump()
    assert a.dropped == {"bad": 9, a.rid: 1} and not replies and a.snapshot() == before
    assert len([record for record in caplog.records if "dropped a message from bad" in record.message]) == 1


def test_a_clock_that_most_peers_see_in_their_future_may_not_write(net: Net) -> None:
    ahead = ManualClock(net.clock.now() + 3600.0)
    good, _, bad = net.join("good"), net.join("fine"), net.join("bad", clock=ahead)
    for _ in range(3):
        net.pump(1.1)
        ahead.advance(1.1)
    with pytest.raises(ClockDriftError):
        bad.add_node("x", "cube")
    good.add_node("x", "cube")
    net.pump()
    assert "x" in bad


def test_a_value_that_lost_leaves_no_trace_in_the_transforms(net: Net) -> None:
    """Two agents write one edge at once, and the write that wins has the older stamp."""
    a, b = net.join("a"), net.join("b")
    tabletop(a)
    net.pump()
    for memory, x in ((a, 1.0), (b, 2.0)):
        memory.update_edge("world", "cube_3", "RT", pose=Pose((x, 0, 0), stamp=200.0 - x))
    net.pump(0.1)
    shown = [memory.edge("world", "cube_3", "RT").pose for memory in (a, b)]
    assert shown[0] == shown[1] == Pose((2, 0, 0), stamp=198.0)
    assert [memory.transform("world", "cube_3") for memory in (a, b)] == shown


def test_frames_follow_when_one_of_two_incarnations_goes(net: Net) -> None:
    a, b, late = net.join("a"), net.join("b"), net.join("late")
    for name in ("world", "cube_3"):
        a.add_node(name, name.split("_")[0])
    net.pump()
    net.network.partition(["a"], ["b", "late"])
    a.add_edge("world", "cube_3", "RT", pose=Pose((1, 0, 0), stamp=1.0))
    net.clock.advance(0.001)
    b.add_edge("world", "cube_3", "RT", pose=Pose((2, 0, 0), stamp=2.0))
    net.pump(0.1)
    net.network.partition(["a", "b"], ["late"])
    net.pump(2.0)
    watch = b.watch(edge_type="RT", existing=False)
    assert b.transform("world", "cube_3").t[0] == 2.0
    late.remove_edge("world", "cube_3", "RT")  # it has seen only the one that b made
    net.network.heal()
    net.pump(2.0)
    assert [change.attributes for change in watch.poll()] == [{"pose"}]
    for memory in (a, b, late):
        assert memory.transform("world", "cube_3").t[0] == memory.edge("world", "cube_3", "RT").pose.t[0] == 1.0


def test_a_stamp_from_the_end_of_time_silences_nobody(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    tabletop(a)
    net.pump()
    delta = Delta()
    delta.writes = [Write(a._graph.node("cube_3")._entries[0].dot, "seen", (1 << 63) - 1, "evil", None, 1)]
    net.network.connect("evil").publish("dsr/v1/g/d/evil", encode_delta(delta))
    net.pump()
    a.update_node("cube_3", mass=9.0)
    b.add_node("new", "ball", mass=1.0)
    net.pump()
    assert b.node("cube_3")["mass"] == 9.0 and a.node("new")["mass"] == 1.0 and not a.dropped and not b.dropped


def test_a_batch_is_whole_whoever_flushes(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    with a.batch():
        a.add_node("x", "cube")
        a.flush()
        net.network.deliver()
        b.poll()
        assert "x" not in b
        a.add_node("y", "cube")
    net.pump()
    assert "x" in b and "y" in b


def test_a_batch_of_any_size_is_one_message(net: Net, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dsr.replication.outbox.BUNDLE", 3)
    a = net.join("a")
    messages: list[bytes] = []
    net.network.connect("tap").subscribe("dsr/v1/g/d/*", lambda key, payload: messages.append(payload))
    with a.batch():
        for index in range(10):
            a.add_node(f"x{index}", "cube")
    net.pump()
    assert [len(decode_delta(message).adds) for message in messages] == [10]


def test_what_waits_for_the_network_is_bounded_by_the_graph(net: Net, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dsr.replication.outbox.BUNDLE", 10)
    monkeypatch.setattr("dsr.replication.outbox.MAX_BUNDLES", 3)
    a, b = net.join("a"), net.join("b")
    net.pump(2.0)
    a.add_node("x", "cube")
    net.pump()
    sizes: list[int] = []
    net.network.connect("tap").subscribe("dsr/v1/g/d/*", lambda key, payload: sizes.append(len(payload)))
    for index in range(1000):
        a.update_node("x", seen=index)
    net.pump()
    assert b.node("x")["seen"] == 999 and len(sizes) <= 3 and sum(sizes) < 2000
    assert a._graph.store.context == b._graph.store.context


def test_merging_that_cannot_keep_up_catches_up_by_repair(net: Net, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dsr.replication.replica.MAX_INBOX", 3)
    a, b = net.join("a"), net.join("b")
    net.pump(0.5)
    for index in range(20):
        a.add_node(f"x{index}", "cube")
        a.flush()
    net.pump()
    assert len(b.nodes()) < 20
    net.pump(2.5)
    assert len(b.nodes()) == 20 and b._replica.skipped == 17


def test_a_newcomer_asks_the_oldest_even_if_it_appears_last(net: Net) -> None:
    old = net.join("old")
    young = net.join("young", holders=lambda: [old.rid])
    net.network.partition(["old"], ["young", "late"])
    old.add_node("x", "cube")
    late = net.join("late", holders=lambda: [old.rid, young.rid])
    net.pump(5.0)
    assert not late.joined and not young.joined
    net.network.heal()
    net.pump(0.5)
    assert late.joined and young.joined and "x" in late


def test_a_newcomer_does_not_wait_for_one_that_is_silent_if_another_has_joined(net: Net) -> None:
    young = net.join("young")
    young.replica.synchroniser.nobody_there()
    late = net.join("late", holders=lambda: ["stopped-1", young.rid])
    net.pump(1.5)
    assert late.joined


def test_newcomers_that_meet_nobody_else_hold_all_there_is_together(net: Net) -> None:
    """The seed peer died while it answered: each has a part, and whoever asks gets both."""
    a, b = net.join("a"), net.join("b")
    a.add_node("x", "cube")
    b.add_node("y", "cube")
    net.pump(0.5)
    assert a.joined and b.joined and "y" in a and "x" in b


def test_who_has_not_joined_says_for_whom_it_waits_and_for_how_long(net: Net) -> None:
    young = net.join("young", holders=lambda: ["stopped-1"])
    late = net.join("late", holders=lambda: ["stopped-1", young.rid])
    net.pump(3.0)
    with pytest.raises(TransportError, match=r"for [23]\.\d s; stopped-1: no answer; young-.* waiting for stopped-1"):
        late.wait_joined(0.0)
    assert late.behind > 2.0
    late.wait_joined(0.0, begin=True)
    assert late.joined and not young.joined


def test_a_newcomer_whom_the_oldest_does_not_answer_asks_another(net: Net) -> None:
    first = net.join("first")
    net.join("second")
    net.pump(1.5)
    first.add_node("x", "cube")
    net.pump(1.5)
    with mock.patch.object(first._replica.synchroniser, "answer", return_value=None):
        late = net.join("late", holders=lambda: [first.rid])
        net.pump(5.0)
    assert late.joined and "x" in late


def test_the_last_sample_of_a_stream_survives_its_writer_and_a_link_that_drops_streams(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    tabletop(a)
    net.pump(1.5)
    publish = a.transport.publish

    def without_streams(key: str, payload: bytes, qos: Qos = Qos.RELIABLE) -> None:
        if qos is not Qos.STREAM:
            publish(key, payload, qos)

    a.transport.publish = without_streams  # type: ignore[method-assign]
    a.update_edge("world", "cube_3", "RT", pose=Pose((9, 0, 0), stamp=10.0))
    a.close()
    net.network.deliver()
    b.poll()
    assert b.transform("world", "cube_3").t[0] == 9


def test_a_write_that_meets_a_close_is_sent_or_refused(net: Net) -> None:
    memory = net.join("a")
    lock = memory.replica.lock

    class ClosedWhileItWaits:
        def __enter__(self) -> None:
            memory.replica.lock = lock
            memory.close()
            lock.acquire()

        def __exit__(self, *_: object) -> None:
            lock.release()

    memory.replica.lock = ClosedWhileItWaits()  # type: ignore[assignment]
    with pytest.raises(TransportError, match="closed"):
        memory.add_node("x", "cube")


def test_a_batch_larger_than_a_message_travels_in_several(net: Net, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dsr.replication.parcels.MAX_PARCEL", 1000)
    a, b = net.join("a"), net.join("b")
    a.add_node("old", "ball")
    net.pump(0.5)
    sizes: list[int] = []
    net.network.connect("tap").subscribe("dsr/v1/g/d/*", lambda key, payload: sizes.append(len(payload)))
    with a.batch():
        a.remove_node("old")
        for index in range(100):
            a.add_node(f"x{index}", "cube", mass=float(index))
    net.pump()
    assert len(b.nodes()) == 100 and len(sizes) > 5 and max(sizes) <= 1000
    net.pump(2.0)
    assert a._graph.store.context == b._graph.store.context


def test_a_part_of_a_batch_that_is_lost_is_asked_for(net: Net, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dsr.replication.parcels.MAX_PARCEL", 1000)
    a, b = net.join("a"), net.join("b")
    net.pump(0.5)
    with a.batch():
        for index in range(100):
            a.add_node(f"x{index}", "cube", mass=float(index))
    net.pump(0.05, Faults(loss=0.5))
    assert b.nodes() and a._graph.store.context != b._graph.store.context
    net.pump(2.0)
    assert len(b.nodes()) == 100 and a._graph.store.context == b._graph.store.context


def test_a_removal_of_more_than_a_message_holds_is_complete_in_the_end(
    net: Net, monkeypatch: pytest.MonkeyPatch
) -> None:
    a, b = net.join("a"), net.join("b")
    a.add_node("hub", "cube")
    for index in range(200):
        a.add_node(f"x{index}", "cube")
        a.add_edge("hub", f"x{index}", "on")
    net.pump(0.5)
    monkeypatch.setattr("dsr.replication.parcels.MAX_PARCEL", 200)
    a.remove_node("hub")
    net.pump(0.05, Faults(loss=0.5))
    net.pump(2.0)
    assert "hub" not in b and not b.edges() and a._graph.store.context == b._graph.store.context
