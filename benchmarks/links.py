"""One-way connections between two processes: ours, and the interface that those of the peers share with it.

A link is a small value that both processes get. The writer's end is opened first; then any number of readers.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Literal, Protocol

import msgspec

import dsr
from benchmarks import workload
from benchmarks.observer import on_each_change
from dsr.graph.elements import Edge, Node

Received = Callable[[int], None]
"""Called with the number of a message as soon as the reading process has it."""


class Closable(Protocol):
    """An open end of a link."""

    def close(self) -> None:
        """Leave."""


class Sender(Closable, Protocol):
    """The writer's end."""

    def send(self, number: int) -> None:
        """Send message `number`."""


class Link(Protocol):
    """How to open both ends."""

    def writer(self) -> Sender:
        """Open the writer's end."""

    def reader(self, received: Received) -> Closable:
        """Open a reader's end."""


class DsrLink(msgspec.Struct, frozen=True):
    """A working memory of `nodes` nodes: a message is the update of an attribute or of an RT edge."""

    graph: str
    kind: Literal["attribute", "any attribute", "RT"]
    """`attribute` writes one attribute of each node in turn; `any attribute` goes through all five of them."""
    watched: bool = False
    """The reader iterates over a watch in a thread; else it counts from when a read gives the value."""
    nodes: int = workload.NODES

    def writer(self) -> Sender:
        """The memory that writes; it brings the content."""
        memory = dsr.connect(self.graph, agent="writer")
        workload.fill(memory, self.nodes)
        return _SENDERS[self.kind](memory, self.nodes)

    def reader(self, received: Received) -> Closable:
        """A memory that has all content and reads each change, as by `memory.node` or `memory.edge`."""
        memory = dsr.connect(self.graph, agent="reader")
        if self.watched:
            threading.Thread(target=_follow, args=(memory, received), daemon=True).start()
        elif self.kind == "any attribute":
            on_each_change(memory, lambda _element, _attribute: received(0))
        else:
            on_each_change(memory, lambda element, attribute: _read(memory, element, attribute, received))
        return memory


def _read(memory: dsr.Memory, element: Node | Edge, attribute: str | None, received: Received) -> None:
    if attribute == "order":
        assert isinstance(element, Node)
        received(memory.node(element.name)["order"])
    elif attribute == "pose":
        assert isinstance(element, Edge)
        received(int(memory.edge(element.src, element.dst, "RT").pose.t[0]))


def _follow(memory: dsr.Memory, received: Received) -> None:
    for change in memory.watch(attribute="order", existing=False):
        received(memory.node(change.name)["order"])


class _MemorySender:
    def __init__(self, memory: dsr.Memory, nodes: int) -> None:
        self.memory = memory
        self.names = [workload.name(index) for index in range(nodes)]

    def close(self) -> None:
        self.memory.close()


class _AttributeSender(_MemorySender):
    def send(self, number: int) -> None:
        self.memory.update_node(self.names[number % len(self.names)], order=number)


class _SpreadSender(_MemorySender):
    def __init__(self, memory: dsr.Memory, nodes: int) -> None:
        super().__init__(memory, nodes)
        self._changes = workload.changes(nodes)

    def send(self, number: int) -> None:
        name, attributes = next(self._changes)
        self.memory.update_node(name, **attributes)


class _RtSender(_MemorySender):
    def send(self, number: int) -> None:
        pose = dsr.Pose.unchecked((float(number), 0.2, 0.3), (0.0, 0.0, 0.6, 0.8), self.memory.clock.now())
        self.memory.update_edge("world", self.names[number % len(self.names)], "RT", pose=pose)


_SENDERS: dict[str, Callable[[dsr.Memory, int], Sender]] = {
    "attribute": _AttributeSender,
    "any attribute": _SpreadSender,
    "RT": _RtSender,
}
