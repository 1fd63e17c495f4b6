"""What replicas tell each other: additions, register writes, removals and the dots these cover."""

from __future__ import annotations

from typing import Any, NamedTuple

from dsr.crdt.context import Dot, DotRange

EdgeKey = tuple[str, str, str]
"""(source name, destination name, edge type)"""
Key = str | EdgeKey
"""A node's name, or an edge's key."""


class Tombstone:
    """The value of an attribute that was taken away; it dies with its node or edge."""

    __slots__ = ()

    def __repr__(self) -> str:
        return "TOMBSTONE"


TOMBSTONE = Tombstone()


class Add(NamedTuple):
    """A node or edge came into being under a creation dot."""

    dot: Dot
    key: Key
    type: str
    sources: tuple[Dot, ...] = ()
    """Creation dots of an edge's source node, as its creator saw them."""
    destinations: tuple[Dot, ...] = ()


class Write(NamedTuple):
    """A register of the node or edge created under `owner` got a value."""

    owner: Dot
    attribute: str
    stamp: int
    """Hybrid logical time of the write."""
    writer: str
    """Replica id; (stamp, writer) orders writes."""
    dot: Dot | None
    """Makes the write durable; None for a sample of a stream, which may be lost."""
    value: Any


class Delta:
    """A piece of state to be joined with another replica's.

    `context` holds the dots that this delta accounts for. With `live` (all live creation dots of the
    sender), the delta is a synchronisation reply: what its context covers and `live` lacks is removed.
    """

    __slots__ = ("adds", "context", "live", "removed", "writes")

    def __init__(self) -> None:
        self.adds: list[Add] = []
        self.writes: list[Write] = []
        self.removed: list[Dot] = []
        self.context: list[DotRange] = []
        self.live: frozenset[Dot] | None = None

    def __bool__(self) -> bool:
        return bool(self.adds or self.writes or self.removed or self.context or self.live is not None)

    def __len__(self) -> int:
        return len(self.adds) + len(self.writes) + len(self.removed)

    def extend(self, later: Delta) -> None:
        """Append a later delta of the same replica; both must be without `live`."""
        self.adds += later.adds
        self.writes += later.writes
        self.removed += later.removed
        for rid, first, last in later.context:
            if self.context and self.context[-1][0] == rid and self.context[-1][2] + 1 == first:
                self.context[-1] = (rid, self.context[-1][1], last)
            else:
                self.context.append((rid, first, last))
