"""A graph that holds some parts: what is visible is one graph, what is replicated is one store for each part.

The replica id in a creation dot names the part of an element (`part_of`), so all replicas find it in one place. An edge
is in the part of its source. An end in a part that is not held is neither alive nor removed, as far as one can know:
then the edge is kept and not shown. Edges of which an end died in another part are buried by a removal with a dot of
its own: whoever holds only the part of the edge learns it from that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from dsr.crdt.context import Dot, DotRange, to_ranges
from dsr.crdt.delta import TOMBSTONE, Add, Delta, Key, Write
from dsr.crdt.hlc import stamp_at
from dsr.crdt.store import Incarnation
from dsr.errors import AgentError, NodeTypeError, PartError
from dsr.graph.elements import types_of
from dsr.graph.far_stamps import FAR
from dsr.graph.graph import Graph
from dsr.graph.schema import Schema
from dsr.graph.watches import Watches
from dsr.network.keys import WHOLE, part_of
from dsr.parts.changes import Changes
from dsr.parts.store import PartStore
from dsr.replication.portions import parts_in, portion


class PartGraph(Graph):
    """One part beside the base, as its replica sees it; it is read and written through the `whole`."""

    store: PartStore

    def __init__(self, rid: str, whole: PartedGraph, part: str) -> None:
        super().__init__(rid, whole.schema, whole.watches)
        self.store = PartStore(whole, whole.store.by_key, part)
        self.hlc, self.far = whole.hlc, whole.far
        self.nodes, self.edges = whole.nodes, whole.edges
        self._whole = whole

    def join(self, delta: Delta, now: float) -> None:
        """See `Graph.join`."""
        if delta.writes:
            self._heed(delta.writes, now)
        self._apply(delta)
        if delta.context or delta.removed:
            self._whole._look_sometimes(delta)

    def _look(self, most: int) -> None:
        self._whole._look(most)

    def make_durable(self, patience: int = 3) -> Delta:
        """See `Graph.make_durable`; edges that died of an end in another part are removed with it."""
        return self._whole.with_burials(super().make_durable(patience), self)

    def _recover(self) -> None:
        self._whole._recover()


class PartedGraph(Graph):
    """The base and the parts that this process holds.

    Args:
        rid: id of the replica of the base.
        schema: the vocabulary; the built-in one if None.
        watches: those over all of it.
        claiming: tells which parts claim new nodes of a type, see `PartList.claiming`.
    """

    store: PartStore

    def __init__(
        self,
        rid: str,
        schema: Schema | None = None,
        watches: Watches | None = None,
        claiming: Callable[[str], Iterable[str]] = lambda type: (),
    ) -> None:
        super().__init__(rid, schema, watches)
        self.store = PartStore(self, {}, WHOLE)
        self.parts: dict[str, PartGraph] = {}
        """Those that are held beside the base, by name."""
        self.leaving: set[str] = set()
        """Those into which nothing is written any more."""
        self._claiming = claiming
        self.may_bury: Callable[[Incarnation], bool] = lambda entry: True
        """Tells whether others accept it if this process removes an edge of which an end is gone."""
        self.check_part: Callable[[str], None] | None = None
        """Raises `AgentError` for a part into which this process may not write; None if it may everywhere."""
        self._beyond: dict[str, dict[Dot, Incarnation]] = {}
        """Edges that wait for a part that is not held, by the part."""
        self._condemned: dict[Dot, Incarnation] = {}
        """Edges that died of an end in another part, and are still to be removed."""

    # ---- parts

    def hold(self, part: str, rid: str) -> PartGraph:
        """Begin to hold a part, empty at first; the graph must be locked."""
        member = self.parts[part] = PartGraph(rid, self, part)
        self.leaving.discard(part)
        self._unattached |= self._beyond.pop(part, {})
        return member

    def leave(self, part: str) -> None:
        """Hold a part no more: what is in it goes out of sight; harmless when repeated. The graph must be locked."""
        if part not in self.parts:
            return
        try:
            for entry in self.parts.pop(part).store.detach():
                self.entries_removed(entry.key, [entry])
            self.look_again()
        except BaseException:  # see `Graph._apply`
            self._recover()
            raise

    def members(self) -> list[Graph]:
        """The replicas of the base and of all parts."""
        return [self, *self.parts.values()]

    def _member(self, part: str) -> Graph:
        """The replica of a part that is written to. Raises `PartError` if it is not held, `AgentError`."""
        if part == WHOLE:
            return self
        if part not in self.parts or part in self.leaving:
            raise PartError(f"part {part!r} is not held here: hold_part({part!r}) first; held: {_listed(self.parts)}")
        if self.check_part is not None:
            self.check_part(part)
        return self.parts[part]

    def part(self, key: Key) -> str:
        """The part of a visible element, the base being `WHOLE`; that of the greatest dot if several made it."""
        return part_of(max(entry.dot for entry in self.live(key))[0])

    def _store_of(self, dot: Dot) -> PartStore | None:
        part = part_of(dot[0])
        if part == WHOLE:
            return self.store
        member = self.parts.get(part)
        return None if member is None else member.store

    def element(self, dot: Dot) -> Incarnation | None:
        """See `Graph.element`."""
        store = self._store_of(dot)
        return None if store is None else store.entries.get(dot)

    def is_known(self, dot: Dot) -> bool:
        """See `Graph.is_known`; of a part that is not held nothing is."""
        store = self._store_of(dot)
        return store is not None and dot in store.context

    def dots_between(self, rid: str, first: int, last: int) -> Iterator[Dot]:
        """See `Graph.dots_between`."""
        store = self._store_of((rid, first))
        yield from () if store is None else store.order.between(rid, first, last)

    def newest_stamp(self, owner: Dot, attribute: str) -> int:
        """See `Graph.newest_stamp`."""
        entry = self.element(owner)
        write = entry.registers.get(attribute) if entry is not None else None
        return 0 if write is None else write.stamp

    def contexts(self) -> Iterator[DotRange]:
        """See `Graph.contexts`."""
        for member in self.members():
            yield from member.store.context.ranges()

    def flattened(self) -> Delta:
        """All that is held, as the state of one graph; the graph must be locked."""
        delta = Delta(context=list(self.contexts()))
        for member in self.members():
            for entry in member.store.entries.values():
                delta.adds.append(Add(entry.dot, entry.key, entry.type, entry.sources, entry.destinations))
                delta.writes += entry.registers.values()
        return delta

    # ---- joining

    def join(self, delta: Delta, now: float) -> None:
        """Join a delta of another replica of the base, at physical time `now` (s)."""
        if delta.writes:
            self._heed(delta.writes, now)
        self._apply_in(self, delta)
        if delta.context or delta.removed:
            self._look_sometimes(delta)

    def restore(self, delta: Delta, now: float) -> None:
        """See `Graph.restore`; what is of parts that are not held is left out."""
        for part in parts_in(delta):
            if part == WHOLE or part in self.parts:
                (self.parts[part] if part else self).join(portion(delta, part), now)

    def make_durable(self, patience: int = 3) -> Delta:
        """See `Graph.make_durable`; edges that died of an end in another part are removed with it."""
        return self.with_burials(super().make_durable(patience), self)

    def with_burials(self, delta: Delta, member: Graph) -> Delta:
        """Remove what is to be buried in the part of `member`, too, and return all as one delta of it."""
        part = part_of(member.rid)
        due = [dot for dot, entry in self._condemned.items() if part_of(dot[0]) == part and self.may_bury(entry)]
        if not due:
            return delta
        removal = Delta(removed=due, context=list(to_ranges([member.new_dot()])))
        self._apply_in(member, removal)
        return Delta(delta.adds, delta.writes, due, [*delta.context, *removal.context])

    def _apply(self, delta: Delta) -> None:
        """Join what was changed here, each portion in its part."""
        for part in parts_in(delta):
            self._apply_in(self._member(part), portion(delta, part))

    def _apply_in(self, member: Graph, delta: Delta) -> None:
        try:
            member.store.join(delta)
        except BaseException:  # see `Graph._apply`
            self._recover()
            raise

    def _recover(self) -> None:
        self.store.by_key.clear()  # of a part that is not held any more, too
        for member in self.parts.values():
            member.store.rebuild()
            member.store.context.add_range(member.rid, 1, member.counter)
        self._beyond, self._condemned = {}, {}
        super()._recover()
        edges = [e for each in self.parts.values() for e in each.store.entries.values() if not isinstance(e.key, str)]
        self._detach_or_bury(edges)

    # ---- changing

    def add_node(
        self, name: str, type: str, attributes: Mapping[str, Any], now: float, part: str | None = None
    ) -> Delta:
        """See `Graph.add_node`; a new node is made in `part`, or where nodes of its type belong.

        Raises `PartError` if that part is not held, or if the node is in another one. See `Graph.add_node` for nodes of
        another type under this name: in whatever part, those that one may not change do not count.
        """
        there = () if (node := self.nodes.get(name)) is None else node._entries
        ours = {part_of(entry.dot[0]) for entry in there if entry.type == type}
        if ours and part is not None and part not in ours:
            raise PartError(f"node {name!r} is in {_said(max(ours))}, not in {_said(part)}; remove it first")
        if ours or (there and self._is_taken(there)):
            return super().add_node(name, type, attributes, now)
        member = self._home_for(type) if part is None else self._member(part)
        if member is self:
            return super().add_node(name, type, attributes, now)
        self.schema.check_node(name, type)
        values = self.schema.to_values(attributes)
        add = Add(member.new_dot(), name, type)
        return self._commit(name, [add.dot], add, values, now)

    def add_edge(self, src: str, dst: str, type: str, attributes: Mapping[str, Any], now: float) -> Delta:
        """See `Graph.add_edge`; a new edge is made in the part of its source."""
        key = (src, dst, type)
        if key in self.edges or src not in self.nodes or dst not in self.nodes:
            return super().add_edge(src, dst, type, attributes, now)
        self.schema.check_edge_type(type)
        values = self.schema.to_values(attributes)
        add = Add(self._home(src).new_dot(), key, type, self._ends_at(src), self._ends_at(dst))
        return self._commit(key, [add.dot], add, values, now)

    def _home(self, key: Key) -> Graph:
        return self._member(self.part(key))

    def _home_for(self, type: str) -> Graph:
        """Where new nodes of a type are made: in the first part that claims them, is held, and may be written to."""
        return next((self.parts[part] for part in self._claiming(type) if self._may_write(part)), self)

    def _commit(self, key: Key, owners: list[Dot], add: Add | None, values: Mapping[str, Any], now: float) -> Delta:
        """See `Graph._commit`; each write is by the replica of the part of what it is written to."""
        if not self.parts:
            return super()._commit(key, owners, add, values, now)
        tick = self.hlc.tick(now)
        changes = Changes(self._member, [add] if add else [])
        stamps = [tick if add else self._stamp(key, owners, name, tick) for name in values]
        for (name, value), stamp in zip(values.items(), stamps, strict=True):
            stream = not add and value is not TOMBSTONE and self.schema.attributes[name].stream
            for owner in owners:
                changes.write(owner, name, stamp, value, stream=stream)
        return self._applied(changes.delta())

    def _commit_removal(self, dots: list[Dot]) -> Delta:
        """See `Graph._commit_removal`; edges at a node are left to others where this process may not write."""
        keys = {dot: None if (entry := self.element(dot)) is None else entry.key for dot in dots}
        changes = Changes(self._member)
        changes.remove([dot for dot in dots if keys[dot] == keys[dots[0]] or self._may_write(part_of(dot[0]))])
        return self._applied(changes.delta())

    def _may_write(self, part: str) -> bool:
        try:
            self._member(part)
        except (PartError, AgentError):
            return False
        return True

    def write_poses(self, type: str, poses: Mapping[tuple[str, str], Any], now: float) -> Delta:
        """See `Graph.write_poses`."""
        if not self.parts:
            return super().write_poses(type, poses, now)
        edges = [self.edge(src, dst, type) for src, dst in poses]
        values = [self.schema.to_value("pose", pose) for pose in poses.values()]
        changes, tick = Changes(self._member), self.hlc.tick(now)
        for edge, value in zip(edges, values, strict=True):
            owners = self._owners(edge._entries, ("pose",))
            stamp = self._stamp(edge.key, owners, "pose", tick)
            for owner in owners:
                changes.write(owner, "pose", stamp, value, stream=self.schema.attributes["pose"].stream)
        return self._applied(changes.delta())

    def copy(self, key: Key, type: str, writes: Iterable[Write], now: float) -> Delta:
        """See `Stamping.copy`; what is created belongs where `add_node` and `add_edge` would make it."""
        element = self._visible(key)
        if element is not None and isinstance(key, str) and type not in types_of(element):
            raise NodeTypeError(key, element.type, type)
        add = None
        if element is None:
            ends = [] if isinstance(key, str) else [self._ends_at(name) for name in key[:2]]
            home = self._home_for(type) if isinstance(key, str) else self._home(key[0])
            add = Add(home.new_dot(), key, type, *ends)
        changes, writes = Changes(self._member, [add] if add else []), list(writes)
        owners = self._entries_of(key, add, [write.attribute for write in writes])
        for stamp, write in list(self._restamped(key, owners, element, writes, now)):
            known = self.schema.attributes.get(write.attribute)
            stream = not add and write.value is not TOMBSTONE and known is not None and known.stream
            for owner in owners:
                changes.write(owner, write.attribute, stamp, write.value, stream=stream)
        delta = changes.delta()
        return self._applied(delta) if delta else delta

    def renew(self, key: Key, now: float) -> Delta:
        """See `Stamping.renew`; everything is made anew in its part."""
        renewed = self.renewals(key)
        homes = [self._home(each.element.key) for each in renewed]
        changes, tick, far = Changes(self._member), self.hlc.tick(now), stamp_at(now + FAR)
        changes.remove(self.renewable(key))
        for (element, type, writes), home in zip(renewed, homes, strict=True):
            add = Add(home.new_dot(), element.key, type, *self._ends_again(element, key, changes.adds))
            changes.adds.append(add)
            for write in writes:
                stamp = write.stamp if write.stamp <= far else tick
                changes.write(add.dot, write.attribute, stamp, write.value)
        return self._applied(changes.delta())

    def _applied(self, delta: Delta) -> Delta:
        self._apply(delta)
        return delta

    # ---- what the stores report

    def entries_removed(self, key: Key, entries: list[Incarnation]) -> None:
        """See `Graph.entries_removed`."""
        for entry in () if isinstance(key, str) else entries:
            self._condemned.pop(entry.dot, None)
            self._wait_no_more(entry)
        super().entries_removed(key, entries)

    def _wait_no_more(self, entry: Incarnation) -> None:
        """Forget that an edge waits for parts; of a part for which nothing waits no trace is left."""
        for part in self._parts_beyond(entry):
            waiting = self._beyond.get(part)
            if waiting is not None and waiting.pop(entry.dot, None) is not None and not waiting:
                del self._beyond[part]

    def _parts_beyond(self, entry: Incarnation) -> set[str]:
        """The parts of an edge's ends, but its own."""
        return {part_of(rid) for rid, _ in (*entry.sources, *entry.destinations)} - {part_of(entry.dot[0])}

    def _settle(self, entry: Incarnation) -> None:
        """See `Graph._settle`; edges that wait for other parts alone are set aside until those are held.

        An edge of which an end is still to come in a part that is held is not set aside. That end may turn out to be
        removed, which nobody would tell the edge.
        """
        if self._has_ends(entry) or self.element(entry.dot) is None:
            self._unattached.pop(entry.dot, None)
        elif self._is_dead(entry):
            self._unattached.pop(entry.dot, None)
            self._bury([entry])
        elif (missing := self._parts_missing(entry)) and self._is_settled(entry, missing):
            self._unattached.pop(entry.dot, None)
            for part in missing:
                self._beyond.setdefault(part, {})[entry.dot] = entry

    def _parts_missing(self, entry: Incarnation) -> set[str]:
        """The parts of an edge's ends that are not held."""
        return {part for part in self._parts_beyond(entry) if part != WHOLE and part not in self.parts}

    def _is_settled(self, entry: Incarnation, missing: set[str]) -> bool:
        """Whether it is known of each end what became of it, but for those in `missing` parts."""
        return all(self.is_known(dot) or part_of(dot[0]) in missing for dot in (*entry.sources, *entry.destinations))

    def _bury(self, dead: list[Incarnation]) -> None:
        """Drop what everybody knows to be dead who holds its part; the rest is removed as by a user, a little later."""
        for entry in dead:
            store = self._store_of(entry.dot)
            if store is None:
                continue
            if _dies_alone(store, entry):
                store.join(Delta(removed=[entry.dot]))
            else:
                self._condemned[entry.dot] = entry


def _dies_alone(store: PartStore, entry: Incarnation) -> bool:
    """Whether an end was removed in the part of the edge itself."""
    return any(
        all(dot in store.context and ((node := store.entries.get(dot)) is None or node.key != name) for dot in ends)
        for name, ends in zip(entry.key, (entry.sources, entry.destinations), strict=False)
    )


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"


def _said(part: str) -> str:
    return f"part {part!r}" if part else "no part"

