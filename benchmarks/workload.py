"""The content that everything is measured on: a world with nodes of five attributes, each at the end of an RT edge."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from dsr import LocalNetwork, Memory, Pose, WallClock
from dsr.graph.schema import Value

NODES = 1000
ATTRIBUTES = ("order", "mass", "visible", "note", "size")
TYPE = "cube"


def name(index: int) -> str:
    """The name of a node."""
    return f"node_{index}"


def attributes(index: int) -> dict[str, Any]:
    """Five attributes, one of each usual kind."""
    return {
        "order": index,
        "mass": 0.1 + index,
        "visible": index % 2 == 0,
        "note": f"number {index}",
        "size": (0.04, 0.05, 0.06),
    }


def pose(index: int, stamp: float = 1.0) -> Pose:
    """Some pose; its x is the index."""
    return Pose((float(index), 0.2, 0.3), (0.0, 0.0, 0.6, 0.8), stamp)


def fill(memory: Memory, nodes: int = NODES, *, edges: bool = True) -> None:
    """Add the world, `nodes` nodes and, with `edges`, an RT edge to each."""
    memory.add_node("world", "world")
    for index in range(nodes):
        memory.add_node(name(index), TYPE, **attributes(index))
        if edges:
            memory.add_edge("world", name(index), "RT", pose=pose(index))


def is_complete(memory: Memory, nodes: int = NODES, *, edges: bool = True) -> bool:
    """Whether all that `fill` adds is there."""
    return len(memory.nodes()) > nodes and len(memory.edges("RT")) >= nodes * edges


def changes(nodes: int = NODES) -> Iterator[tuple[str, dict[str, Value]]]:
    """Writes of one attribute each, for ever: the next attribute in each round over all nodes."""
    number = 0
    while True:
        for attribute in ATTRIBUTES:
            for index in range(nodes):
                number += 1
                yield name(index), {attribute: attributes(number)[attribute]}


def local_memory(agent: str = "local", network: LocalNetwork | None = None) -> Memory:
    """A memory without threads or sockets."""
    return Memory("bench", agent, transport=(network or LocalNetwork(WallClock())).connect(agent))


def message_size(*, rt: bool) -> int:
    """Bytes of the message that carries one attribute update, or one RT update."""
    network = LocalNetwork(WallClock())
    sizes: list[int] = []
    network.connect("listener").subscribe("dsr/**", lambda _key, payload: sizes.append(len(payload)))
    memory = local_memory("writer-process", network)
    fill(memory, 1)
    memory.flush()
    if rt:
        memory.update_edge("world", name(0), "RT", pose=pose(1000))
    else:
        memory.update_node(name(0), order=1000)
    memory.flush()
    network.deliver()
    return sizes[-1]
