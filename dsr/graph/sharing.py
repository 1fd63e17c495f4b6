"""Keeps the old elements of a graph for its forks before the graph changes them (dsr/worlds/fork.py)."""

from __future__ import annotations

import weakref
from collections.abc import Iterator, MutableMapping
from typing import Protocol, TypeVar

from dsr.crdt.context import Dot
from dsr.crdt.delta import EdgeKey, Key
from dsr.crdt.store import Incarnation, Observer, Store
from dsr.graph.elements import Edge, Node
from dsr.graph.watches import Watches

_HANDLES_LAST = 200
"""Polls (10 s of threads) for which forks and overlays keep what they made to be read."""

K = TypeVar("K")
V = TypeVar("V")
Groups = MutableMapping[str, MutableMapping[K, V]]
"""Elements grouped by a name that they share."""


class Fork(Protocol):
    """A graph that began as another one and still reads from it."""

    def take_over(self, key: Key) -> None:
        """The other graph is about to change this element: keep it as it is."""


class Sharing(Observer):
    """Base of `Graph`."""

    store: Store
    nodes: MutableMapping[str, Node]
    edges: MutableMapping[EdgeKey, Edge]

    def __init__(self, watches: Watches) -> None:
        self.watches = watches
        """Told about every visible change, local or remote."""
        self._forks: list[weakref.ref[Fork]] = []
        self._polls = 0

    def share_with(self, fork: Fork) -> None:
        """Let `fork` read the present content, and keep later changes from it; the graph must be locked."""
        self._forks = [other for other in self._forks if other() is not None] + [weakref.ref(fork)]
        self.store.owned = set()

    @property
    def is_read(self) -> bool:
        """Whether a fork or an overlay still reads from this graph."""
        return any(fork() is not None for fork in self._forks) or bool(self.watches.overlays)

    def release(self, fork: Fork | None) -> None:
        """Tell `fork` about nothing any more; the graph must be locked."""
        self._forks = [other for other in self._forks if other() not in (None, fork)]
        if not self._forks:
            self.store.owned = None

    def element(self, dot: Dot) -> Incarnation | None:
        """Find the live entry under a creation dot, in this graph or in its parent; None if there is none."""
        return self.store.entries.get(dot)

    def dots_between(self, rid: str, first: int, last: int) -> Iterator[Dot]:
        """The creation dots of what one replica made here and below, with counters from `first` to `last`."""
        yield from self.store.order.between(rid, first, last)

    def is_known(self, dot: Dot) -> bool:
        """Whether `dot` was seen, here or below: its element is here, or was removed."""
        return dot in self.store.context

    def forget_handles(self) -> None:
        """Give back what only makes reading again faster."""

    def tidy(self) -> None:
        """Give back what is not needed any more; called at each poll, the graph must be locked."""
        self._polls += 1
        if self._polls % _HANDLES_LAST == 0:
            self.forget_handles()
        if self._forks and any(fork() is None for fork in self._forks):
            self.release(None)
        self.watches.tidy()

    def before_change(self, key: Key) -> None:
        """Give the forks the element `key` as it is, before it changes."""
        for reference in self._forks:
            fork = reference()
            if fork is not None:
                fork.take_over(key)

    def entry_copied(self, old: Incarnation, new: Incarnation) -> None:
        """Show the copy, which is about to change, in the place of the one that forks read."""
        element = self._visible(new.key)
        if element is not None:
            element._entries = tuple(new if entry is old else entry for entry in element._entries)

    def _visible(self, key: Key) -> Node | Edge | None:
        return self.nodes.get(key) if isinstance(key, str) else self.edges.get(key)
