"""Nodes and edges of forks and overlays, part of them the parent's: what one holds goes on showing what holds there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

from dsr.crdt.delta import TOMBSTONE, EdgeKey, Write
from dsr.crdt.store import Incarnation
from dsr.graph.elements import Edge, Node, stored, type_of, write_in
from dsr.graph.schema import POSE_FIELDS
from dsr.math3d.transforms import Pose

Entries = tuple[Incarnation, ...]


class SharedNode(Node):
    """A node that the fork reads from its parent, until one of the two changes it."""

    __slots__ = ("_own", "_shared")

    def __init__(self, name: str, entries: Entries, own: Mapping[str, Node]) -> None:
        self.name = name
        self._shared = entries
        self._own = own

    @property
    def _entries(self) -> Entries:  # type: ignore[override]
        taken = self._own.get(self.name)
        return self._shared if taken is None else taken._entries

    def __eq__(self, other: object) -> bool:
        return other is self or (isinstance(other, Node) and _same(self._own, self.name, other))

    def __hash__(self) -> int:
        return hash((id(self._own), self.name))


class SharedEdge(Edge):
    """An edge that the fork reads from its parent, until one of the two changes it."""

    __slots__ = ("_own", "_shared")

    def __init__(self, key: EdgeKey, entries: Entries, own: Mapping[EdgeKey, Edge]) -> None:
        self.src, self.dst, self.type_name = key
        self._shared = entries
        self._own = own

    @property
    def _entries(self) -> Entries:  # type: ignore[override]
        taken = self._own.get(self.key)
        return self._shared if taken is None else taken._entries

    def __eq__(self, other: object) -> bool:
        return other is self or (isinstance(other, Edge) and _same(self._own, self.key, other))

    def __hash__(self) -> int:
        return hash((id(self._own), self.key))


def _same(own: Mapping[Any, Any], key: Any, other: Node | Edge) -> bool:
    """Whether `other` is the element of that key in the same fork, taken over or not."""
    if isinstance(other, SharedNode | SharedEdge | LiveNode | LiveEdge):
        return other._own is own and other.key == key
    return own.get(key) is other


class LiveNode(Node):
    """A node that an overlay shows as its parent has it, until it says something of it itself."""

    __slots__ = ("_below", "_own")

    def __init__(self, name: str, below: Node, own: Mapping[str, Node]) -> None:
        self.name = name
        self._below = below
        self._own = own

    @property
    def _entries(self) -> Entries:  # type: ignore[override]
        return (self._own.get(self.name) or self._below)._entries

    def _value(self, attribute: str) -> Any:
        return (self._own.get(self.name) or self._below)._value(attribute)

    def newest_write(self, attribute: str) -> Write | None:
        """See `Node.newest_write`."""
        return (self._own.get(self.name) or self._below).newest_write(attribute)

    def __eq__(self, other: object) -> bool:
        return other is self or (isinstance(other, Node) and _same(self._own, self.name, other))

    def __hash__(self) -> int:
        return hash((id(self._own), self.name))


class LiveEdge(Edge):
    """An edge that an overlay shows as its parent has it, until it says something of it itself."""

    __slots__ = ("_below", "_own")

    def __init__(self, key: EdgeKey, below: Edge, own: Mapping[EdgeKey, Edge]) -> None:
        self.src, self.dst, self.type_name = key
        self._below = below
        self._own = own

    @property
    def _entries(self) -> Entries:  # type: ignore[override]
        return (self._own.get(self.key) or self._below)._entries

    def _value(self, attribute: str) -> Any:
        return (self._own.get(self.key) or self._below)._value(attribute)

    def newest_write(self, attribute: str) -> Write | None:
        """See `Node.newest_write`."""
        return (self._own.get(self.key) or self._below).newest_write(attribute)

    def __eq__(self, other: object) -> bool:
        return other is self or (isinstance(other, Edge) and _same(self._own, self.key, other))

    def __hash__(self) -> int:
        return hash((id(self._own), self.key))


class Splitting(Protocol):
    """Splits the entries of an element into those of the overlay and those of its parent."""

    def split(self, element: Node | Edge, below: Entries) -> tuple[Entries, Entries]:
        """The overlay's own incarnations, and those of the parent, which are `below`, that it shows."""

    def patches_of(self, entries: Entries) -> Entries:
        """Entries in which the overlay holds its own values of these incarnations of the parent."""


class Parts(NamedTuple):
    """The entries that make up an element with a layer of its own."""

    own: Entries
    """The layer's own incarnations."""
    shown: Entries
    """Entries of the parent that the element shows."""
    said: Entries
    """Entries of the layer: its own incarnations, and its patches of the parent's."""
    all: Entries
    """All incarnations of the element."""


class Layered:
    """The common base of nodes and edges with a layer of their own: the layer's values come before the parent's."""

    __slots__ = ()
    _graph: Splitting
    _below: Any
    _seen: Any
    _parts: Any

    def refresh(self) -> Parts:
        """Bring the parts of the element up to date; the same object is returned until something of them changes."""
        below = () if self._below is None else self._below._entries
        if below is not self._seen:
            own, shown = self._graph.split(self, below)  # type: ignore[arg-type]
            if own or shown or self._parts is None:  # what is gone stays as it was
                self._parts = Parts(own, shown, (*own, *self._graph.patches_of(shown)), (*shown, *own))
            self._seen = below
        parts: Parts = self._parts
        return parts

    def outdate(self, below: Node | Edge | None) -> None:
        """The layer has changed, or the parent has another element there."""
        self._below, self._seen = below, None

    def layer_write(self, attribute: str) -> Write | None:
        """The layer's own write of an attribute; None if it has none."""
        return write_in(self.refresh().said, attribute)

    def said(self) -> frozenset[str]:
        """Attributes of which the layer itself says something, by what was read last."""
        entries = () if self._parts is None else self._parts.said
        return frozenset(name for entry in entries for name in list(entry.registers))

    def read(self) -> Entries:
        """The entries of the parent and of the layer that were read last."""
        return () if self._parts is None else (*self._parts.shown, *self._parts.said)

    def all_entries(self) -> Entries:
        """All incarnations of the element."""
        return self.refresh().all

    def value(self, attribute: str) -> Any:
        """The value of an attribute; `TOMBSTONE` if it is not set."""
        parts = self.refresh()
        write = write_in(parts.said, attribute)
        if write is not None:
            return write.value
        below = self._below
        if below is None:
            return TOMBSTONE
        return below._value(attribute) if len(parts.shown) == len(self._seen) else stored(parts.shown, attribute)

    def write_of(self, attribute: str) -> Write | None:
        """The write that the value comes from."""
        write = self.layer_write(attribute)
        if write is not None or self._below is None:
            return write
        below: Write | None = self._below.newest_write(attribute)
        return below

    def names(self) -> frozenset[str]:
        """Attributes that may be set."""
        self.refresh()
        names = self.said()
        return names if self._below is None else names | self._below.written

    def layered_type(self) -> str:
        """Type: its own incarnations decide, if there are any."""
        parts = self.refresh()
        return type_of(parts.own or parts.shown)


class LayeredNode(Layered, Node):
    """A node of which an overlay has something of its own to say."""

    __slots__ = ("_below", "_graph", "_parts", "_seen")

    def __init__(self, name: str, below: Node | None, graph: Splitting) -> None:
        self.name = name
        self._below = below
        self._graph = graph
        self._parts = self._seen = None

    @property
    def _entries(self) -> Entries:  # type: ignore[override]
        return self.all_entries()

    @property
    def type(self) -> str:
        """See `Node.type`."""
        return self.layered_type()

    def _value(self, attribute: str) -> Any:
        return self.value(attribute)

    def newest_write(self, attribute: str) -> Write | None:
        """See `Node.newest_write`."""
        return self.write_of(attribute)

    @property
    def written(self) -> frozenset[str]:
        """See `Node.written`."""
        return self.names()


class LayeredEdge(Layered, Edge):
    """An edge of which an overlay has something of its own to say."""

    __slots__ = ("_below", "_graph", "_parts", "_seen")

    def __init__(self, key: EdgeKey, below: Edge | None, graph: Splitting) -> None:
        self.src, self.dst, self.type_name = key
        self._below = below
        self._graph = graph
        self._parts = self._seen = None

    @property
    def _entries(self) -> Entries:  # type: ignore[override]
        return self.all_entries()

    @property
    def type(self) -> str:
        """See `Edge.type`."""
        return self.type_name

    def _value(self, attribute: str) -> Any:
        if attribute in POSE_FIELDS and self.layer_write(attribute) is None:
            pose = self.value("pose")
            part = getattr(pose, attribute) if isinstance(pose, Pose) else None
            return TOMBSTONE if part is None else part
        return self.value(attribute)

    def newest_write(self, attribute: str) -> Write | None:
        """See `Node.newest_write`."""
        return self.write_of(attribute)

    @property
    def written(self) -> frozenset[str]:
        """See `Node.written`."""
        return self.names()
