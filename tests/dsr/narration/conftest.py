"""A table with things of which some are seen, some hidden, one gone, on a clock that the test moves."""

from __future__ import annotations

import pytest

from dsr import LocalNetwork, ManualClock, Memory, Pose
from dsr.narration import Moment
from dsr.timeline import Chronicle
from dsr.vocabulary.explained import MOVED, REMOVED, WITH_SUPPORTS, ExplainedChange, encoded, text_of

NOW = 1000.0


def make_memory() -> Memory:
    """An empty graph at time `NOW` minus 60 s."""
    clock = ManualClock(NOW - 60.0)
    return Memory("kitchen", "me", transport=LocalNetwork(clock).connect("me"), clock=clock)


def put(memory: Memory, name: str, at: tuple[float, float, float], kind: str = "cube", **values: object) -> None:
    """A thing that is believed to be somewhere."""
    memory.add_node(name, kind, size=(0.04, 0.04, 0.04), **values)
    memory.add_edge("world", name, "Virtual_RT", pose=Pose(at))


def explain(memory: Memory, names: str, *changes: ExplainedChange, time: float = NOW - 4.0) -> None:
    """An explanation that was adopted."""
    Chronicle(memory, "simulation_handler").happened(
        "explained", names, time, explanation=text_of(changes), changes=encoded(changes)
    )


@pytest.fixture
def memory() -> Memory:
    """`cup` is seen on `table`, `cube_4` is unseen below `cube_3`, `ball` is in `box`, `cube_9` is gone."""
    memory = make_memory()
    memory.add_node("world", "world")
    memory.add_node("table", "table", size=(1.2, 1.2, 0.04))
    memory.add_edge("world", "table", "RT", pose=Pose())
    memory.add_node("camera", "camera")
    put(memory, "cup", (0.301, 0.0949, 0.05), "cup", perceived=True, last_seen=NOW)
    put(memory, "cube_3", (0.3, -0.2, 0.06), perceived=True, last_seen=NOW)
    put(memory, "cube_4", (0.3, -0.2, 0.02), perceived=False, last_seen=NOW - 12.5)
    put(memory, "box", (0.5, 0.0, 0.05), "container", perceived=True, last_seen=NOW)
    put(memory, "ball", (0.5, 0.0, 0.03), "ball", perceived=False, last_seen=NOW - 200.0)
    memory.add_node("cube_9", "cube", present=False, perceived=False, last_seen=NOW - 6.0)
    memory.add_node("cube_10", "cube")
    for upper, lower in (("cup", "table"), ("cube_3", "cube_4"), ("cube_4", "table"), ("box", "table")):
        memory.add_edge(upper, lower, "on", source="contact", since=NOW - 50.0)
    memory.add_edge("ball", "box", "in", source="contact", since=NOW - 40.0)
    memory.add_edge("ball", "box", "on", source="contact", since=NOW - 40.0)
    memory.add_edge("camera", "cube_4", "sees", visible=False, share=0.0, hidden_by="cube_3")
    memory.add_edge("camera", "ball", "sees", visible=False, share=0.0, hidden_by="")
    explain(memory, "cube_9", ExplainedChange(REMOVED, (("cube_9",),)))
    explain(memory, "cube_3,cube_4", ExplainedChange(WITH_SUPPORTS, (("cube_3",), ("cube_4",))))
    explain(memory, "cup", ExplainedChange(MOVED, (("cup",),)), time=NOW - 30.0)
    memory.clock.advance(60.0)  # type: ignore[attr-defined]
    return memory


@pytest.fixture
def moment(memory: Memory) -> Moment:
    return Moment.of(memory)
