"""Synchronisation replies in pieces of bounded size, each true by itself.

A piece is about the elements with creation dots in one interval of the order of dots. It holds what the asker lacks
of them, and says which of them live. The asker may join any piece, at any time: a partial store with the full context
would lose data, so each piece accounts only for

- the dots of the additions and writes that it holds,
- the removal of what the answerer has seen in the interval (`examined`) and does not hold.

Only who has joined all intervals may account for the rest: the dots of removals and of writes that lost. That rest is
what the answerer had seen before the first piece (`whole`); what it learns while it answers is not in it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import msgspec

from dsr.crdt.context import CausalContext, Dot, DotRange, to_ranges
from dsr.crdt.delta import Add, Delta, Write
from dsr.crdt.store import Incarnation, Store

Place = tuple[str, int, str]
"""Where a piece begins: (replica id, counter) of a creation dot, and an attribute if one element fills several."""
START: Place = ("", 0, "")
MAX_EXAMINED = 2000
"""Elements that one piece looks at: 2 ms, for which writers may have to wait."""
MAX_WEIGHT = 256 * 1024
"""Bytes of a piece, or about; the last element that it holds goes beyond."""
_BYTES_OF_CHANGE = 100
"""Bytes of an addition or a write with a short value, or about."""


class Piece(msgspec.Struct):
    """A part of a synchronisation reply."""

    begin: Place
    end: Place | None = None
    """Place where the next piece begins; None after the last piece."""
    adds: list[Add] = []
    writes: list[Write] = []
    kept: list[Dot] = []
    """Creation dots in the interval that live, and that the asker knows or had in the piece before."""
    examined: list[DotRange] = []
    """The part of the answerer's context in the interval."""
    whole: list[DotRange] | None = None
    """The answerer's context; only with the first piece."""
    joined: bool = True
    """Whether the answerer holds all that the graph holds."""
    waits_for: list[str] = []
    """Replica ids of those for whom it waits, if it has not joined."""

    def as_delta(self) -> Delta:
        """Make a delta that can be joined; it accounts only for the dots of this piece."""
        dots = [add.dot for add in self.adds]
        live = frozenset([*dots, *self.kept])
        dots += [write.dot for write in self.writes if write.dot]
        return Delta(self.adds, self.writes, [], list(to_ranges(dots)), live, self.examined)


def piece_of(store: Store, seen: CausalContext, begin: Place = START) -> Piece:
    """Make the piece that begins at `begin`, of the changes that a replica with the context `seen` lacks.

    The store must not change meanwhile.
    """
    piece = Piece(begin)
    if begin == START:
        piece.whole = list(store.context.ranges())
    weight = 0
    for count, dot in enumerate(store.order.starting_at(begin[:2])):
        if count >= MAX_EXAMINED or weight >= MAX_WEIGHT:
            piece.end = (*dot, "")
            break
        entry = store.find(dot)
        assert entry is not None
        weight += _take(store, entry, seen, piece)
        if piece.end is not None:
            break
    piece.examined = list(_clipped(store.context.ranges(), begin[:2], piece.end[:2] if piece.end else None))
    return piece


def _take(store: Store, entry: Incarnation, seen: CausalContext, piece: Piece) -> int:
    """Add what is missing of one element; returns its weight."""
    weight = 0
    first = piece.begin[2] if entry.dot == piece.begin[:2] else ""
    if entry.dot not in store.entries:
        pass  # what is said of an element of another graph: it is created there
    elif entry.dot in seen or first:
        piece.kept.append(entry.dot)
    else:
        piece.adds.append(Add(entry.dot, entry.key, entry.type, entry.sources, entry.destinations))
        weight += _BYTES_OF_CHANGE
    missing = _missing(entry, seen)
    total = sum([_weight(write) for write in missing])
    if total <= MAX_WEIGHT and not first:
        piece.writes += missing
        return weight + total
    left = sorted((write for write in missing if write.attribute >= first), key=lambda write: write.attribute)
    for count, write in enumerate(left):
        if count and weight >= MAX_WEIGHT:
            piece.end = (*entry.dot, write.attribute)
            break
        piece.writes.append(write)
        weight += _weight(write)
    return weight


def _missing(entry: Incarnation, seen: CausalContext) -> list[Write]:
    """The writes of one element that `seen` lacks."""
    known = seen.vector.get
    beyond = [write for write in entry.registers.values() if (dot := write.dot) is None or dot[1] > known(dot[0], 0)]
    return [write for write in beyond if write.dot is None or write.dot not in seen] if seen.cloud else beyond


def _weight(write: Write) -> int:
    value = write.value
    kind = value.__class__
    if kind is tuple:
        return _BYTES_OF_CHANGE + 9 * len(value)
    return _BYTES_OF_CHANGE + len(value) if kind is str or kind is bytes else _BYTES_OF_CHANGE


def _clipped(ranges: Iterable[DotRange], begin: Dot, end: Dot | None) -> Iterator[DotRange]:
    """The part of the ranges from `begin`, included, to `end`, excluded."""
    for rid, first, last in ranges:
        if rid == begin[0]:
            first = max(first, begin[1])  # noqa: PLW2901
        if end is not None and rid == end[0]:
            last = min(last, end[1] - 1)  # noqa: PLW2901
        if rid >= begin[0] and (end is None or rid <= end[0]) and first <= last:
            yield rid, first, last


def all_pieces(store: Store, seen: CausalContext) -> Iterator[Piece]:
    """Yield all pieces, one after the other; the store may change before the next one is taken."""
    begin: Place | None = START
    while begin is not None:
        piece = piece_of(store, seen, begin)
        begin = piece.end
        yield piece


def together(pieces: Iterable[Piece]) -> Delta:
    """Combine all pieces of an answer into one synchronisation reply, which accounts for everything."""
    reply, live, carried = Delta(), set[Dot](), CausalContext()
    for piece in pieces:
        part = piece.as_delta()
        reply.adds += part.adds
        reply.writes += part.writes
        live |= part.live or frozenset()
        for dots in [*(piece.whole or ()), *part.context]:
            carried.add_range(*dots)
        reply.examined = [*(reply.examined or ()), *piece.examined]
    reply.context, reply.live = list(carried.ranges()), frozenset(live)
    return reply


def reply_to(store: Store, seen: CausalContext) -> Delta:
    """Make a synchronisation reply in one delta: all changes that `seen` lacks, plus all live dots."""
    return together(all_pieces(store, seen))
