"""Dots in order, replica by replica, that can be walked from any place while they come and go between two walks."""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Iterable, Iterator
from itertools import repeat

from dsr.crdt.context import Dot

_SPAN = 10
"""Counters that differ only in this many low bits share a list: short enough to be changed at once."""


class OrderedDots:
    """A set of dots, ordered by replica id and counter."""

    def __init__(self, dots: Iterable[Dot] = ()) -> None:
        self._lists: dict[str, _Counters] = {}
        for dot in dots:
            self.add(dot)

    def add(self, dot: Dot) -> None:
        """Include a dot; harmless when repeated."""
        rid, counter = dot
        lists = self._lists.get(rid)
        if lists is None:
            lists = self._lists[rid] = _Counters()
        lists.add(counter)

    def discard(self, dot: Dot) -> None:
        """Take a dot out; harmless if it is not there."""
        rid, counter = dot
        lists = self._lists.get(rid)
        if lists is not None:
            lists.discard(counter)
            if not lists.numbers:
                del self._lists[rid]

    def has_any(self, rid: str) -> bool:
        """Whether any dot of this replica is there."""
        return rid in self._lists

    def starting_at(self, begin: Dot) -> Iterator[Dot]:
        """`begin`, if it is there, and all after it, in order."""
        first, counter = begin
        for rid in sorted(self._lists):
            if rid >= first:
                yield from zip(repeat(rid), self._lists[rid].starting_at(counter if rid == first else 0))

    def between(self, rid: str, first: int, last: int) -> Iterator[Dot]:
        """The dots of one replica with counters from `first` to `last`, both included.

        The cost follows the number of these dots: of one reply there may be any number of ranges.
        """
        lists = self._lists.get(rid)
        for counter in lists.starting_at(first) if lists is not None else ():
            if counter > last:
                return
            yield rid, counter


class _Counters:
    """The counters of one replica, in lists that are in order."""

    __slots__ = ("_lists", "numbers")

    def __init__(self) -> None:
        self._lists: dict[int, list[int]] = {}
        self.numbers: list[int] = []
        """What tells the lists apart, in order."""

    def add(self, counter: int) -> None:
        """Include a counter; harmless when repeated."""
        counters = self._lists.get(counter >> _SPAN)
        if counters is None:
            self._lists[counter >> _SPAN] = [counter]
            insort(self.numbers, counter >> _SPAN)
        elif counters[-1] < counter:
            counters.append(counter)
        elif not _holds(counters, counter):
            insort(counters, counter)

    def discard(self, counter: int) -> None:
        """Take a counter out; harmless if it is not there."""
        counters = self._lists.get(counter >> _SPAN, [])
        if _holds(counters, counter):
            counters.remove(counter)
            if not counters:
                del self._lists[counter >> _SPAN]
                del self.numbers[bisect_left(self.numbers, counter >> _SPAN)]

    def starting_at(self, first: int) -> Iterator[int]:
        """The counters from `first` on, in order."""
        for place in range(bisect_left(self.numbers, first >> _SPAN), len(self.numbers)):
            counters = self._lists[self.numbers[place]]
            for at in range(bisect_left(counters, first), len(counters)):  # no copy, for most walks are short
                yield counters[at]


def _holds(counters: list[int], counter: int) -> bool:
    place = bisect_left(counters, counter)
    return place < len(counters) and counters[place] == counter
