"""What a hostile peer may have others do: what a message costs is in proportion to what it brings."""

from __future__ import annotations

from typing import Any

from msgspec.structs import replace

from dsr.crdt.delta import Delta, Write
from tests.dsr.conftest import Net


def test_values_under_one_dot_cost_by_the_shorter_one(net: Net) -> None:
    """Else one message has all replicas spell out a long value as often as it has short ones for the same dot."""

    def spell_out(_: object) -> str:
        raise AssertionError("a long value is spelled out")

    memory = net.join("a")
    (entry,) = memory.add_node("x", "cube")._entries
    long: Any = type("tuple", (tuple,), {"__repr__": spell_out})([0.5] * 1000)
    write = Write(entry.dot, "way", 1 << 60, "liar-1", ("liar-1", 1), long)
    for value in (long, (0.25,), (1.0,)):
        memory._graph.store.join(Delta(writes=[replace(write, value=value)], context=[("liar-1", 1, 1)]))
    assert memory.node("x")["way"] == (1.0,)
