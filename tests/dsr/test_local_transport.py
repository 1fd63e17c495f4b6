"""The in-memory network: exact without faults, repeatable with them."""

from __future__ import annotations

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
