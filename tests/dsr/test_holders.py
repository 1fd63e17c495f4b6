"""Who holds a part or a world: each other process is asked, and what is slow is not taken for empty."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable

import msgpack
import pytest

import dsr
from dsr import Memory, TransportError
from dsr.network.keys import Keys
from dsr.network.transport import Subscription
from dsr.replication import holders
from dsr.replication.holders import HOLDER_PATIENCE, MAX_PLACES, decode_answer, decode_query
from tests.dsr.conftest import Net
from tests.dsr.parts.test_parts import house
from tests.dsr.test_zenoh import Peer, peers

__all__ = ["peers"]

LATE = 3.0 * HOLDER_PATIENCE
Listen = Callable[..., Subscription]


def late(memory: Memory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let others be seen, and what they publish come, late, as on a machine that is busy; who is asked answers."""

    def lately(listen: Listen) -> Listen:
        def listen_late(key: str, handler: Callable[..., None], **options: object) -> Subscription:
            def report(*told: object) -> None:
                timer = threading.Timer(LATE, handler, told)
                timer.daemon = True
                timer.start()

            return listen(key, report, **options)

        return listen_late

    transport = memory.transport
    monkeypatch.setattr(transport, "watch_presence", lately(transport.watch_presence))
    monkeypatch.setattr(transport, "subscribe", lately(transport.subscribe))


def test_a_part_does_not_begin_empty_because_its_holder_is_slow_to_be_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    with dsr.connect("slow", "a", interest=(), must_exist=False) as a:
        a.create_part("kitchen")
        a.add_node("cup", "cube", "kitchen")
        with dsr.connect("slow", "b", interest=()) as b:
            late(b, monkeypatch)
            b.hold_part("kitchen", timeout=2 * LATE)
            assert "cup" in b


def test_a_world_is_not_taken_for_one_that_nobody_holds_because_its_holder_is_slow(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with dsr.connect("slow", "a", must_exist=False) as a:
        a.create_world("plan").add_node("cup", "cube")
        with dsr.connect("slow", "b") as b:
            late(b, monkeypatch)
            assert "cup" in b.world("plan", timeout=2 * LATE)


def test_a_process_that_does_not_answer_may_hold_what_is_asked_for(peers: Callable[[str], Peer]) -> None:
    stopped = peers("stopped")
    with dsr.connect("g", "b", interest=()) as b:
        stopped.process.send_signal(signal.SIGSTOP)
        with pytest.raises(TransportError, match=f"{stopped.rid}: no word whether they hold it"):
            b.hold_part("kitchen", timeout=HOLDER_PATIENCE, unlisted=True)
        assert not b.interest
        resumed = threading.Timer(HOLDER_PATIENCE, stopped.process.send_signal, (signal.SIGCONT,))
        resumed.start()
        b.hold_part("kitchen", timeout=20.0, unlisted=True)
        resumed.join()
        assert b.interest == ("kitchen",) and b.joined


def test_what_nobody_holds_begins_when_all_have_said_so(net: Net) -> None:
    a, b = house(net)
    a.leave_part("kitchen")
    b.hold_part("kitchen")
    assert b.part_replica("kitchen").synchroniser.joined


def test_what_nobody_holds_waits_for_who_is_stopped(net: Net) -> None:
    a, b = house(net)
    net.join("c")
    net.pump(1.0)
    a.leave_part("kitchen")
    net.network.suspend("c")
    b.hold_part("kitchen")
    kitchen = b.part_replica("kitchen").synchroniser
    net.pump(2.0)
    assert not kitchen.joined
    net.network.resume("c")
    net.pump(1.0)
    assert kitchen.joined


def test_who_is_gone_is_not_waited_for(net: Net) -> None:
    a, b = house(net)
    c = net.join("c")
    net.pump(1.0)
    a.leave_part("kitchen")
    net.network.suspend("c")
    b.hold_part("kitchen")
    c.close()
    c.transport.close()
    net.memories.remove(c)
    net.pump(4.0)
    assert b.part_replica("kitchen").synchroniser.joined


def test_lost_questions_are_asked_again(net: Net) -> None:
    a, b = house(net)
    a.leave_part("kitchen")
    net.network.cut("b", "a")
    b.hold_part("kitchen")
    assert not b.part_replica("kitchen").synchroniser.joined
    net.network.heal()
    net.pump(3.0)
    assert b.part_replica("kitchen").synchroniser.joined


def test_a_process_that_has_not_joined_knows_of_too_few_to_begin_a_part(net: Net) -> None:
    a, _ = house(net)
    net.network.partition(["a"], ["b"], ["late"])
    young = net.join("late", interest=("kitchen",))
    net.pump(3.0)
    assert not young.part_replica("kitchen").synchroniser.joined
    net.network.heal()
    net.pump(3.0)
    assert "cup" in young and young.joined
    assert "cup" in a


def test_answers_in_the_name_of_others_and_nonsense_are_counted(net: Net) -> None:
    a, b = house(net)
    evil, keys = net.network.connect("evil"), Keys("g")
    answers = [
        [1, a.rid, [""]], [1, "evil-1", []], [2, "evil-1", [""]], [1, "evil-1", [7]], [1, "evil-1", ["x" * 300]],
        [1, "evil-1", ["a-kitchen.1"]],
    ]  # fmt: skip
    serving = [
        evil.serve(keys.holders(f"evil-{n}"), lambda *_, n=n: msgpack.packb(answers[n])) for n in range(len(answers))
    ]
    net.network.suspend("a")
    b.hold_part("kitchen")
    assert b.who_holds.malformed == len(answers)
    assert not b.part_replica("kitchen").synchroniser.joined
    for each in serving:
        each.close()
    net.network.resume("a")
    net.pump(3.0)
    assert "cup" in b


def test_questions_that_make_no_sense_are_not_answered(net: Net) -> None:
    a, _ = house(net)
    evil, answers = net.network.connect("evil"), []
    bad = [b"", b"\xc1", msgpack.packb([2, ["part/kitchen"]]), msgpack.packb([1, ["x"] * (MAX_PLACES + 1)])]
    for payload in [*bad, msgpack.packb([1, ["part/kitchen", "part/cellar", "world/x/y"]])]:
        evil.request(Keys("g").holders(a.rid), payload, lambda _, reply: answers.append(reply), lambda: None, 1.0)
    net.pump(1.0)
    assert a.who_holds.malformed == len(bad)
    assert decode_answer(answers[0]).held == [a.part_replica("kitchen").graph.rid, "", ""]


def test_what_many_say_of_places_that_nobody_asked_for_is_not_kept(net: Net) -> None:
    a, b = house(net)
    b.hold_part("kitchen")
    net.pump(3.0)
    assert not b.who_holds._answers and not b.who_holds._wanted
    b.who_holds._take(["part/other"], Keys("g").holders(a.rid), msgpack.packb([1, a.rid, ["x"]]))
    assert not b.who_holds._answers


def test_who_is_heard_may_be_asked_while_peers_come(net: Net) -> None:
    a, _ = house(net)
    net.pump(1.0)
    sync = a.replica.synchroniser

    class Coming:
        @property
        def digest(self) -> bool:
            sync._peers[f"c-{len(sync._peers)}"] = sync._peers[heard[0]]
            return True

    heard = sync.heard
    sync._peers["new-1"] = Coming()  # type: ignore[assignment]
    assert sync.heard == sorted([*heard, "new-1"])


def test_messages_are_those_of_the_format() -> None:
    question, answer = msgpack.packb([1, ["part/kitchen"]]), msgpack.packb([1, "a-1", ["a-kitchen.1"]])
    assert holders._encoder.encode(decode_query(question)) == question
    assert holders._encoder.encode(decode_answer(answer)) == answer
