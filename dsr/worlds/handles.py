"""Nodes and edges of a fork that it has not taken over: what one holds goes on showing the fork, whatever happens."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dsr.crdt.delta import EdgeKey
from dsr.crdt.store import Entry
from dsr.elements import Edge, Node


class SharedNode(Node):
    """A node that the fork reads from its parent, until one of the two changes it."""

    __slots__ = ("_own", "_shared")

    def __init__(self, name: str, entries: tuple[Entry, ...], own: Mapping[str, Node]) -> None:
        self.name = name
        self._shared = entries
        self._own = own

    @property
    def _entries(self) -> tuple[Entry, ...]:  # type: ignore[override]
        taken = self._own.get(self.name)
        return self._shared if taken is None else taken._entries

    def __eq__(self, other: object) -> bool:
        return other is self or (isinstance(other, Node) and _same(self._own, self.name, self._shared, other))

    def __hash__(self) -> int:
        return hash((id(self._own), self.name))


class SharedEdge(Edge):
    """An edge that the fork reads from its parent, until one of the two changes it."""

    __slots__ = ("_own", "_shared")

    def __init__(self, key: EdgeKey, entries: tuple[Entry, ...], own: Mapping[EdgeKey, Edge]) -> None:
        self.src, self.dst, self.type_name = key
        self._shared = entries
        self._own = own

    @property
    def _entries(self) -> tuple[Entry, ...]:  # type: ignore[override]
        taken = self._own.get(self.key)
        return self._shared if taken is None else taken._entries

    def __eq__(self, other: object) -> bool:
        return other is self or (isinstance(other, Edge) and _same(self._own, self.key, self._shared, other))

    def __hash__(self) -> int:
        return hash((id(self._own), self.key))


def _same(own: Mapping[Any, Any], key: Any, shared: tuple[Entry, ...], other: Node | Edge) -> bool:
    """Whether `other` is the element of that key in the same fork, taken over or not."""
    if isinstance(other, SharedNode | SharedEdge):
        return other._own is own and (other.name if isinstance(other, SharedNode) else other.key) == key
    return own.get(key) is other
