"""The plain model: a heap of facts that only grows, and what a replica that has heard of them must show."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from dsr.crdt.context import Dot
from dsr.crdt.delta import TOMBSTONE, Add, Delta, Key

Fact = tuple[Dot, str, int, str]
"""A register write: owner, attribute, stamp, writer."""
_Register = tuple[int, str, Dot, Any]
"""Stamp, writer, owner and value."""
Shown = dict[Key, tuple[str, dict[str, Any]]]
"""Type and attributes of every visible node and edge."""


@dataclass
class Knowledge:
    """Facts in no order: what was added, removed and written, by anybody."""

    added: dict[Dot, Add] = field(default_factory=dict)
    removed: set[Dot] = field(default_factory=set)
    written: dict[Fact, Any] = field(default_factory=dict)

    def learn(self, other: Knowledge) -> None:
        """Union."""
        self.added |= other.added
        self.removed |= other.removed
        self.written |= other.written

    def waiting(self) -> set[Fact]:
        """Writes to what was never heard of."""
        heard_of = self.added.keys() | self.removed
        return {fact for fact in self.written if fact[0] not in heard_of}

    def passed_on(self) -> Knowledge:
        """What a synchronisation reply carries: all but the writes that wait."""
        waiting = self.waiting()
        written = {fact: value for fact, value in self.written.items() if fact not in waiting}
        return Knowledge(dict(self.added), set(self.removed), written)

    def held(self) -> set[Dot]:
        """The incarnations that can still be seen, here or by somebody who knows more."""
        return {dot for dot, add in self.added.items() if not self._is_over(add)}

    def incarnations(self, key: Key) -> list[Dot]:
        """The creation dots under which `key` can still be seen, here or by somebody who knows more."""
        return [dot for dot, add in self.added.items() if add.key == key and not self._is_over(add)]

    def at(self, name: str) -> list[Dot]:
        """Likewise of all edges that begin or end at `name`."""
        edges = {add.key for add in self.added.values() if not isinstance(add.key, str) and name in add.key[:2]}
        return [dot for key in edges for dot in self.incarnations(key)]

    def is_live(self, dot: Dot) -> bool:
        """Added and not removed."""
        return dot in self.added and dot not in self.removed

    def _is_over(self, add: Add) -> bool:
        ends = (add.sources, add.destinations)
        return add.dot in self.removed or any(end and all(dot in self.removed for dot in end) for end in ends)

    def is_visible(self, dot: Dot) -> bool:
        """Live, and an edge only with a live incarnation of the node at either end."""
        add = self.added[dot]
        ends = () if isinstance(add.key, str) else (add.sources, add.destinations)
        return self.is_live(dot) and all(any(map(self.is_live, end)) for end in ends)

    def shown(self) -> Shown:
        """What is visible, with the newest of the writes that any of its incarnations got."""
        visible = [add for dot, add in self.added.items() if self.is_visible(dot)]
        newest: dict[Dot, dict[str, _Register]] = {add.dot: {} for add in visible}
        for (owner, attribute, stamp, writer), value in self.written.items():
            if owner in newest:
                _keep_newest(newest[owner], attribute, (stamp, writer, owner, value))
        result: Shown = {}
        for key in {add.key for add in visible}:
            together: dict[str, _Register] = {}
            dots = [add.dot for add in visible if add.key == key]
            for dot in dots:
                for attribute, register in newest[dot].items():
                    _keep_newest(together, attribute, register)
            values = {name: value for name, (_, _, _, value) in together.items() if value is not TOMBSTONE}
            result[key] = (self.added[max(dots)].type, values)
        return result


def _keep_newest(registers: dict[str, _Register], attribute: str, register: _Register) -> None:
    registers[attribute] = max(registers.get(attribute, register), register, key=lambda r: r[:3])


def facts_of(delta: Delta) -> Knowledge:
    """What a delta says."""
    facts = Knowledge({add.dot: add for add in delta.adds}, set(delta.removed))
    facts.written = {(w.owner, w.attribute, w.stamp, w.writer): w.value for w in delta.writes}
    return facts


def dots_of(delta: Delta) -> Iterable[Dot]:
    """All dots that a delta accounts for."""
    return [(rid, counter) for rid, first, last in delta.context for counter in range(first, last + 1)]
