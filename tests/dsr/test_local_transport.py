"""The in-memory network: exact without faults, repeatable with them."""

from __future__ import annotations

import gc
import weakref

from dsr import Faults, LocalNetwork, ManualClock
from dsr.network.transport import key_matches


def receive(network: LocalNetwork, faults: Faults, seconds: float = 10.0) -> list[bytes]:
    network.faults = faults
    a, b = network.connect("a"), network.connect("b")
    got: list[bytes] = []
    b.subscribe("k/*", lambda key, payload: got.append(payload))
    for index in range(100):
        a.publish("k/1", bytes([index]))
    a.publish("other/1", b"no")
    assert isinstance(network.clock, ManualClock)
    network.clock.advance(seconds)
    network.deliver()
    a.close()
    b.close()
    return got


def test_keys() -> None:
    assert key_matches("a/*/c", "a/b/c") and not key_matches("a/*", "a/b/c") and key_matches("a/**", "a/b/c")
    assert key_matches("a/**", "a") and not key_matches("a/b", "a/c")


def test_without_faults_everything_arrives_in_order() -> None:
    assert receive(LocalNetwork(), Faults()) == [bytes([index]) for index in range(100)]


def test_faults_do_what_they_say_and_repeat_with_the_seed() -> None:
    lossy = receive(LocalNetwork(seed=1), Faults(loss=0.5))
    assert 20 < len(lossy) < 80 and lossy == receive(LocalNetwork(seed=1), Faults(loss=0.5))
    assert lossy != receive(LocalNetwork(seed=2), Faults(loss=0.5))
    assert len(receive(LocalNetwork(), Faults(duplication=1.0))) == 200
    delayed = receive(LocalNetwork(), Faults(delay=(0.0, 1.0)))
    assert sorted(delayed) != delayed and len(delayed) == 100
    assert receive(LocalNetwork(), Faults(delay=(20.0, 21.0))) == []


def test_partition_cuts_messages_and_presence() -> None:
    network = LocalNetwork()
    a, b = network.connect("a"), network.connect("b")
    seen: list[tuple[str, bool]] = []
    got: list[bytes] = []
    b.watch_presence("live/*", lambda key, alive: seen.append((key, alive)))
    b.subscribe("k", lambda key, payload: got.append(payload))
    token = a.announce("live/a")
    network.deliver()
    network.partition(["a"], ["b"])
    a.publish("k", b"lost")
    network.deliver()
    network.heal()
    a.publish("k", b"kept")
    network.deliver()
    token.close()
    network.deliver()
    assert got == [b"kept"] and [alive for _, alive in seen] == [True, False, True, False]


def test_requests_are_answered_or_time_out_once() -> None:
    network = LocalNetwork()
    a, b = network.connect("a"), network.connect("b")
    b.serve("ask", lambda key, payload: payload * 2 if payload else None)
    replies: list[bytes] = []
    done: list[int] = []
    for payload in (b"x", b""):
        a.request("ask", payload, lambda key, reply: replies.append(reply), lambda: done.append(1), timeout=1.0)
    network.deliver()
    assert replies == [b"xx"] and not done
    assert isinstance(network.clock, ManualClock)
    network.clock.advance(1.0)
    network.deliver()
    assert done == [1, 1]


def test_a_cut_is_one_way_and_takes_presence_with_it() -> None:
    network = LocalNetwork()
    a, b = network.connect("a"), network.connect("b")
    got: list[tuple[str, bytes]] = []
    seen: list[tuple[str, bool]] = []
    for me in (a, b):
        me.subscribe("k", lambda key, payload, me=me: got.append((me.name, payload)))  # type: ignore[misc]
        me.watch_presence("live/*", lambda key, alive: seen.append((key, alive)))
        me.announce(f"live/{me.name}")
    network.deliver()
    assert sorted(seen) == [("live/a", True), ("live/b", True)]
    a.publish("k", b"under way")
    network.cut("a", "b")
    a.publish("k", b"lost")
    b.publish("k", b"back")
    network.deliver()
    assert got == [("a", b"back")] and seen[2:] == [("live/a", False)] and network.met["cut off"] == 1
    network.heal()
    a.publish("k", b"again")
    network.deliver()
    assert got[1:] == [("b", b"again")] and seen[3:] == [("live/a", True)]


def test_a_suspended_process_gets_everything_in_order_when_it_goes_on() -> None:
    network = LocalNetwork()
    a, b = network.connect("a"), network.connect("b")
    got: list[bytes] = []
    replies: list[bytes] = []
    b.subscribe("k", lambda key, payload: got.append(payload))
    b.serve("ask", lambda key, payload: payload)
    network.suspend("b")
    a.publish("k", b"1")
    a.publish("k", b"2")
    a.request("ask", b"x", lambda key, reply: replies.append(reply), lambda: None, timeout=9.0)
    network.deliver()
    assert not got and not replies and network.met["held"] == 3
    network.resume("b")
    network.deliver()
    assert got == [b"1", b"2"] and replies == [b"x"]


def test_faults_are_counted_by_kind() -> None:
    network = LocalNetwork(seed=1)
    arrived = receive(network, Faults(loss=0.3, duplication=0.3, delay=(0.0, 1.0)))
    assert len(arrived) == 100 - network.met["lost"] + network.met["duplicated"]
    assert network.met["delayed"] == len(arrived) and 0 < network.met["reordered"] < len(arrived)


def test_a_message_that_has_arrived_is_freed_at_once() -> None:
    network = LocalNetwork()
    a, b = network.connect("a"), network.connect("b")

    class Message:
        def __call__(self) -> None:
            pass

    gc.disable()
    try:
        message = Message()
        watched = weakref.ref(message)
        network.send(a, b, message)
        del message
        network.deliver()
        assert watched() is None
    finally:
        gc.enable()
