"""Changes of others to elements that agents make anew: they wait until these are there, and go to their new dots."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections import Counter, defaultdict
from collections.abc import Callable
from itertools import pairwise

from msgspec.structs import replace

from dsr.crdt.context import Dot, DotRange
from dsr.crdt.delta import Add, Delta, Key, Write
from dsr.network.keys import agent_of

LiveDots = Callable[[Key], list[Dot]]
"""The creation dots under which an element lives now, of all its makers."""


class Rebinding:
    """Changes that wait for the new dots of their elements; each is looked at only when such a dot may be there.

    Args:
        is_anew: whether a dot is one that the agents had made in the recording.
    """

    def __init__(self, is_anew: Callable[[Dot], bool]) -> None:
        self._is_anew = is_anew
        self._made: dict[Dot, Key] = {}
        self._writes: dict[Dot, dict[str, Write]] = {}
        """By the old dot of their element, and by attribute."""
        self._adds: dict[Dot, Add] = {}
        self._holes: dict[str, list[int]] = defaultdict(list)
        """Counters of the edges that wait, sorted, by replica."""
        self._at: dict[Key, dict[Dot, None]] = defaultdict(dict)
        """By element, the old dots and the edges for which something waits."""
        self._due: dict[Dot, None] = {}
        """Those of them that are to be looked at."""

    @property
    def waiting(self) -> Counter[str]:
        """Number of waiting changes, by the agents that made them."""
        writers = [write.writer for writes in self._writes.values() for write in writes.values()]
        return Counter(map(agent_of, [*writers, *(add.dot[0] for add in self._adds.values())]))

    def note_made(self, add: Add) -> None:
        """The agents had made this in the recording."""
        self._made[add.dot] = add.key

    def note_removed(self, dot: Dot) -> None:
        """This was removed in the recording: nothing waits for it any more."""
        if dot in self._adds:
            self._take_edge(dot)
        key = self._made.pop(dot, None)
        if key is not None and self._writes.pop(dot, None) is not None:
            self._leave(key, dot)

    def note_live(self, key: Key) -> None:
        """The agents may have made this anew."""
        self._due.update(self._at.get(key, ()))

    def take_add(self, add: Add) -> bool:
        """Keep this edge waiting if it hangs at nodes of the agents, and tell whether it does."""
        if not any(map(self._is_anew, (*add.sources, *add.destinations))):
            return False
        if add.dot not in self._adds:
            insort(self._holes[add.dot[0]], add.dot[1])
        self._adds[add.dot] = add
        for name in add.key[:2]:
            self._at[name][add.dot] = None
        self._due[add.dot] = None
        return True

    def take_write(self, write: Write) -> bool:
        """Keep this write waiting if it goes into an element of the agents, and tell whether it does."""
        if not self._is_anew(write.owner):
            return False
        key = self._made.get(write.owner)
        if key is not None:
            writes = self._writes.setdefault(write.owner, {})
            before = writes.get(write.attribute)
            if before is None or (before.stamp, before.writer) < (write.stamp, write.writer):
                writes[write.attribute] = write
            self._at[key][write.owner] = self._due[write.owner] = None
        return True

    def without_waiting(self, context: list[DotRange]) -> list[DotRange]:
        """`context` without the dots of edges that wait: who has seen a dot and has no edge takes it to be removed."""
        kept: list[DotRange] = []
        for rid, first, last in context:
            holes = self._holes.get(rid, [])
            inside = holes[bisect_left(holes, first) : bisect_right(holes, last)]
            kept += [(rid, a + 1, b - 1) for a, b in pairwise([first - 1, *inside, last + 1]) if a + 1 <= b - 1]
        return kept

    def bound(self, live: LiveDots) -> Delta:
        """Return the changes that have found their new dots; they wait no more."""
        delta, due = Delta(), self._due
        self._due = {}
        for dot in due:
            if dot in self._adds and (edge := self._bound_edge(self._adds[dot], live)) is not None:
                self._take_edge(dot)
                delta.adds.append(edge)
            if dot in self._writes and (owners := live(key := self._made[dot])):
                writes = self._writes.pop(dot).values()
                self._leave(key, dot)
                delta.writes += [replace(write, owner=new) for write in writes for new in owners]
        return delta

    def _bound_edge(self, add: Add, live: LiveDots) -> Add | None:
        """The edge at the new dots of its ends; None while one of these is not there."""
        sources, destinations = (
            (*(end for end in ends if not self._is_anew(end)), *live(name))
            for ends, name in zip((add.sources, add.destinations), add.key[:2], strict=True)
        )
        return replace(add, sources=sources, destinations=destinations) if sources and destinations else None

    def _take_edge(self, dot: Dot) -> None:
        """An edge waits no more."""
        add, holes = self._adds.pop(dot), self._holes[dot[0]]
        del holes[bisect_left(holes, dot[1])]
        for name in dict.fromkeys(add.key[:2]):
            self._leave(name, dot)

    def _leave(self, key: Key, dot: Dot) -> None:
        """For that dot nothing waits at an element any more."""
        self._at[key].pop(dot, None)
        if not self._at[key]:
            del self._at[key]
