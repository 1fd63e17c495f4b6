"""Parts over the real network: asked for at once and later, found by threads, and given back."""

from __future__ import annotations

import time

import pytest

from dsr import PartNotFoundError, connect
from dsr.memory import Memory


def until(memory: Memory, name: str) -> bool:
    """Whether a node comes within seconds."""
    for _ in range(200):
        if name in memory:
            return True
        time.sleep(0.02)
    return False


def test_a_process_gets_the_parts_that_it_asks_for() -> None:
    with connect("parts", "a", interest=(), must_exist=False) as a:
        a.create_part("kitchen")
        a.create_part("hall")
        a.add_node("world", "world")
        a.add_node("cup", "cube", "kitchen")
        a.add_node("ball", "ball", "hall")
        a.add_edge("cup", "ball", "on")
        with connect("parts", "b", interest=("kitchen",)) as b, connect("parts", "plain") as plain:
            assert {node.name for node in b.nodes()} == {"world", "cup"} and b.joined
            assert {node.name for node in plain.nodes()} == {"world"}
            b.add_node("plate", "cube", "kitchen")
            assert until(a, "plate")
            b.hold_part("hall")
            assert [edge.key for edge in b.edges()] == [("cup", "ball", "on")]
            b.leave_part("kitchen")
            a.add_node("spoon", "cube", "kitchen")
            a.add_node("lamp", "cube", "hall")
            assert until(b, "lamp") and "spoon" not in b and "cup" not in b
        with pytest.raises(PartNotFoundError):
            connect("parts", "c", interest=("cellar",))


def test_a_part_that_nobody_holds_begins_again() -> None:
    with connect("parts", "a", interest=(), must_exist=False) as a:
        a.create_part("kitchen")
        a.leave_part("kitchen")
        with connect("parts", "b", interest=("kitchen",)) as b:
            assert b.joined and b.interest == ("kitchen",)
            b.add_node("cup", "cube", "kitchen")
            a.hold_part("kitchen")
            assert "cup" in a
