"""Nodes and edges as a user reads them: live, read-only views that copy nothing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from dsr.crdt.context import Dot
from dsr.crdt.delta import TOMBSTONE, Write
from dsr.crdt.hlc import physical_time
from dsr.crdt.store import Incarnation
from dsr.errors import GraphError, suggest
from dsr.graph.schema import POSE_FIELDS
from dsr.math3d.transforms import Pose


def type_of(entries: tuple[Incarnation, ...]) -> str:
    """The type that the incarnations of one element have together: that of the greatest creation dot."""
    return entries[0].type if len(entries) == 1 else max(entries, key=lambda entry: entry.dot).type


def winner(entries: tuple[Incarnation, ...], attribute: str) -> Write | None:
    """The winning write among the incarnations of one element; of writes under one stamp, that to the greatest dot."""
    writes = [entry.registers[attribute] for entry in entries if attribute in entry.registers]
    return max(writes, key=lambda write: (write.stamp, write.writer, write.owner)) if writes else None


def write_in(entries: tuple[Incarnation, ...], attribute: str) -> Write | None:
    """The winning write among the incarnations of one element, quickly of a single one."""
    if len(entries) == 1:
        return entries[0].registers.get(attribute)
    return winner(entries, attribute) if entries else None


def stored(entries: tuple[Incarnation, ...], attribute: str) -> Any:
    """The winning value among the incarnations of one element; `TOMBSTONE` if none is set."""
    write = write_in(entries, attribute)
    return TOMBSTONE if write is None else write.value


class _Element(Mapping[str, Any]):
    """Attributes of a node or an edge, by name."""

    __slots__ = ("_entries",)
    _entries: tuple[Incarnation, ...]

    @property
    def type(self) -> str:
        """Type name. If two agents created it at once with different types, all replicas see the same one."""
        entries = self._entries
        return entries[0].type if len(entries) == 1 else type_of(entries)

    def _value(self, attribute: str) -> Any:
        return stored(self._entries, attribute)

    def __getitem__(self, attribute: str) -> Any:
        """The present value. Raises `GraphError` if the attribute is not set."""
        value = self._value(attribute)
        if value is TOMBSTONE:
            raise GraphError(f"{self} has no attribute {attribute!r}; {suggest(attribute, self)}")
        return value

    def get(self, attribute: str, default: Any = None) -> Any:
        """The present value, or `default` if the attribute is not set."""
        value = self._value(attribute)
        return default if value is TOMBSTONE else value

    def __contains__(self, attribute: object) -> bool:
        return isinstance(attribute, str) and self._value(attribute) is not TOMBSTONE

    def __iter__(self) -> Iterator[str]:
        return iter(sorted([name for name in self.written if self._value(name) is not TOMBSTONE]))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __bool__(self) -> bool:
        return True

    def __eq__(self, other: object) -> bool:
        return self is other

    def __hash__(self) -> int:
        return id(self)

    @property
    def created(self) -> tuple[Dot, ...]:
        """(replica id, counter) of each creation: several if agents created it at once. The same in all replicas."""
        return tuple(sorted(entry.dot for entry in self._entries))

    def written_at(self, attribute: str) -> float | None:
        """When the present value was written (s, by the clock of its writer), or taken away; None if it never was set.

        The same in all replicas, however late they got it.
        """
        write = self.newest_write(attribute)
        return None if write is None else physical_time(write.stamp)

    def newest_write(self, attribute: str) -> Write | None:
        """The write that the present value is from, or that took it away; None if it never was set."""
        return write_in(self._entries, attribute)

    @property
    def written(self) -> frozenset[str]:
        """Names of all attributes that were ever set, those taken away since included."""
        entries = self._entries
        if len(entries) == 1:
            return frozenset(list(entries[0].registers))
        return frozenset([name for entry in entries for name in list(entry.registers)])

    @property
    def attributes(self) -> dict[str, Any]:
        """All attributes that are set, as they are now.

        `dict(element)` asks for one after the other, and fails if one is taken away meanwhile in another thread.
        """
        return {name: value for name in self if (value := self._value(name)) is not TOMBSTONE}


def types_of(element: Node | Edge) -> tuple[str, ...]:
    """All types under which an element was made, first the one that it shows."""
    entries = element._entries
    return (element.type,) if len(entries) == 1 else tuple(dict.fromkeys([element.type, *(e.type for e in entries)]))


class Node(_Element):
    """A node of the graph; reading it gives the present values."""

    __slots__ = ("name",)

    def __init__(self, name: str, entries: tuple[Incarnation, ...]) -> None:
        self._entries = entries
        self.name = name

    @property
    def key(self) -> str:
        """The identity of the node: its name."""
        return self.name

    def __repr__(self) -> str:
        return f"{self.type} {self.name!r}"


class Edge(_Element):
    """An edge of the graph; reading it gives the present values.

    A geometric edge holds its transform in one attribute, `pose`, so that it changes as a whole;
    `translation`, `rotation`, `stamp` and `covariance` read its parts.
    """

    __slots__ = ("dst", "src", "type_name")

    def __init__(self, key: tuple[str, str, str], entries: tuple[Incarnation, ...]) -> None:
        self._entries = entries
        self.src, self.dst, self.type_name = key

    @property
    def type(self) -> str:
        """Type name."""
        return self.type_name

    @property
    def key(self) -> tuple[str, str, str]:
        """The identity of the edge: (source, destination, type)."""
        return self.src, self.dst, self.type_name

    @property
    def pose(self) -> Pose:
        """Pose of the destination in the source, source_from_destination. Raises `GraphError` if unset."""
        pose = self._value("pose")
        if not isinstance(pose, Pose):
            raise GraphError(f"{self} has no pose")
        return pose

    def _value(self, attribute: str) -> Any:
        value = stored(self._entries, attribute)
        if value is TOMBSTONE and attribute in POSE_FIELDS:
            pose = stored(self._entries, "pose")
            part = getattr(pose, attribute) if isinstance(pose, Pose) else None
            return TOMBSTONE if part is None else part
        return value

    def __repr__(self) -> str:
        return f"{self.type_name} edge {self.src!r} -> {self.dst!r}"
