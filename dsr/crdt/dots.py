"""Dots in order, replica by replica, that can be walked from any place while they come and go between two walks."""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Iterable, Iterator

from dsr.crdt.context import Dot

_SPAN = 10
"""Counters that differ only in this many low bits share a list: short enough to be changed at once."""


class OrderedDots:
    """A set of dots, ordered by replica id and counter."""

    def __init__(self, dots: Iterable[Dot] = ()) -> None:
        self._lists: dict[str, dict[int, list[int]]] = {}
        for dot in dots:
            self.add(dot)

    def add(self, dot: Dot) -> None:
        """Include a dot; harmless when repeated."""
        rid, counter = dot
        lists = self._lists.get(rid)
        if lists is None:
            lists = self._lists[rid] = {}
        counters = lists.get(counter >> _SPAN)
        if counters is None:
            lists[counter >> _SPAN] = [counter]
        elif counters[-1] < counter:
            counters.append(counter)
        elif not _holds(counters, counter):
            insort(counters, counter)

    def discard(self, dot: Dot) -> None:
        """Take a dot out; harmless if it is not there."""
        rid, counter = dot
        lists = self._lists.get(rid, {})
        counters = lists.get(counter >> _SPAN, [])
        if _holds(counters, counter):
            counters.remove(counter)
            if not counters:
                del lists[counter >> _SPAN]
            if not lists:
                del self._lists[rid]

    def starting_at(self, begin: Dot) -> Iterator[Dot]:
        """`begin`, if it is there, and all after it, in order."""
        first, counter = begin
        for rid in sorted(self._lists):
            if rid >= first:
                yield from self._counters(rid, counter if rid == first else 0)

    def between(self, rid: str, first: int, last: int) -> Iterator[Dot]:
        """The dots of one replica with counters from `first` to `last`, both included."""
        for dot in self._counters(rid, first):
            if dot[1] > last:
                return
            yield dot

    def _counters(self, rid: str, first: int) -> Iterator[Dot]:
        lists = self._lists.get(rid, {})
        for number in sorted(number for number in lists if number >= first >> _SPAN):
            for counter in lists[number]:
                if counter >= first:
                    yield rid, counter


def _holds(counters: list[int], counter: int) -> bool:
    place = bisect_left(counters, counter)
    return place < len(counters) and counters[place] == counter
