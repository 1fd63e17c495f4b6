"""Synchronisation replies in pieces of bounded size, each true by itself.

A piece is about the elements with creation dots in one interval of the order of dots. It holds what the asker lacks
of them, and says which of them live. The asker may join any piece, at any time: a partial store with the full context
would lose data, so each piece accounts only for

- the dots of the additions and writes that it holds,
- the removal of what the answerer has seen in the interval (`examined`) and does not hold.

Only who has joined all intervals may account for the rest: the dots of removals and of writes that lost. That rest is
what the answerer had seen before the first element (`whole`); what it learns while it answers is not in it. If that is
long, the first pieces are about that alone.

Nobody takes a message that is too long. So whatever anybody has put into the graph, a piece is no longer than
`MAX_WEIGHT`, one change beyond it (`dsr.replication.wire.MAX_ADD`), and twice `MAX_SEEN`, but for long values.
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
"""Places of no replica id are within the answerer's context: the counter is the number of ranges that were told."""
MAX_EXAMINED = 2000
"""Elements that one piece looks at: 2 ms, for which writers may have to wait."""
MAX_WEIGHT = 256 * 1024
"""Bytes of the changes in a piece; only the last one goes beyond."""
MAX_SEEN = 128 * 1024
"""Bytes of the ranges in `whole`, and in `examined`: an eighth of a message, for changes take most of it."""
MAX_ASKED = 768 * 1024
"""Bytes of the ranges in a request, most of the longest message."""
_BYTES_OF_CHANGE = 100
"""Bytes for which an addition or a write with short names and a short value counts."""
_BYTES_OF_ADD, _BYTES_OF_WRITE = 37, 48
"""The most bytes that the numbers in one take, and the lengths of its texts and lists."""
_SHORT = (_BYTES_OF_CHANGE - _BYTES_OF_WRITE) // 4
"""Characters of an attribute's name with which it is short: each takes 4 bytes at most."""
_BYTES_OF_DOT, _BYTES_OF_RANGE = 14, 23
"""The most bytes that one takes whose replica id is in the message already."""
_BYTES_OF_LENGTH = 5
"""The most bytes that the length of a text takes."""
_MOST_OF_RANGE = 1060
"""The most bytes that a range takes, with a replica id of 256 characters."""
FEWEST_TOLD = MAX_SEEN // _MOST_OF_RANGE
"""Ranges of `whole` that a piece has at least if more of them follow."""


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
    """The answerer's context, or the next part of it; only with the first pieces, those at places of no replica id."""
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


class _Weigher:
    """Weighs what a piece holds, so that no message is too long; each replica id is in it once."""

    def __init__(self) -> None:
        self.bytes = 0
        self._named: set[str] = set()

    def name(self, rid: str) -> None:
        """A replica id is in the piece."""
        if rid not in self._named:
            self._named.add(rid)
            self.bytes += _BYTES_OF_LENGTH + size_of(rid)

    def told(self, rid: str) -> None:
        """A range of dots of that replica is in the piece."""
        self.name(rid)
        self.bytes += _BYTES_OF_RANGE

    def kept(self, dot: Dot) -> None:
        """That an element lives is in the piece."""
        self.name(dot[0])
        self.bytes += _BYTES_OF_DOT

    def add(self, add: Add) -> None:
        """An addition is in the piece."""
        key, named, weight = add.key, self._named, _BYTES_OF_ADD + size_of(add.type)
        if add.dot[0] not in named:
            self.name(add.dot[0])
        if isinstance(key, str):
            weight += size_of(key)
        else:
            ends = add.sources + add.destinations
            weight += size_of(key[0]) + size_of(key[1]) + size_of(key[2]) + _BYTES_OF_DOT * len(ends)
            for rid, _ in ends:
                if rid not in named:
                    self.name(rid)
        self.bytes += max(_BYTES_OF_CHANGE, weight)

    def weigh(self, writes: list[Write]) -> tuple[int, list[str]]:
        """Bytes that writes would take, or more, and the replica ids that would be new in the piece."""
        weight, named = 0, self._named
        new: list[str] = []
        for write in writes:
            value, writer, dot = write.value, write.writer, write.dot
            if len(write.attribute) <= _SHORT:
                weight += _BYTES_OF_CHANGE
            else:
                weight += max(_BYTES_OF_CHANGE, _BYTES_OF_WRITE + size_of(write.attribute))
            kind = value.__class__
            if kind is tuple:
                weight += 9 * len(value)
            elif kind is str or kind is bytes:
                weight += len(value)
            if writer not in named:
                new.append(writer)
            if dot is not None and dot[0] is not writer and dot[0] not in named:
                new.append(dot[0])
        return weight, new

    def writes(self, weight: int, new: list[str]) -> None:
        """Writes are in the piece that were weighed so."""
        self.bytes += weight
        for rid in new:
            self.name(rid)


def size_of(text: str) -> int:
    """Bytes of a text in a message."""
    return len(text) if text.isascii() else len(text.encode())


def piece_of(store: Store, seen: CausalContext, begin: Place = START) -> Piece:
    """Make the piece that begins at `begin`, of the changes that a replica with the context `seen` lacks.

    The store must not change meanwhile.
    """
    piece, ranges = Piece(begin), list(store.context.ranges())
    if begin[0] == "":
        piece.whole, rest = _divided(ranges[begin[1] :])
        if rest:
            piece.end = ("", begin[1] + len(piece.whole), "")
            return piece
    examined = list(_clipped(ranges, begin[:2], None))
    if len(examined) * _MOST_OF_RANGE > MAX_SEEN:
        examined, rest = _divided(sorted(examined))
        if rest:
            piece.end = (*rest[0][:2], "")
    weigher = _Weigher()
    for count, dot in enumerate(store.order.starting_at(begin[:2])):
        if piece.end is not None and dot >= piece.end[:2]:
            break
        if count >= MAX_EXAMINED or weigher.bytes >= MAX_WEIGHT:
            piece.end = (*dot, "")
            break
        entry = store.find(dot)
        assert entry is not None
        if (end := _take(store, entry, seen, piece, weigher)) is not None:
            piece.end = end
            break
    piece.examined = list(_clipped(examined, begin[:2], piece.end[:2] if piece.end else None))
    return piece


def share_of_full(piece: Piece, store: Store) -> float:
    """How much a piece holds that was joined into `store`, as a share of what one holds that others follow; 1 at most.

    Only elements and writes count that are there now: of what is made up, refused or outdated, anybody has any number.
    """
    entries, weigher = store.entries, _Weigher()
    added = [add for add in piece.adds if piece.begin[:2] <= add.dot and add.dot in entries]
    kept = [dot for dot in piece.kept if piece.begin[:2] <= dot and dot in entries]
    for add in added:
        weigher.add(add)
    for write in piece.writes:
        entry = store.find(write.owner)
        if entry is not None and entry.registers.get(write.attribute) == write:
            weigher.writes(*weigher.weigh([write]))
    return min(1.0, max((len(added) + len(kept)) / MAX_EXAMINED, weigher.bytes / MAX_WEIGHT))


def share_of_told(ranges: list[DotRange]) -> float:
    """How much a piece tells of what its sender has seen, as a share of one that others follow; 1 at most."""
    weigher = _Weigher()
    for rid, _, _ in ranges:
        weigher.told(rid)
    return min(1.0, weigher.bytes / (MAX_SEEN - _MOST_OF_RANGE))


def _divided(ranges: list[DotRange]) -> tuple[list[DotRange], list[DotRange]]:
    """Those of the ranges, the first of them, that take no more than `MAX_SEEN`, and the others."""
    weigher = _Weigher()
    for count, (rid, _, _) in enumerate(ranges):
        weigher.told(rid)
        if count and weigher.bytes > MAX_SEEN:
            return ranges[:count], ranges[count:]
    return ranges, []


def seen_by(store: Store) -> list[DotRange]:
    """What a replica tells to have seen when it asks: all, or as much as one request holds.

    What it leaves out is sent once more, which changes nothing. First comes that of replicas of which something lives.
    """
    ranges = list(store.context.ranges())
    if len(ranges) * _MOST_OF_RANGE > MAX_ASKED:
        room = MAX_ASKED
        ranges.sort(key=lambda dots: not store.order.has_any(dots[0]))
        for count, (rid, _, _) in enumerate(ranges):
            room -= _BYTES_OF_LENGTH + size_of(rid) + _BYTES_OF_RANGE
            if room < 0:
                return ranges[:count]
    return ranges


def _take(
    store: Store, entry: Incarnation, seen: CausalContext, piece: Piece, weigher: _Weigher
) -> Place | None:
    """Add what is missing of one element; returns the place of the rest, if there is no room for all of it."""
    first = piece.begin[2]
    if first and entry.dot != piece.begin[:2]:
        first = ""
    missing = _missing(entry, seen)
    if entry.dot not in store.entries:
        weigher.name(entry.dot[0])  # what is said of an element of another graph: it is created there
    elif first or (not seen.is_empty and entry.dot in seen):
        weigher.kept(entry.dot)
        piece.kept.append(entry.dot)
    else:
        add = Add(entry.dot, entry.key, entry.type, entry.sources, entry.destinations)
        weigher.add(add)
        piece.adds.append(add)
    weight, new = weigher.weigh(missing)
    if not first and weigher.bytes + weight <= MAX_WEIGHT:
        weigher.writes(weight, new)
        piece.writes += missing
        return None
    left = sorted((write for write in missing if write.attribute >= first), key=lambda write: write.attribute)
    for count, write in enumerate(left):
        if count and weigher.bytes >= MAX_WEIGHT:
            return (*entry.dot, write.attribute)
        weigher.writes(*weigher.weigh([write]))
        piece.writes.append(write)
    return None


def _missing(entry: Incarnation, seen: CausalContext) -> list[Write]:
    """The writes of one element that `seen` lacks."""
    if seen.is_empty:
        return list(entry.registers.values())
    known = seen.vector.get
    beyond = [write for write in entry.registers.values() if (dot := write.dot) is None or dot[1] > known(dot[0], 0)]
    return [write for write in beyond if write.dot is None or write.dot not in seen] if seen.cloud else beyond


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
