"""The store of one part of a graph: a causal context of its own, in tables that all parts of a process share."""

from __future__ import annotations

from collections.abc import Iterable, MutableMapping

from dsr.crdt.context import Dot, DotRange
from dsr.crdt.delta import Delta, Key
from dsr.crdt.store import Incarnation, Observer, Store
from dsr.network.keys import part_of

ByKey = MutableMapping[Key, dict[Dot, Incarnation]]


class PartStore(Store):
    """The replicated state of one part.

    Args:
        observer: told about changes.
        by_key: live incarnations by key, of all parts that the process holds.
        part: name of the part.
    """

    def __init__(self, observer: Observer, by_key: ByKey, part: str) -> None:
        super().__init__(observer)
        self.by_key = by_key
        self.part = part
        self.foreign = 0
        """Deltas that held something of another part, which was left out."""

    def join(self, delta: Delta) -> None:
        """See `Store.join`; what is of other parts is left out, by everybody alike."""
        if all(self.owns(rid) for rid in _named(delta)):
            super().join(delta)
            return
        self.foreign += 1
        super().join(portion(delta, self.part))

    def owns(self, rid: str) -> bool:
        """Whether dots of replica `rid` belong here."""
        return part_of(rid) == self.part

    def rebuild(self) -> None:
        """See `Store.rebuild`; what other parts have in the shared table stays."""
        shared = self.by_key
        for key, found in list(shared.items()):
            others = {dot: entry for dot, entry in found.items() if not self.owns(dot[0])}
            if others:
                shared[key] = others
            else:
                del shared[key]
        super().rebuild()
        for key, found in self.by_key.items():
            shared.setdefault(key, {}).update(found)
        self.by_key = shared

    def detach(self) -> list[Incarnation]:
        """Take all out of the shared table, and share nothing any more; returns it, edges first.

        The store itself stays as it is: a question that is under way must not be answered as if all had been removed.
        """
        entries = sorted(self.entries.values(), key=lambda entry: isinstance(entry.key, str))
        own: ByKey = {}
        for entry in entries:
            siblings = self.by_key[entry.key]
            own.setdefault(entry.key, {})[entry.dot] = siblings.pop(entry.dot)
            if not siblings:
                del self.by_key[entry.key]
        self.by_key, self._observer = own, Observer()
        return entries


def portion(delta: Delta, part: str) -> Delta:
    """The portion of a delta that is about one part; the ends of an edge may be in any."""

    def mine(dot: Dot | DotRange) -> bool:
        return part_of(dot[0]) == part

    return Delta(
        [add for add in delta.adds if mine(add.dot)],
        [write for write in delta.writes if mine(write.owner) and (write.dot is None or mine(write.dot))],
        [dot for dot in delta.removed if mine(dot)],
        [dots for dots in delta.context if mine(dots)],
        None if delta.live is None else frozenset(dot for dot in delta.live if mine(dot)),
        None if delta.examined is None else [dots for dots in delta.examined if mine(dots)],
    )


def parts_in(delta: Delta) -> list[str]:
    """Names of the parts that a delta is about, in the order of their first mention."""
    return list(dict.fromkeys(part_of(rid) for rid in _named(delta)))


def _named(delta: Delta) -> Iterable[str]:
    """Replica ids of all dots that a delta changes or accounts for."""
    for add in delta.adds:
        yield add.dot[0]
    for write in delta.writes:
        yield write.owner[0]
        if write.dot is not None:
            yield write.dot[0]
    for dot in delta.removed:
        yield dot[0]
    for rid, _, _ in delta.context:
        yield rid
    for rid, _, _ in delta.examined or ():
        yield rid
