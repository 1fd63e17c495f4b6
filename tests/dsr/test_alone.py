"""No silence: joining a graph in which nobody is, and what a memory is."""

from __future__ import annotations

import logging

import pytest

import dsr
from dsr import ConfigError


def test_a_graph_that_begins_here_is_told(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, "dsr"), dsr.connect("kitchen", agent="me"):
        assert "nobody else is in graph 'kitchen', which begins here, empty" in caplog.text
        caplog.clear()
        with dsr.connect("kitchen", agent="other"), dsr.connect("garden", agent="me", must_exist=False):
            assert caplog.text == ""


def test_a_graph_that_must_exist_is_missed_by_name() -> None:
    with dsr.connect("kitchen", agent="me", must_exist=False) as memory:
        with pytest.raises(ConfigError, match=r"nobody holds graph 'kitchn'; running on this machine: kitchen"):
            dsr.connect("kitchn", agent="counter", must_exist=True)
        with dsr.connect("kitchen", agent="counter", must_exist=True) as other:
            memory.add_node("cup_1", "cup")
            assert repr(memory) == "<Memory of graph 'kitchen': 1 node, 0 edges, 1 other process>"
            assert other.graph_name == "kitchen"
            memory.add_node("cup_2", "cup")
            memory.add_edge("cup_1", "cup_2", "on")
        other.close()
        assert repr(other).endswith(", closed>") and "process" not in repr(other)
        assert memory.replica.wait_until(lambda: not memory.peers, 10.0)
        assert repr(memory) == "<Memory of graph 'kitchen': 2 nodes, 1 edge, 0 other processes>"
    assert repr(memory) == "<Memory of graph 'kitchen': 2 nodes, 1 edge, closed>"
