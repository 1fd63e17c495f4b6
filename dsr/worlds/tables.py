"""Tables of a fork: its own entries, and below them, unchanged, the entries of its parent.

A key that is `taken` is the fork's alone; every other one is read from the parent. The parent takes each key over into
its forks before it changes it, so whoever reads looks at the fork's own table, then at the parent's, and then makes
sure that the key was not taken meanwhile. That needs no lock.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping, MutableMapping
from typing import Any, Generic, TypeVar

from dsr.crdt.context import Dot
from dsr.crdt.delta import Key
from dsr.crdt.store import Incarnation

K = TypeVar("K", bound=Key)
V = TypeVar("V")
Taken = dict[Key, None]
"""The keys that a fork has taken over."""
_EMPTY: Mapping[Any, Any] = {}


def _items(table: MutableMapping[K, V]) -> Iterable[tuple[K, V]]:
    """All members at one moment: `list(d.items())` makes tuples, so that garbage may be collected and others run."""
    return table.copy().items() if isinstance(table, dict) else table.items()


class Elements(MutableMapping[K, V], Generic[K, V]):
    """Visible elements by key.

    Args:
        taken: shared by all tables of the fork.
        parent: tells the parent's table.
        wrap: makes the fork's handle of an element of the parent.
    """

    def __init__(
        self, taken: Taken, parent: Callable[[], MutableMapping[K, V]], wrap: Callable[[K, V, dict[K, V]], V]
    ) -> None:
        self.own: dict[K, V] = {}
        """Of the keys that are taken, those that are visible."""
        self._taken = taken
        self._parent = parent
        self._wrap = wrap
        self._handles: dict[K, V] = {}
        self._version = 0
        self._listed: tuple[int, dict[K, V]] | None = None

    def get(self, key: K, default: V | None = None) -> V | None:  # type: ignore[override]
        """See `MutableMapping`."""
        found = self.own.get(key)
        if found is None:
            found = self._handles.get(key)
        return found if found is not None else self._find(key, default)

    def _find(self, key: K, default: V | None) -> V | None:
        if key not in self._taken:
            theirs = self._parent().get(key)
            if theirs is None:
                return self.own.get(key, default)
            handle = self._wrap(key, theirs, self.own)
            if key not in self._taken:
                self._handles[key] = handle
                if key not in self._taken:
                    return handle
            self._handles.pop(key, None)
        return self.own.get(key, default)

    def handle(self, key: K, theirs: V) -> V:
        """The handle of an element of the parent, which is not kept for the next time."""
        return self._handles.get(key) or self._wrap(key, theirs, self.own)

    def forget_handles(self) -> None:
        """Give back what only makes reading again faster."""
        if self._handles:
            self._handles = {}
        self._listed = None

    def forget(self, key: K) -> None:
        """The key was taken."""
        self._handles.pop(key, None)
        self._version += 1

    def __getitem__(self, key: K) -> V:
        found = self.get(key)
        if found is None:
            raise KeyError(key)
        return found

    def __contains__(self, key: object) -> bool:
        return key in self.own or (key not in self._taken and key in self._parent() and key not in self._taken)

    def __setitem__(self, key: K, value: V) -> None:
        self.own[key] = value
        self._version += 1

    def __delitem__(self, key: K) -> None:
        del self.own[key]
        self._version += 1

    def listed(self) -> dict[K, V]:
        """Visible elements by key; do not change the result."""
        listed, version = self._listed, self._version
        if listed is not None and listed[0] == version:
            return listed[1]
        taken, handles, wrap, own = self._taken, self._handles, self._wrap, self.own
        found = {
            key: handles.get(key) or wrap(key, theirs, own)
            for key, theirs in _items(self._parent())
            if key not in taken
        }
        found |= own
        self._listed = version, found
        return found

    def __iter__(self) -> Iterator[K]:
        return iter(list(self.listed()))

    def __len__(self) -> int:
        return len(self.listed())

    def values(self) -> list[V]:  # type: ignore[override]
        """See `MutableMapping`."""
        return list(self.listed().values())

    def items(self) -> list[tuple[K, V]]:  # type: ignore[override]
        """See `MutableMapping`."""
        return list(self.listed().items())


class Group(MutableMapping[K, V], Generic[K, V]):
    """The elements that share a name: of those that are not taken, the parent's."""

    def __init__(self, taken: Taken, parent: Callable[[], Mapping[K, V]], elements: Elements[K, V] | None) -> None:
        self.own: dict[K, V] = {}
        self._taken = taken
        self._parent = parent
        self._elements = elements
        self._takes = 0
        """Goes up before and after each take, so that what was counted in between does not count."""
        self._left: tuple[int, int] | None = None
        """At which `_takes` it was counted how many of the parent's are neither taken nor in `own`."""
        self._version = 0
        self._listed: tuple[int, list[V]] | None = None

    def take(self, key: K, value: V) -> None:
        """Hold the parent's member `key` as `value` from now on."""
        takes, left = self._takes, self._left
        self._takes = takes + 1
        self[key] = value
        self._left = (takes + 2, left[1] - 1) if left is not None and left[0] == takes else None
        self._takes = takes + 2

    def outdate(self) -> None:
        """Note that the parent's members have changed."""
        self._takes += 2
        self._version += 1

    def forget_handles(self) -> None:
        """Give back what only makes reading again faster."""
        self._listed = None

    def __getitem__(self, key: K) -> V:
        theirs = self._parent()
        if key in self._taken or key not in theirs:
            return self.own[key]
        return theirs[key] if self._elements is None else self._elements[key]

    def __setitem__(self, key: K, value: V) -> None:
        self.own[key] = value
        self._version += 1

    def __delitem__(self, key: K) -> None:
        del self.own[key]
        self._version += 1

    def __iter__(self) -> Iterator[K]:
        taken = self._taken
        theirs = [key for key in list(self._parent()) if key not in taken]
        return iter(dict.fromkeys([*theirs, *self.own]))

    def __len__(self) -> int:
        takes, left, taken, own = self._takes, self._left, self._taken, self.own
        if left is None or left[0] != takes:
            left = self._left = takes, sum(key not in taken and key not in own for key in list(self._parent()))
        count = left[1] + len(own)
        return count if takes == self._takes else sum(1 for _ in self)

    def values(self) -> list[V]:  # type: ignore[override]
        """See `MutableMapping`."""
        listed, version = self._listed, self._version
        if listed is not None and listed[0] == version:
            return listed[1].copy()
        theirs, taken, elements = self._parent(), self._taken, self._elements
        if isinstance(theirs, dict) and elements is not None:
            handle = elements.handle
            members = {key: handle(key, element) for key, element in _items(theirs) if key not in taken}
            found = list((members | self.own).values())  # some of them may have been taken meanwhile
        else:
            found = []
            for key in self:
                with contextlib.suppress(KeyError):  # gone meanwhile
                    found.append(self[key])
        self._listed = version, found
        return found.copy()


class Groups(MutableMapping[str, MutableMapping[K, V]], Generic[K, V]):
    """For each name that elements share (a type, a source, a destination), these elements by key.

    Args:
        taken: shared by all tables of the fork.
        parent: tells the parent's groups.
        elements: gives the fork's handles of members of the parent; None if these serve as they are.
    """

    def __init__(
        self,
        taken: Taken,
        parent: Callable[[], MutableMapping[str, MutableMapping[K, V]]],
        elements: Elements[K, V] | None = None,
    ) -> None:
        self._taken = taken
        self._parent = parent
        self._elements = elements
        self._groups: dict[str, Group[K, V]] = {}

    def take(self, name: str, key: K, value: V) -> None:
        """A member of this group of the parent is about to be taken, as `value`."""
        self._made(name).take(key, value)

    def known(self, name: str) -> Group[K, V] | None:
        """The group of this name, if more is known of it than what the parent knows."""
        return self._groups.get(name)

    def forget_handles(self) -> None:
        """Give back what only makes reading again faster."""
        self._groups = {name: group for name, group in _items(self._groups) if group.own}
        for group in list(self._groups.values()):
            group.forget_handles()

    def _made(self, name: str) -> Group[K, V]:
        """The group of this name, the same one for all threads."""
        group = self._groups.get(name)
        if group is None:
            made = Group(self._taken, lambda: self._parent().get(name, _EMPTY), self._elements)
            group = self._groups.setdefault(name, made)
        return group

    def get(self, name: str, default: Any = None) -> Any:
        """See `MutableMapping`."""
        group = self._groups.get(name)
        if group is None and name in self._parent():
            group = self._made(name)
        return default if group is None else group

    def __getitem__(self, name: str) -> MutableMapping[K, V]:
        group: MutableMapping[K, V] | None = self.get(name)
        if group is None:
            raise KeyError(name)
        return group

    def setdefault(self, name: str, default: object = None) -> MutableMapping[K, V]:
        """See `MutableMapping`."""
        return self._made(name)

    def __setitem__(self, name: str, value: MutableMapping[K, V]) -> None:
        raise NotImplementedError

    def __delitem__(self, name: str) -> None:
        """Only called for a group that is empty."""
        self._groups.pop(name, None)

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys([*self._parent(), *self._groups]))

    def __len__(self) -> int:
        return len(dict.fromkeys([*self._parent(), *self._groups]))


class Entries(MutableMapping[Dot, Incarnation]):
    """Live entries by creation dot. The graph must be locked, as for all that concerns the store."""

    def __init__(self, taken: Taken, parent: Callable[[], MutableMapping[Dot, Incarnation]]) -> None:
        self.own: dict[Dot, Incarnation] = {}
        self._taken = taken
        self._parent = parent

    def get(self, dot: Dot, default: Incarnation | None = None) -> Incarnation | None:  # type: ignore[override]
        """See `MutableMapping`."""
        found = self.own.get(dot)
        if found is None:
            found = self._parent().get(dot)
            if found is None or found.key in self._taken:
                return default
        return found

    def __getitem__(self, dot: Dot) -> Incarnation:
        found = self.get(dot)
        if found is None:
            raise KeyError(dot)
        return found

    def __contains__(self, dot: object) -> bool:
        return self.get(dot) is not None  # type: ignore[arg-type]

    def __setitem__(self, dot: Dot, entry: Incarnation) -> None:
        self.own[dot] = entry

    def __delitem__(self, dot: Dot) -> None:
        del self.own[dot]

    def __iter__(self) -> Iterator[Dot]:
        taken = self._taken
        yield from [dot for dot, entry in self._parent().items() if entry.key not in taken]
        yield from list(self.own)

    def __len__(self) -> int:
        return sum(1 for _ in self)


class ByKey(MutableMapping[Key, dict[Dot, Incarnation]]):
    """Live entries by node or edge, first own ones, then the parent's.

    Do not change entries of a key that is not taken.
    """

    def __init__(self, taken: Taken, parent: Callable[[], MutableMapping[Key, dict[Dot, Incarnation]]]) -> None:
        self.own: dict[Key, dict[Dot, Incarnation]] = {}
        self._taken = taken
        self._parent = parent

    def get(self, key: Key, default: Any = None) -> Any:
        """See `MutableMapping`."""
        found = self.own.get(key)
        if found is None and key not in self._taken:
            found = self._parent().get(key)
        return default if found is None else found

    def __getitem__(self, key: Key) -> dict[Dot, Incarnation]:
        found: dict[Dot, Incarnation] | None = self.get(key)
        if found is None:
            raise KeyError(key)
        return found

    def __setitem__(self, key: Key, entries: dict[Dot, Incarnation]) -> None:
        self.own[key] = entries

    def __delitem__(self, key: Key) -> None:
        del self.own[key]

    def __iter__(self) -> Iterator[Key]:
        taken = self._taken
        yield from [key for key in self._parent() if key not in taken]
        yield from list(self.own)

    def __len__(self) -> int:
        return sum(1 for _ in self)
