"""Ctrl-C at any line of a write: nothing stays inconsistent, and later writes reach everybody."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

import dsr
from dsr import Memory, Pose
from dsr.crdt.store import entry_hash
from dsr.graph.graph import Graph
from dsr.replication.replica import Replica
from tests.dsr.conftest import Net

Action = Callable[[Memory], object]
PACKAGE = f"{Path(dsr.__file__).parent}/"
"""Where lines count: a checkout that is called dsr has other packages' files in it too."""


def interrupted_at(line: int, action: Callable[[], object]) -> bool:
    """Do `action` with a KeyboardInterrupt at one of the lines that it runs in dsr; false if it has no more of them."""
    seen = 0

    def trace(frame: FrameType, event: str, _: Any) -> Any:
        nonlocal seen
        if not frame.f_code.co_filename.startswith(PACKAGE):
            return None
        seen += event == "line"
        if event == "line" and seen == line:
            sys.settrace(None)
            raise KeyboardInterrupt
        return trace

    sys.settrace(trace)
    try:
        action()
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(None)
    return False


def content(graph: Graph) -> object:
    elements = {**graph.nodes, **graph.edges}
    return {key: (element.type, element.attributes) for key, element in elements.items()}, set(graph.store.entries)


def check_derived(graph: Graph) -> None:
    """Whether all that is derived from the entries is what they say."""
    store, fingerprint = graph.store, 0
    for dot, entry in store.entries.items():
        fingerprint ^= entry_hash(entry)
        assert store.by_key[entry.key][dot] is entry
    assert store.fingerprint == fingerprint
    assert {name for names in graph.nodes_by_type.values() for name in names} == set(graph.nodes)
    for index in (graph.edges_by_type, graph.edges_out, graph.edges_in):
        assert {key for keys in index.values() for key in keys} == set(graph.edges)


def prepare(memory: Memory) -> None:
    memory.add_node("world", "world")
    memory.add_node("cube", "cube", mass=1.0)
    memory.add_edge("world", "cube", "RT", pose=Pose((1, 0, 0), stamp=1.0))


@pytest.mark.parametrize("action", [
    lambda memory: memory.update_node("cube", mass=2.0, note="heavy"),
    lambda memory: memory.update_edge("world", "cube", "RT", pose=Pose((2, 0, 0), stamp=2.0)),
    lambda memory: memory.add_node("other", "cube", mass=3.0),
    lambda memory: memory.add_edge("world", "cube", "has", note="a"),
    lambda memory: memory.remove_attribute("cube", "mass"),
    lambda memory: memory.remove_node("cube"),
    lambda memory: memory.remove_edge("world", "cube", "RT"),
])  # fmt: skip
def test_an_interrupted_write_leaves_nothing_inconsistent(net: Net, action: Action) -> None:
    a, b = net.join("a"), net.join("b")
    replica: Replica = a.replica
    net.pump(1.0)
    line = 1
    prepare(a)
    while interrupted_at(line, lambda: action(a)):
        check_derived(replica.graph)
        prepare(a)
        line += 1
    assert line > 20
    net.pump(3.0)
    check_derived(b.replica.graph)
    assert content(replica.graph) == content(b.replica.graph)
    context = replica.graph.store.context
    assert context == b.replica.graph.store.context and not context.cloud
    pose = a.get_edge("world", "cube", "RT")
    assert pose is None or a.transform("world", "cube") == pose.pose


def test_closing_that_is_interrupted_and_repeated_loses_no_write(net: Net) -> None:
    a = net.join("a")
    prepare(a)
    line, interrupted = 1, True
    while interrupted:
        b = net.join("b", interest=())
        net.pump(0.5)
        idea = b.fork("idea")
        net.pump(0.1)
        theirs = a.world("idea")
        net.pump(0.1)
        b.update_node("cube", mass=float(line))
        b.update_edge("world", "cube", "RT", pose=Pose((line, 0, 0), stamp=2.0))
        idea.update_node("cube", mass=-float(line))
        interrupted = interrupted_at(line, b.close)
        b.close()
        net.memories.remove(b)
        b.transport.close()
        net.pump(0.1)
        assert a.node("cube")["mass"] == -theirs.node("cube")["mass"] == line, line
        assert a.transform("world", "cube").t == (line, 0, 0), line
        theirs.close()
        a.delete_world("idea")
        net.pump(0.1)
        line += 4
    assert line > 150
