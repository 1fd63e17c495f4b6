"""Changes since the journal was last written, bounded by the number of changed values, and the whole state in small
pieces.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager
from typing import Any

from dsr.crdt.context import Dot
from dsr.crdt.delta import Add, Delta, Write, beats
from dsr.crdt.store import Store

_PIECE = 200
"""Nodes and edges copied at a time: a writer waits no longer than that takes (about 0.5 ms)."""


class PendingWrites:
    """Everything that was joined since the last `take`; of each attribute only the write that won.

    The dots of the others count as seen with it. A synchronisation reply accounts for what was there before it and does
    not hold that, so it stays in its place. The caller holds the replica's lock.
    """

    def __init__(self) -> None:
        self._before: list[Delta] = []
        """What was joined up to the last reply, in order."""
        self._news = Delta()
        self._writes: dict[tuple[Dot, str], Write] = {}

    def __bool__(self) -> bool:
        return bool(self._before or self._writes or self._news)

    def add(self, delta: Delta) -> None:
        """Take note of a joined delta."""
        if delta.live is not None:
            self._before = [*self.take(), delta]
            return
        self._news.adds += delta.adds
        self._news.removed += delta.removed
        self._news.extend_context(delta.context)
        for write in delta.writes:
            known = self._writes.setdefault((write.owner, write.attribute), write)
            if beats(write, known):
                self._writes[write.owner, write.attribute] = write

    def take(self) -> list[Delta]:
        """Return the pending changes, as deltas to be joined in this order; nothing is pending afterwards."""
        self._news.writes = list(self._writes.values())
        taken = [*self._before, *([self._news] if self._news else [])]
        self._before, self._news, self._writes = [], Delta(), {}
        return taken


def pieces(store: Store, lock: AbstractContextManager[Any]) -> Iterator[Delta]:
    """The state of `store` in pieces that are copied one by one under its `lock`, which the caller holds now.

    What changes meanwhile may be in them or not; whoever joins them joins what was pending from now on, too.
    """
    dots = store.written_dots()
    waiting = Delta(writes=store.waiting_writes())  # what they wait for may come with what is new
    last = Delta(context=list(store.context.ranges()), live=frozenset(store.entries))
    return _copied(store, lock, dots, [waiting, last] if waiting else [last])


def _copied(
    store: Store, lock: AbstractContextManager[Any], dots: list[Dot], last: list[Delta]
) -> Iterator[Delta]:
    for start in range(0, len(dots), _PIECE):
        with lock:
            found = [entry for dot in dots[start : start + _PIECE] if (entry := store.find(dot))]
            entries = [entry for entry in found if entry.dot in store.entries]
            writes = [write for entry in found for write in entry.registers.values()]
        adds = [Add(entry.dot, entry.key, entry.type, entry.sources, entry.destinations) for entry in entries]
        yield Delta(adds=adds, writes=writes)
    yield from last
