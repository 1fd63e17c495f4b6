"""Recorded changes to what agents make anew: bound to what they made this time, by name.

A change names elements by creation dots. Those of agents that run anew are other dots this time, so writes of others
into their elements, and edges of others at their nodes, must be told the new ones; until there are any, they wait.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from msgspec.structs import replace

from dsr.crdt.context import Dot, DotRange
from dsr.crdt.delta import Add, Delta, Key, Write
from dsr.network.keys import agent_of

LiveDots = Callable[[Key], list[Dot]]
"""The creation dots under which an element lives now, of all its makers."""


class Rebinding:
    """What waits for its new dots.

    Args:
        is_anew: whether a dot is one that the agents had made in the recording.
    """

    def __init__(self, is_anew: Callable[[Dot], bool]) -> None:
        self._is_anew = is_anew
        self._made: dict[Dot, Key] = {}
        self._writes: dict[tuple[Dot, str], Write] = {}
        self._adds: dict[Dot, Add] = {}

    @property
    def waiting(self) -> Counter[str]:
        """How many changes wait, by the agents that made them."""
        writers = [write.writer for write in self._writes.values()] + [add.dot[0] for add in self._adds.values()]
        return Counter(map(agent_of, writers))

    def note_made(self, add: Add) -> None:
        """The agents had made this in the recording."""
        self._made[add.dot] = add.key

    def note_removed(self, dot: Dot) -> None:
        """This was removed in the recording: nothing waits for it any more."""
        self._adds.pop(dot, None)
        if self._made.pop(dot, None) is not None:
            self._writes = {key: write for key, write in self._writes.items() if key[0] != dot}

    def take_add(self, add: Add) -> bool:
        """Whether this edge hangs at nodes of the agents; then it waits here."""
        if not any(map(self._is_anew, (*add.sources, *add.destinations))):
            return False
        self._adds[add.dot] = add
        return True

    def take_write(self, write: Write) -> bool:
        """Whether this goes into an element of the agents; then it waits here."""
        if not self._is_anew(write.owner):
            return False
        if write.owner in self._made:
            before = self._writes.get((write.owner, write.attribute))
            if before is None or (before.stamp, before.writer) < (write.stamp, write.writer):
                self._writes[write.owner, write.attribute] = write
        return True

    def without_waiting(self, context: list[DotRange]) -> list[DotRange]:
        """`context` without the dots of edges that wait: who has seen a dot and has no edge takes it to be removed."""
        holes: dict[str, list[int]] = {}
        for rid, counter in sorted(self._adds):
            holes.setdefault(rid, []).append(counter)
        kept = []
        for rid, first, last in context:
            inside = [counter for counter in holes.get(rid, ()) if first <= counter <= last]
            ends = zip([first, *(hole + 1 for hole in inside)], [*(hole - 1 for hole in inside), last], strict=True)
            kept += [(rid, *pair) for pair in ends if pair[0] <= pair[1]]
        return kept

    def bound(self, live: LiveDots) -> Delta:
        """What has found its new dots; it waits no more."""
        delta = Delta()
        for dot, add in list(self._adds.items()):
            sources, destinations = (
                (*(end for end in ends if not self._is_anew(end)), *live(name))
                for ends, name in zip((add.sources, add.destinations), add.key[:2], strict=True)
            )
            if sources and destinations:
                del self._adds[dot]
                delta.adds.append(replace(add, sources=sources, destinations=destinations))
        for (owner, attribute), write in list(self._writes.items()):
            if owners := live(self._made[owner]):
                del self._writes[owner, attribute]
                delta.writes += [replace(write, owner=new) for new in owners]
        return delta
