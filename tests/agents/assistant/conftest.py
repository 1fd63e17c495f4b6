"""A kitchen for assistants: things, a person with a world, a camera, on a clock of its own."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import dsr
from dsr import Memory, Pose


def fill(memory: Memory) -> None:
    """A cup is seen on the table, a ball is unseen in a box, and Sally sees the cup."""
    now = memory.clock.now()
    for name, kind in (("world", "world"), ("mind", "mind"), ("camera", "camera")):
        memory.add_node(name, kind)
    memory.add_node("table", "table", size=(1.2, 1.2, 0.04))
    memory.add_edge("world", "table", "RT", pose=Pose())
    things = (("cup", "cup", 0.1, True), ("box", "container", 0.4, True), ("ball", "ball", 0.4, False))
    for name, kind, x, seen in things:
        memory.add_node(name, kind, size=(0.1, 0.1, 0.1), perceived=seen, last_seen=now if seen else now - 30.0)
        memory.add_edge("world", name, "Virtual_RT", pose=Pose((x, 0.0, 0.05)))
    memory.add_edge("cup", "table", "on", source="contact")
    memory.add_edge("ball", "box", "in", source="contact")
    memory.add_node("sally", "person", perceived=True, last_seen=now)
    memory.add_edge("sally", "cup", "sees", visible=True, share=0.9)
    memory.create_world("view_of_sally")


@pytest.fixture
def memory(tmp_path: object, monkeypatch: pytest.MonkeyPatch) -> Iterator[Memory]:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("XDG_STATE_HOME", f"{tmp_path}/state")
    with dsr.connect("kitchen", agent="owner", must_exist=False) as memory:
        fill(memory)
        yield memory
