"""Deltas that replicas exchange: additions, register writes, removals, and the dots that these cover."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import msgspec

from dsr.crdt.context import Dot, DotRange

EdgeKey = tuple[str, str, str]
"""(source name, destination name, edge type)"""
Key = str | EdgeKey
"""A node's name, or an edge's key."""


MAX_ENDS = 1000
"""Creation dots at one end of an edge: agents that made one node at once. Each look at the edge looks at all."""


class Tombstone:
    """The value of an attribute that was taken away; it dies with its node or edge."""

    __slots__ = ()

    def __repr__(self) -> str:
        return "TOMBSTONE"


TOMBSTONE = Tombstone()


class Add(msgspec.Struct, frozen=True, gc=False):
    """A node or edge came into being under a creation dot."""

    dot: Dot
    key: Key
    type: str
    sources: tuple[Dot, ...] = ()
    """Creation dots of an edge's source node, as its creator saw them."""
    destinations: tuple[Dot, ...] = ()


class Write(msgspec.Struct, frozen=True, gc=False):
    """A value of a last-writer-wins register of the node or edge created under `owner`; (stamp, writer) orders them."""

    owner: Dot
    attribute: str
    stamp: int
    """Hybrid logical time of the write."""
    writer: str
    """Replica id."""
    dot: Dot | None
    """Makes the write durable; None for a sample of a stream, which may be lost."""
    value: Any


_ORDERED = (bool, int, float, str, bytes, tuple)
"""Classes of values that have an order, those that may be long among them."""


def precedence(write: Write) -> tuple[int, str, Dot]:
    """Orders the writes of one register: the greatest wins.

    The same write may come without a dot, and with those of several replicas that made it durable. The greatest stays.
    """
    return write.stamp, write.writer, write.dot or ("", 0)


def rank(value: Any) -> tuple[str, Any]:
    """Orders values of any kinds, in every process alike: liars give one dot two of them.

    A comparison costs by the shorter value. Nobody must pay for a long one again and again, once for each short one.
    """
    return type(value).__name__, value if isinstance(value, _ORDERED) else repr(value)


def beats(write: Write, other: Write) -> bool:
    """Whether a write wins over another one of the same register, in whatever order they come."""
    order, others = precedence(write), precedence(other)
    if order == others and write is not other:
        return rank(write.value) > rank(other.value)
    return order > others


class Delta(msgspec.Struct, gc=False):
    """A piece of state to be joined with another replica's.

    `context` holds the dots that this delta accounts for. With `live` (live creation dots of the sender), the
    delta is a synchronisation reply: what `examined` covers and `live` lacks is removed.
    """

    adds: list[Add] = []
    writes: list[Write] = []
    removed: list[Dot] = []
    context: list[DotRange] = []
    live: frozenset[Dot] | None = None
    examined: list[DotRange] | None = None
    """Dots that `live` is about: any of them that is not in `live` was removed; None for all of the context."""
    misfits: int = 0
    """Values of another kind than their attributes have, which were taken away when it was read."""

    def __bool__(self) -> bool:
        return bool(self.adds or self.writes or self.removed or self.context or self.live is not None)

    def __len__(self) -> int:
        return len(self.adds) + len(self.writes) + len(self.removed)

    def extend_context(self, ranges: Iterable[DotRange]) -> None:
        """Account for more dots, those of later changes."""
        context = self.context
        for rid, first, last in ranges:
            if context and context[-1][2] == first - 1 and context[-1][0] == rid:
                context[-1] = (rid, context[-1][1], last)
            else:
                context.append((rid, first, last))
