"""Subscriptions: changes since the reader last looked, conflated per node or edge.

A slow reader never blocks anybody and never misses that something came or went: pending changes of one
element are merged, so at most one entry an element waits, however many updates there were.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Literal

import msgspec

from dsr.crdt.delta import Key
from dsr.graph.elements import Edge, Node
from dsr.graph.schema import RECORDS

ChangeKind = Literal["added", "updated", "removed"]


class Change(msgspec.Struct, frozen=True):
    """A change of one element."""

    kind: ChangeKind
    element: Literal["node", "edge"]
    name: str
    """The node's name; for an edge that of its destination."""
    type: str
    """The node's or the edge's type."""
    attributes: frozenset[str] = frozenset()
    """Names of the attributes that changed since the last change delivered."""
    src: str = ""
    """An edge's source; empty for a node."""
    dst: str = ""
    """An edge's destination; empty for a node."""


class ChangeFilter(msgspec.Struct, frozen=True):
    """A filter of changes; None means any. Node and edge types alone exclude the other element.

    Nodes about the graph itself (`RECORDS`) are reported only if asked for by their type.
    """

    node_types: frozenset[str] | None = None
    edge_types: frozenset[str] | None = None
    attributes: frozenset[str] | None = None

    def accepts(self, element: Node | Edge) -> bool:
        """Whether changes of this element are wanted at all."""
        wanted = self.node_types if isinstance(element, Node) else self.edge_types
        if wanted is None:
            everything = self.node_types is None and self.edge_types is None
            return everything and not (isinstance(element, Node) and element.type in RECORDS)
        return element.type in wanted

    def accepts_attribute(self, attribute: str) -> bool:
        """Whether changes of this attribute are wanted."""
        return self.attributes is None or attribute in self.attributes


class _Pending:
    """Undelivered changes of one element: its comings and goings, and the attributes touched."""

    __slots__ = ("attributes", "element", "kinds")

    def __init__(self, element: Node | Edge) -> None:
        self.element = element
        self.kinds: list[tuple[ChangeKind, str]] = []
        """What happened, and the type that the element had then."""
        self.attributes: set[str] = set()

    def push(self, kind: ChangeKind) -> None:
        """Add a change; what came, went and came again needs no more than its first and last state."""
        if kind == "updated" and self.kinds and self.kinds[-1][0] != "removed":
            return
        if kind == "added":
            self.attributes.clear()
        self.kinds.append((kind, self.element.type))
        if len(self.kinds) == 3:
            del self.kinds[: 1 if self.kinds[0][0] == "updated" else 2]


class Watch:
    """Changes that match a filter. Iterate to wait for them, or `poll` to take the present ones.

    Args:
        wanted: types and attributes.
        notify: see `Memory.watch`.
        where: likewise.
    """

    def __init__(
        self, wanted: ChangeFilter, notify: Callable[[], None] | None = None,
        where: Callable[[Node | Edge], bool] | None = None,
    ) -> None:  # fmt: skip
        self._filter = wanted
        self._notify = notify
        self._where = where
        self._pending: dict[Key, _Pending] = {}
        self._lock = threading.RLock()
        self._condition = threading.Condition(self._lock)
        self._ready: list[Change] = []
        self._closed = False

    def __enter__(self) -> Watch:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[Change]:
        """Wait for change after change; ends when the watch or its memory is closed."""
        while (change := self.next()) is not None:
            yield change

    def next(self, timeout: float | None = None) -> Change | None:
        """The next change; None if none came within `timeout` seconds, or the watch was closed."""
        with self._condition:
            self._condition.wait_for(lambda: self._ready or self._pending or self._closed, timeout)
            if not self._ready:
                self._ready = self._take()[::-1]
            if self._closed or not self._ready:
                return None
            change = self._ready.pop()
            if self._ready:
                self._condition.notify()  # somebody else may wait, who was told of none of these
            return change

    def poll(self) -> list[Change]:
        """Return all changes since the last call, oldest element first; never waits."""
        with self._lock:
            changes = self._ready[::-1] + self._take()
            self._ready = []
            return changes

    def close(self) -> None:
        """Stop watching; ends a loop over this watch."""
        with self._condition:
            self._closed = True
            self._pending = {}
            self._condition.notify_all()
        if self._notify is not None:
            self._notify()

    @property
    def closed(self) -> bool:
        """Whether the watch was closed."""
        return self._closed

    def wants(self, element: Node | Edge, attribute: str | None = None) -> bool:
        """Whether a change of this attribute, or that the element comes or goes, is to be offered.

        The answer depends on the type of the element alone.
        """
        return self._filter.accepts(element) and (attribute is None or self._filter.accepts_attribute(attribute))

    def offer(self, kind: ChangeKind, element: Node | Edge, attribute: str | None = None) -> None:
        """Called by the memory for every change that the watch wants."""
        if self._closed or (self._where is not None and kind != "removed" and not self._where(element)):
            return
        key = element.key
        with self._lock:
            first = not self._pending
            pending = self._pending.get(key)
            if pending is None:
                pending = self._pending[key] = _Pending(element)
            pending.element = element
            pending.push(kind)
            if attribute is not None:
                pending.attributes.add(attribute)
            if first:  # who waits takes all that there is, and tells the next one
                self._condition.notify()
        if self._notify is not None:
            self._notify()

    def offer_all(self, element: Node | Edge) -> None:
        """Called by the memory for what is wanted and came, or is there when the watch begins."""
        present = [name for name in element if self._filter.accepts_attribute(name)]
        if self._filter.attributes is None:
            self.offer("added", element)
        for name in present:
            self.offer("updated", element, name)

    def _take(self) -> list[Change]:
        taken, self._pending = self._pending, {}
        return [_to_change(pending, kind) for pending in taken.values() for kind in pending.kinds]


def _to_change(pending: _Pending, happened: tuple[ChangeKind, str]) -> Change:
    kind, type = happened
    element = pending.element
    attributes = frozenset() if kind == "removed" else frozenset(pending.attributes)
    if isinstance(element, Node):
        return Change(kind, "node", element.name, type, attributes)
    return Change(kind, "edge", element.dst, type, attributes, element.src, element.dst)
