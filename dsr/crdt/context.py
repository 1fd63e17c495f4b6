"""Causal context: which dots have been seen, as a version vector and a cloud of dots beyond it.

A dot is (replica id, counter), counters from 1. The vector says "all counters up to n of that
replica"; dots that arrive out of order wait in the cloud until the gap below them closes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

Dot = tuple[str, int]
DotRange = tuple[str, int, int]
"""(replica id, first counter, last counter), both included."""


class CausalContext:
    """A set of dots that only grows."""

    __slots__ = ("cloud", "vector")

    def __init__(self, ranges: Iterable[DotRange] = ()) -> None:
        self.vector: dict[str, int] = {}
        self.cloud: dict[str, set[int]] = {}
        for rid, first, last in ranges:
            self.add_range(rid, first, last)

    def __contains__(self, dot: Dot) -> bool:
        rid, counter = dot
        if counter <= self.vector.get(rid, 0):
            return True
        beyond = self.cloud.get(rid)
        return beyond is not None and counter in beyond

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
        if first > known + 1:
            self.cloud.setdefault(rid, set()).update(range(first, last + 1))
            return
        self.vector[rid] = last
        if rid in self.cloud:
            self._compact(rid, known)

    def _compact(self, rid: str, known: int) -> None:
        """Move into the vector, which went up from `known`, what has become contiguous with it.

        The cost follows what moves, not the size of the cloud: a snapshot adds its dots one by one.
        """
        beyond = self.cloud[rid]
        last = self.vector[rid]
        if last - known < len(beyond):
            beyond.difference_update(range(known + 1, last + 1))
        else:
            beyond = self.cloud[rid] = {counter for counter in beyond if counter > last}
        while last + 1 in beyond:
            last += 1
            beyond.remove(last)
        self.vector[rid] = last
        if not beyond:
            del self.cloud[rid]

    def merge(self, other: CausalContext) -> None:
        """Include every dot of `other`."""
        for rid, first, last in other.ranges():
            self.add_range(rid, first, last)

    def covers(self, other: CausalContext) -> bool:
        """Whether every dot of `other` is included."""
        return all(self._covers_range(*dots) for dots in other.ranges())

    def _covers_range(self, rid: str, first: int, last: int) -> bool:
        start = max(first, self.vector.get(rid, 0) + 1)
        beyond = self.cloud.get(rid, set())
        return all(counter in beyond for counter in range(start, last + 1))

    def ranges(self) -> Iterator[DotRange]:
        """The dots as ranges: what `CausalContext(ranges)` rebuilds."""
        for rid, last in self.vector.items():
            yield rid, 1, last
        for rid, beyond in self.cloud.items():
            yield from to_ranges((rid, counter) for counter in beyond)


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
