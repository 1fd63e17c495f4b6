"""What is held back to be sent together is not told of before: all would ask for it."""

from __future__ import annotations

import pytest

from dsr import LocalNetwork, Memory
from dsr.clock import ManualClock, WallClock
from dsr.network.transport import Qos
from dsr.replication.pace import DIGEST_PERIOD, MOST_HELD
from tests.dsr.conftest import Net


def told(memory: Memory, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The kinds of messages that it publishes from now on: `digest`, `delta`."""
    kinds: list[str] = []
    publish, keys = memory.transport.publish, memory.keys
    kind_of = {keys.digest(memory.rid): "digest", keys.delta(memory.rid): "delta"}

    def note(key: str, payload: bytes, qos: Qos = Qos.RELIABLE) -> None:
        kinds.extend([kind_of[key]] if key in kind_of else [])
        publish(key, payload, qos)

    monkeypatch.setattr(memory.transport, "publish", note)
    return kinds


def test_no_digest_tells_of_what_is_held_back(net: Net, monkeypatch: pytest.MonkeyPatch) -> None:
    a, b = net.join("a"), net.join("b")
    net.pump(3.0)
    kinds, asked = told(a, monkeypatch), b.replica.synchroniser.inquiry
    monkeypatch.setattr(asked, "_request", lambda _: pytest.fail("asked for what is held back"))
    with a.batch():
        a.add_node("cube_0", "cube")
        net.pump(1.1 * DIGEST_PERIOD)
        assert kinds == []
    net.pump(0.1)
    assert kinds == ["delta", "digest"]
    net.pump(2.0)
    assert "cube_0" in b


def test_who_holds_writes_back_for_long_speaks(net: Net, monkeypatch: pytest.MonkeyPatch) -> None:
    a, _ = net.join("a"), net.join("b")
    net.pump(3.0)
    kinds = told(a, monkeypatch)
    with a.batch():
        a.add_node("cube_0", "cube")
        net.pump(3.0 * (DIGEST_PERIOD + MOST_HELD))
    assert 2 <= kinds.count("digest") <= 3


class SteppedClock(WallClock):
    """Its monotonic time stands until it is set."""

    time = 1000.0

    def monotonic(self) -> float:
        return self.time


def test_who_is_always_busy_speaks_between_two_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SteppedClock()
    network = LocalNetwork(ManualClock())
    other = Memory("g", "b", transport=network.connect("b"), clock=clock)
    with Memory("g", "a", transport=network.connect("a"), clock=clock, threaded=True) as memory:
        memory.wait_joined(0.1, begin=True)
        memory.add_node("cube_0", "cube")
        memory.add_edge("cube_0", "cube_0", "on")
        memory.flush()
        kinds = told(memory, monkeypatch)
        for _ in range(3):
            with memory.batch():
                clock.time += 1.1 * DIGEST_PERIOD
                memory.update_node("cube_0", mass=clock.time)
                memory.poll()
                said = list(kinds)
                kinds.clear()
            assert said == []
            assert kinds == ["delta", "digest"]
            kinds.clear()
    other.close()
