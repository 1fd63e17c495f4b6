"""What a hostile peer may have others do: what a message costs is in proportion to what it brings."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec.structs import replace

from dsr import errors
from dsr.crdt.delta import Delta, Write
from dsr.errors import suggest
from dsr.frames.tree import BELIEVED, FrameTree
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


def test_a_frame_that_is_nowhere_costs_no_look_at_all_frames(net: Net, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else who makes many frames, and one thing without a place, holds up each agent that asks where the thing is."""
    memory = net.join("a")
    memory.add_node("world", "world")
    memory.add_node("lost", "cube")
    monkeypatch.setattr(FrameTree, "_no_path", lambda *_: pytest.fail("it is said why there is no way"))
    assert memory.get_transform("world", "lost", types=BELIEVED) is None


def test_an_error_about_very_many_names_compares_none(monkeypatch: pytest.MonkeyPatch) -> None:
    names = [f"n{number}" for number in range(501)]
    monkeypatch.setattr(errors, "_wording", lambda name: "n" if name == "n7" else pytest.fail("compared"))
    assert suggest("n7", names, most=3) == "valid: n0, n1, n10 and 498 more"
