"""The store of an overlay: only its own elements, and its own values for elements of its parent.

A write to a node or edge of the parent is a write to that one's creation dot, kept in a *patch*. Hiding is removing
that dot. So both are for one incarnation: what the parent makes anew shows. A patch of which the parent's element has
not arrived waits, and takes no part in the fingerprint: streams may make one here and not there. Nobody can see such a
patch or take it away, so they are as few as the writes that wait in other graphs; the repair brings others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from dsr.crdt.context import Dot
from dsr.crdt.delta import Add, Delta, Write
from dsr.crdt.store import MAX_WAITING, Incarnation, Observer, Store, weight_of


class LayerObserver(Observer):
    """Told about every effective change of a layer."""

    def hidden(self, dot: Dot) -> None:
        """Note that the parent's entry under `dot` is not shown any more."""


class Layer(Store):
    """The replicated state of one overlay.

    Args:
        observer: told about changes.
        below: tells the entry of the parent under a creation dot.
        known_below: tells whether it is clear what became of such a dot.
        between_below: tells the creation dots of the parent's elements of one replica, from a counter to another one.
    """

    bounds_gaps = False
    """Each element of the parent that is hidden may make one."""

    _observer: LayerObserver

    def __init__(
        self,
        observer: LayerObserver,
        below: Callable[[Dot], Incarnation | None],
        known_below: Callable[[Dot], bool],
        between_below: Callable[[str, int, int], Iterable[Dot]],
    ) -> None:
        super().__init__(observer)
        self.patches: dict[Dot, Incarnation] = {}
        """What is said of elements of the parent, by creation dot."""
        self._below = below
        self._known_below = known_below
        self._between_below = between_below
        self._early = 0
        """How much was written to what the parent does not know, since `count_early`."""
        self.is_trusted = False
        """Whether all is kept that is joined, for it was kept here before."""

    def join(self, delta: Delta) -> None:
        """See `Store.join`."""
        context, between = self.context, self._between_below
        below = [dot for dots in delta.context for dot in between(*dots) if dot not in context]
        super().join(delta)
        removed = set(delta.removed) if below else ()
        for dot in dict.fromkeys(below):  # an answer, or a journal, may hide what nobody removes
            if dot in context and dot not in removed:
                self._observer.hidden(dot)

    def find(self, dot: Dot) -> Incarnation | None:
        """See `Store.find`."""
        return self.entries.get(dot) or self.patches.get(dot)

    def written_dots(self) -> list[Dot]:
        """See `Store.written_dots`."""
        return [*self.entries, *self.patches]

    def is_known(self, dot: Dot) -> bool:
        """See `Store.is_known`."""
        return super().is_known(dot) or self._known_below(dot)

    def element(self, dot: Dot) -> Incarnation | None:
        """See `Store.element`; those of the parent, too."""
        return self.entries.get(dot) or (None if dot in self.context else self._below(dot))

    def bury(self, dot: Dot) -> None:
        """The parent's element is gone for good, and what was said of it with it."""
        if self.patches.pop(dot, None) is not None:
            self._leave_order(dot)
            self.context.add(dot)

    def count_early(self) -> None:
        """Count anew what waits for elements of the parent that have not arrived; to be called once a second."""
        known = self._known_below
        waiting = [patch for dot, patch in self.patches.items() if not known(dot)]
        self._early = sum(weight_of(write) for patch in waiting for write in patch.registers.values())

    def _write(self, write: Write) -> bool:
        owner = write.owner
        if owner in self.entries or owner in self.context:
            return super()._write(write)
        known = self._known_below(owner)
        if known and self._below(owner) is None:
            return True  # the parent has removed it
        if not known:
            if self._early >= MAX_WAITING and not self.is_trusted:
                self.lost_waiting += write.dot is not None
                return write.dot is None
            self._early += weight_of(write)
        if owner not in self.patches:
            patch = self.patches[owner] = Incarnation(Add(owner, "", ""))
            patch.announced = True
            self._take_place(owner)
        return super()._write(write)

    def _add(self, add: Add) -> Incarnation | None:
        entry = super()._add(add)
        patch = self.patches.pop(add.dot, None)
        if entry is not None and patch is not None:
            entry.registers = patch.registers
        return entry

    def _take_out(self, dot: Dot) -> Incarnation | None:
        own, known = dot in self.entries, dot in self.context
        if self.patches.pop(dot, None) is not None and not own:
            self._leave_order(dot)
        entry = super()._take_out(dot)
        if not known:  # an own element was seen, and is none of the parent's
            self._observer.hidden(dot)
        return entry

    def rebuild(self) -> None:
        """See `Store.rebuild`."""
        super().rebuild()
        for dot, patch in self.patches.items():
            for write in patch.registers.values():
                if write.dot is None:
                    self.unsettled.setdefault((dot, write.attribute), 0)
