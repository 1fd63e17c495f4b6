"""Stamps writes and repeated writes, and makes elements anew whose stamps leave no room to overwrite them.

Last-writer-wins needs one thing only: a write made after another one *of the same attribute* was seen has the greater
stamp. So a write goes beyond the clock and beyond what it overwrites, and no forged stamp elsewhere matters. The order
of stamps has an end, and somebody may have used it. A removal has none: it covers just what was seen. So what cannot
be overwritten is removed and created again, with the same values and stamps of now.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from dsr.crdt.context import Dot
from dsr.crdt.delta import TOMBSTONE, Add, Delta, EdgeKey, Key, Write
from dsr.crdt.hlc import MAX_STAMP, HybridClock, stamp_at
from dsr.crdt.store import Incarnation
from dsr.errors import NoRoomError
from dsr.graph.elements import Edge, Node, type_of, write_in
from dsr.graph.far_stamps import FAR, FarStamps
from dsr.graph.rights import Rights
from dsr.graph.schema import Schema
from dsr.graph.sharing import Sharing

MAX_WRITTEN = 64
"""Incarnations into which a value is written: so many agents that made one node at once. A liar makes any number."""


class Renewal(NamedTuple):
    """An element that is to be made anew."""

    element: Node | Edge
    type: str
    """The type under which it is made."""
    writes: tuple[Write, ...]
    """The writes that gave what is made anew its present values."""


class Stamping(Sharing):
    """Base of `Graph`."""

    rid: str
    schema: Schema
    hlc: HybridClock
    far: FarStamps
    """Noticed stamps of the far future, which no honest clock can have made."""
    counter: int
    rights: Rights | None

    def live(self, key: Key) -> list[Incarnation]:
        """See `Graph.live`."""
        raise NotImplementedError

    def incident_keys(self, name: str) -> list[EdgeKey]:
        """See `Graph.incident_keys`."""
        raise NotImplementedError

    def _entries_of(self, key: Key, add: Add | None, attributes: Iterable[str]) -> list[Dot]:
        raise NotImplementedError

    def _ends_at(self, name: str) -> tuple[Dot, ...]:
        """Creation dots of a node that is seen. Raises `NodeNotFoundError`."""
        raise NotImplementedError

    def new_dot(self) -> Dot:
        """See `Graph`."""
        raise NotImplementedError

    def _apply(self, delta: Delta) -> None:
        raise NotImplementedError

    # ---- stamps

    def newest_stamp(self, owner: Dot, attribute: str) -> int:
        """The stamp (see `dsr.crdt.hlc`) of an attribute's value in one incarnation; 0 if it never was set."""
        entry = self.store.entries.get(owner) or self.store.find(owner)
        write = entry.registers.get(attribute) if entry is not None else None
        return 0 if write is None else write.stamp

    def _stamp(self, key: Key, owners: list[Dot], attribute: str, tick: int) -> int:
        """A stamp for a write to these incarnations: not below `tick`, and beyond all that is seen of the element.

        Raises `NoRoomError` if there is none.
        """
        if self.rights is not None or len(owners) >= MAX_WRITTEN:
            owners = [entry.dot for entry in self.live(key)] or owners  # also those that are not ours to write
        if len(owners) == 1:
            newest = self.newest_stamp(owners[0], attribute)
        else:
            newest = max([self.newest_stamp(owner, attribute) for owner in owners], default=0)
        if newest < tick:
            return tick
        if newest >= MAX_STAMP:
            raise NoRoomError(key, attribute)
        return newest + 1

    def _heed(self, writes: list[Write], now: float) -> None:
        """Let the clock follow what arrives at physical time `now` (s), and notice what it does not follow."""
        greatest = writes[0].stamp if len(writes) == 1 else max([write.stamp for write in writes])
        if self.hlc.observe(greatest, now):
            return
        self.far.notice(writes, self.store, now)
        for write in writes:
            self.hlc.observe(write.stamp, now)

    # ---- repeating

    def copy(self, key: Key, type: str, writes: Iterable[Write], now: float) -> Delta:
        """Repeat writes of another graph in the element `key`, which is created if it is not visible.

        The stamps stay: newer values stay too, and what was repeated once is an empty delta the next time. Only the
        attribute and the value of a write, and its stamp, count; 0 stands for now, as do stamps of the far future.
        Names and values are not checked.

        Raises:
            NodeNotFoundError: if an end of an edge is missing.
            NoRoomError: if a value is to be overwritten that has the greatest stamp.
        """
        element = self._visible(key)
        add = None
        if element is None:
            ends = [] if isinstance(key, str) else [self._ends_at(name) for name in key[:2]]
            add = Add(self.new_dot(), key, type, *ends)
        first = self.counter + (0 if add else 1)
        writes = list(writes)
        owners = self._entries_of(key, add, [write.attribute for write in writes])
        stamped = list(self._restamped(key, owners, element, writes, now))
        delta = Delta(adds=[add] if add else [])
        for stamp, write in stamped:
            known = self.schema.attributes.get(write.attribute)
            stream = not add and write.value is not TOMBSTONE and known is not None and known.stream
            for owner in owners:
                dot = None if stream else self.new_dot()
                delta.writes.append(Write(owner, write.attribute, stamp, self.rid, dot, write.value))
        if self.counter >= first:
            delta.context.append((self.rid, first, self.counter))
        if delta:
            self._apply(delta)
        return delta

    def _restamped(
        self, key: Key, owners: list[Dot], element: Node | Edge | None, writes: Iterable[Write], now: float
    ) -> Iterator[tuple[int, Write]]:
        """The writes that are to be repeated, each with its stamp here."""
        far = stamp_at(now + FAR)
        for write in writes:
            present = element.newest_write(write.attribute) if element is not None else None
            if present is not None and 0 < write.stamp <= present.stamp:
                continue
            if 0 < write.stamp <= far:
                self.hlc.observe(write.stamp, now)
                yield write.stamp, write
            elif present is None or write.stamp == 0 or present.value != write.value:
                yield self._stamp(key, owners, write.attribute, self.hlc.tick(now)), write

    # ---- making anew

    def renewals(self, key: Key) -> list[Renewal]:
        """List the elements that are made anew with the element `key`: first itself, then the edges at it if it is a
        node. What others have made of them, and is not ours to remove, is left as it is.
        """
        keys: list[Key] = [key, *(self.incident_keys(key) if isinstance(key, str) else ())]
        gone, found = set(self.renewable(key)), []
        for element in [element for each in keys if (element := self._visible(each)) is not None]:
            entries = tuple([e for e in element._entries if self.rights is None or e.dot in gone])
            if entries:
                found.append(Renewal(element, type_of(entries), tuple(_present(entries))))
        return found

    def renewable(self, key: Key) -> list[Dot]:
        """Creation dots of an element, with the edges at a node, but those that are not ours to remove."""
        rights, rid = self.rights, self.rid
        if not isinstance(key, str):
            return [e.dot for e in self.live(key) if rights is None or rights.may_write(rid, e, ())]
        keys: list[Key] = [key, *self.incident_keys(key)]
        dots = [entry.dot for each in keys for entry in self.live(each)]
        return dots if rights is None else rights.removable(rid, dots, self)

    def renew(self, key: Key, now: float) -> Delta:
        """Remove a visible element, with the edges at a node, and create its visible content again.

        Values keep their stamps, except those from the far future, which are stamped anew at `now` (s).
        """
        renewed, delta = self.renewals(key), Delta(removed=self.renewable(key))
        first = self.new_dot()  # that of the removal
        tick, far = self.hlc.tick(now), stamp_at(now + FAR)
        for each in renewed:
            add = self._again(each, key, delta.adds)
            delta.adds.append(add)
            for write in each.writes:
                stamp = write.stamp if write.stamp <= far else tick
                delta.writes.append(Write(add.dot, write.attribute, stamp, self.rid, self.new_dot(), write.value))
        delta.context.append((*first, self.counter))
        self._apply(delta)
        return delta

    def _again(self, renewal: Renewal, renewed: Key, made: list[Add]) -> Add:
        """The addition of an element that is there; `made` begins with that of the node `renewed`, if it is one."""
        element = renewal.element
        return Add(self.new_dot(), element.key, renewal.type, *self._ends_again(element, renewed, made))

    def _ends_again(self, element: Node | Edge, renewed: Key, made: list[Add]) -> list[tuple[Dot, ...]]:
        """The ends of an element that is made anew; none of a node."""
        if isinstance(element, Node):
            return []
        return [(made[0].dot,) if name == renewed else self._ends_at(name) for name in (element.src, element.dst)]


def _present(entries: tuple[Incarnation, ...]) -> Iterator[Write]:
    for attribute in sorted({name for entry in entries for name in entry.registers}):
        write = write_in(entries, attribute)
        if write is not None and write.value is not TOMBSTONE:
            yield write
