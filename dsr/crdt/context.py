"""Causal context: which dots have been seen, as a version vector and a cloud of dots beyond it.

A dot is (replica id, counter), counters from 1. The vector says "all counters up to n of that
replica"; dots that arrive out of order wait in the cloud, as ranges, until the gap below them closes. So
memory follows the number of gaps, whatever dots somebody claims to have seen.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator
from operator import itemgetter

from dsr.crdt.summary import Hashes, Summary, hash_of

Dot = tuple[str, int]
DotRange = tuple[str, int, int]
"""(replica id, first counter, last counter), both included."""
_first, _last = itemgetter(0), itemgetter(1)


class CausalContext:
    """A set of dots that only grows."""

    __slots__ = ("_changed", "_hashes", "_summary", "cloud", "vector")

    def __init__(self, ranges: Iterable[DotRange] = ()) -> None:
        self.vector: dict[str, int] = {}
        self.cloud: dict[str, list[tuple[int, int]]] = {}
        """Ranges of counters with gaps between them, in order."""
        self._changed: dict[str, None] = {}
        self._hashes = Hashes()
        self._summary: tuple[str | None, Summary] | None = None
        for rid, first, last in ranges:
            self.add_range(rid, first, last)

    def __contains__(self, dot: Dot) -> bool:
        rid, counter = dot
        return counter <= self.vector.get(rid, 0) or (rid in self.cloud and self._covers_range(rid, counter, counter))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, CausalContext) and self.vector == other.vector and self.cloud == other.cloud

    __hash__ = None  # type: ignore[assignment]

    def add(self, dot: Dot) -> None:
        """Include one dot."""
        self.add_range(dot[0], dot[1], dot[1])

    def add_range(self, rid: str, first: int, last: int) -> None:
        """Include all counters from `first` to `last` of replica `rid`; nothing if the range is empty."""
        known = self.vector.get(rid, 0)
        if last <= known or last < first:
            return
        self._changed[rid] = None
        beyond = self.cloud.get(rid)
        if beyond is None and first <= known + 1:
            self.vector[rid] = last
            return
        if beyond is not None and first > beyond[-1][1] + 1:  # in order, as they are sent
            beyond.append((first, last))
            return
        beyond = self.cloud.setdefault(rid, [])
        _insert(beyond, max(first, known + 1), last)
        if beyond[0][0] == known + 1:
            self.vector[rid] = beyond.pop(0)[1]
            if not beyond:
                del self.cloud[rid]

    def merge(self, other: CausalContext) -> None:
        """Include every dot of `other`."""
        for rid, first, last in other.ranges():
            self.add_range(rid, first, last)

    def covers(self, other: CausalContext) -> bool:
        """Whether every dot of `other` is included."""
        known = self.vector
        if any(last > known.get(rid, 0) and not self._covers_range(rid, 1, last) for rid, last in other.vector.items()):
            return False
        return all(self._covers_range(rid, *dots) for rid, beyond in other.cloud.items() for dots in beyond)

    def _covers_range(self, rid: str, first: int, last: int) -> bool:
        start = max(first, self.vector.get(rid, 0) + 1)
        beyond = self.cloud.get(rid, [])
        place = bisect_left(beyond, start, key=_last)
        return start > last or (place < len(beyond) and beyond[place][0] <= start and last <= beyond[place][1])

    @property
    def is_empty(self) -> bool:
        """Whether no dot is included."""
        return not self.vector and not self.cloud

    def knows(self, rid: str) -> bool:
        """Whether any dot of replica `rid` is included."""
        return rid in self.vector or rid in self.cloud

    def gaps(self, rid: str) -> int:
        """Count the gaps among the counters of replica `rid`."""
        return len(self.cloud.get(rid, ()))

    def close_gaps(self, rid: str, left: int, last: int) -> bool:
        """Include the lowest counters that are missing up to `last`, so that there no more than `left` gaps are left.

        Returns whether there were more.
        """
        beyond = self.cloud.get(rid, [])
        gaps = bisect_right(beyond, last, key=_first)
        if gaps <= left:
            return False
        self.add_range(rid, 1, beyond[gaps - left - 1][0])
        return True

    @property
    def size(self) -> int:
        """Number of replicas in the context."""
        return len(self.vector) + sum(rid not in self.vector for rid in self.cloud)

    def _ranges_of(self, rid: str) -> list[tuple[int, int]]:
        last = self.vector.get(rid)
        return [*([(1, last)] if last else []), *self.cloud.get(rid, ())]

    def summary(self, first: str | None = None) -> Summary:
        """The same dots in few bytes, however many replicas there were; see `Summary`. `first` is listed if known."""
        self._refresh()
        if self._summary is None or self._summary[0] != first:
            self._summary = first, Summary.of(self._hashes, first)
        return self._summary[1]

    @property
    def hash(self) -> int:
        """64 bits that stand for all dots: those of `Summary.hash`."""
        self._refresh()
        return self._hashes.all

    def compare(self, other: Summary) -> tuple[bool, bool]:
        """Whether all that `other` lists is included, and whether of all other replicas it has the same dots."""
        self._refresh()
        listed, rest, by_rid = True, self._hashes.all ^ other.hash, self._hashes.by_rid
        for both in other.recent:
            rid, ranges = both
            mine = by_rid.get(rid)
            if mine is None or mine[1] != both:  # else the two cancel out
                listed = listed and all(self._covers_range(rid, *dots) for dots in ranges)
                rest ^= (mine[0] if mine is not None else 0) ^ hash_of(rid, ranges)
        return listed, rest == 0

    def _refresh(self) -> None:
        if self._changed:
            for rid in self._changed:
                self._hashes.put(rid, self._ranges_of(rid))
            self._changed, self._summary = {}, None

    def ranges(self) -> Iterator[DotRange]:
        """The dots as ranges: what `CausalContext(ranges)` rebuilds."""
        for rid, last in self.vector.items():
            yield rid, 1, last
        for rid, beyond in self.cloud.items():
            for first, last in beyond:
                yield rid, first, last


def _insert(ranges: list[tuple[int, int]], first: int, last: int) -> None:
    """Add a range to sorted ones, joined with those that it touches."""
    begin, end = bisect_left(ranges, first - 1, key=_last), bisect_right(ranges, last + 1, key=_first)
    if begin < end:
        first, last = min(first, ranges[begin][0]), max(last, ranges[end - 1][1])
    ranges[begin:end] = [(first, last)]


def without(ranges: Iterable[DotRange], dots: Iterable[Dot]) -> Iterator[DotRange]:
    """The ranges with these dots taken out; the cost follows the ranges and the dots, not their product."""
    holes: dict[str, list[int]] = {}
    for rid, counter in sorted(set(dots)):
        holes.setdefault(rid, []).append(counter)
    for rid, first, last in ranges:
        start, counters = first, holes.get(rid, ())
        for hole in counters[bisect_left(counters, first) : bisect_right(counters, last)]:
            if start < hole:
                yield rid, start, hole - 1
            start = hole + 1
        if start <= last:
            yield rid, start, last


def apart(ranges: list[DotRange]) -> list[DotRange]:
    """The same dots in ranges that are in order and do not overlap, so that nobody looks at a dot twice."""
    ends: dict[str, int] = {}
    for rid, first, last in ranges:
        if first <= ends.get(rid, 0):
            return list(CausalContext(sorted(ranges)).ranges())
        ends[rid] = last
    return ranges


def to_ranges(dots: Iterable[Dot]) -> Iterator[DotRange]:
    """Sort `dots` and join neighbours into ranges."""
    run: list[int] = []
    owner = ""
    for rid, counter in sorted(dots):
        if run and rid == owner and counter == run[1] + 1:
            run[1] = counter
            continue
        if run:
            yield owner, run[0], run[1]
        owner, run = rid, [counter, counter]
    if run:
        yield owner, run[0], run[1]
