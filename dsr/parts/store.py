"""The store of one part of a graph: a causal context of its own, in tables that all parts of a process share."""

from __future__ import annotations

from collections.abc import MutableMapping

from dsr.crdt.context import Dot
from dsr.crdt.delta import Key
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
