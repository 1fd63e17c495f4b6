"""The graph: the replicated store plus schema, visibility and indexes; each mutation returns its delta.

Nodes are identified by name. An edge is visible while one of the incarnations that it was bound to is
alive at both ends. Nothing here does I/O or reads a clock; callers serialise mutations and joins.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, MutableMapping, Sequence
from operator import itemgetter
from typing import Any

from dsr.crdt.context import Dot, DotRange
from dsr.crdt.delta import MAX_ENDS, TOMBSTONE, Add, Delta, EdgeKey, Key, Write
from dsr.crdt.hlc import HybridClock
from dsr.crdt.store import Incarnation, Store
from dsr.errors import EdgeNotFoundError, NodeNotFoundError, NodeTypeError, suggest
from dsr.graph.elements import Edge, Node, type_of, types_of
from dsr.graph.far_stamps import FarStamps
from dsr.graph.rights import Rights
from dsr.graph.schema import RECORDS, Schema
from dsr.graph.sharing import Groups
from dsr.graph.stamping import MAX_WRITTEN, Stamping
from dsr.graph.watches import Watches
from dsr.math3d.transforms import Pose
from dsr.network.keys import agent_of, part_of

_POSE = "pose"
_LOOKS = 128
"""Creation dots of ends that are looked at for each change that is joined: those of 64 edges whose ends are to come.
Somebody may send edges whose ends never come, and others must not pay for all of them with each change."""
_LOOKS_BETWEEN = 1 << 15
"""The same once a second, and where a digest shows a difference: 20 ms or about."""


class Graph(Stamping):
    """One replica of a graph."""

    def __init__(self, rid: str, schema: Schema | None = None, watches: Watches | None = None) -> None:
        super().__init__(watches or Watches())
        self.rid = rid
        self.schema = schema or Schema()
        self.store = Store(self)
        self.hlc = HybridClock()
        self.far = FarStamps()
        self.nodes: MutableMapping[str, Node] = {}
        self.edges: MutableMapping[EdgeKey, Edge] = {}
        self.nodes_by_type: Groups[str, Node] = {}
        self.edges_by_type: Groups[EdgeKey, Edge] = {}
        self.edges_out: Groups[EdgeKey, Edge] = {}
        self.edges_in: Groups[EdgeKey, Edge] = {}
        self.incident: Groups[EdgeKey, None] = {}  # not sets: runs of one seed are identical
        """Keys of edges by the names of their ends, visible or not."""
        self.rights: Rights | None = None
        """Tells what others take of what is changed here; None if they take all."""
        self.why_empty = ""
        """For people, why it holds nothing."""
        self._unattached: dict[Dot, Incarnation] = {}
        """Edges of which an end is not here; those at the end were looked at last."""
        self.counter = 0
        """How many dots were issued here under the replica id."""

    # ---- reading

    def node(self, name: str) -> Node:
        """The node `name`. Raises `NodeNotFoundError`."""
        try:
            return self.nodes[name]
        except KeyError:
            names = [name for name, node in list(self.nodes.items()) if node.type not in RECORDS]
            raise NodeNotFoundError(f"no node {name!r}; {self.why_empty or suggest(name, names)}") from None

    def edge(self, src: str, dst: str, type: str) -> Edge:
        """The edge of this type from `src` to `dst`. Raises `EdgeNotFoundError`."""
        try:
            return self.edges[(src, dst, type)]
        except KeyError:
            from_here = [f"{e.type} to {e.dst}" for e in list(self.edges_out.get(src, {}).values())]
            raise EdgeNotFoundError(
                f"no {type} edge from {src!r} to {dst!r}; from {src!r}: {', '.join(from_here) or 'none'}"
            ) from None

    # ---- local mutations

    def add_node(self, name: str, type: str, attributes: Mapping[str, Any], now: float) -> Delta:
        """Create a node; if it is visible already, only write the attributes.

        Raises:
            SchemaError: for unknown names or wrong values.
            NodeTypeError: if the node is there, and nobody has made it of this type. Where rights are told, nodes that
                one may not change do not count.
        """
        if type not in RECORDS:
            self.schema.check_node(name, type)
        values = self.schema.to_values(attributes)
        there = self.nodes.get(name)
        is_ours = there is not None and type in types_of(there)
        if there is not None and not is_ours and self._is_taken(there._entries):
            raise NodeTypeError(name, there.type, type)
        add = None if is_ours else Add(self.new_dot(), name, type)
        return self._commit(name, self._entries_of(name, add, values), add, values, now)

    def add_edge(self, src: str, dst: str, type: str, attributes: Mapping[str, Any], now: float) -> Delta:
        """Create an edge; if it is visible already, only write the attributes.

        Raises:
            SchemaError: for unknown names or wrong values.
            NodeNotFoundError: if an endpoint is missing.
        """
        self.schema.check_edge_type(type)
        values = self.schema.to_values(attributes)
        ends = [self._ends_at(name) for name in (src, dst)]
        key = (src, dst, type)
        add = None if key in self.edges else Add(self.new_dot(), key, type, ends[0], ends[1])
        return self._commit(key, self._entries_of(key, add, values), add, values, now)

    def write(self, element: Node | Edge, attributes: Mapping[str, Any], now: float) -> Delta:
        """Write attributes of a visible element. Raises `SchemaError`."""
        entries = element._entries
        owners = [entries[0].dot] if len(entries) == 1 else self._owners(entries, attributes)
        return self._commit(element.key, owners, None, self.schema.to_values(attributes), now)

    def write_poses(self, type: str, poses: Mapping[tuple[str, str], Pose], now: float) -> Delta:
        """Write the poses of visible edges of one type, by source and destination, at one time.

        Raises:
            EdgeNotFoundError: if one of them is missing; then none is written.
            SchemaError: for a wrong value; likewise.
        """
        edges = [self.edge(src, dst, type) for src, dst in poses]
        values = [self.schema.to_value(_POSE, pose) for pose in poses.values()]
        stream, rid, tick, first = self.schema.attributes[_POSE].stream, self.rid, self.hlc.tick(now), self.counter
        writes = []
        for edge, value in zip(edges, values, strict=True):
            owners = self._owners(edge._entries, (_POSE,))
            stamp = self._stamp(edge.key, owners, _POSE, tick)
            writes += [Write(owner, _POSE, stamp, rid, None if stream else self.new_dot(), value) for owner in owners]
        delta = Delta(writes=writes)
        if self.counter > first:
            delta.context.append((rid, first + 1, self.counter))
        self._apply(delta)
        return delta

    def remove_attribute(self, element: Node | Edge, attribute: str, now: float) -> Delta:
        """Take an attribute away; an empty delta if it is not set."""
        self.schema.attribute(attribute)
        if attribute not in element:
            return Delta()
        owners = self._owners(element._entries, (attribute,))
        return self._commit(element.key, owners, None, {attribute: TOMBSTONE}, now)

    def remove_node(self, name: str) -> Delta:
        """Remove a node and the edges at it, as seen here; an empty delta if it is not visible.

        What others have made of it under a type that is not ours to remove stays, with the edges that hang on that.
        """
        if name not in self.nodes:
            return Delta()
        keys: list[Key] = [name, *self.incident_keys(name)]
        dots = [entry.dot for key in keys for entry in self.live(key)]
        if self.rights is not None:
            dots = self.rights.removable(self.rid, dots, self)
        return self._commit_removal(dots) if dots else Delta()

    def remove_edge(self, key: EdgeKey) -> Delta:
        """Remove an edge as seen here; an empty delta if it is not visible."""
        return self._commit_removal([e.dot for e in self.live(key)]) if key in self.edges else Delta()

    def withdraw(self, key: Key, mine: Callable[[str], bool]) -> Delta:
        """Remove the incarnations of an element that were created by replicas for whose id `mine` holds."""
        dots = [dot for dot in self.store.by_key.get(key, ()) if mine(dot[0])]
        return self._commit_removal(dots) if dots else Delta()

    def join(self, delta: Delta, now: float) -> None:
        """Join a delta of another replica, at physical time `now` (s)."""
        if delta.writes:
            self._heed(delta.writes, now)
        self._apply(delta)
        if self._unattached and (delta.context or delta.removed):  # samples of streams decide nothing
            self._look_sometimes(delta)

    def _look_sometimes(self, delta: Delta) -> None:
        """Look again at edges without ends, at as many as may be expected to be decided by what was joined.

        The end of an answer may decide about all of them.
        """
        is_end = delta.live is not None and not delta.adds
        self._look(sys.maxsize if is_end else _LOOKS * (1 + len(delta)))

    def look_again(self) -> None:
        """Look again at all edges that wait for an end that is not here; the graph must be locked."""
        self._look(sys.maxsize)

    def look_between(self) -> None:
        """Look again at some edges that wait for an end, without a change; the graph must be locked."""
        self._look(_LOOKS_BETWEEN)

    def _look(self, most: int) -> None:
        """Look again at edges that wait longest, until so many creation dots of ends were looked at."""
        chosen = []
        for entry in self._unattached.values():
            if most <= 0:
                break
            chosen.append(entry)
            most -= len(entry.sources) + len(entry.destinations)
        for entry in chosen:
            if most <= 0 and self._unattached.pop(entry.dot, None) is not None:
                self._unattached[entry.dot] = entry
            self._settle(entry)

    def restore(self, delta: Delta, now: float) -> None:
        """Join what was kept of this graph, at physical time `now` (s)."""
        self.join(delta, now)

    def contexts(self) -> Iterator[DotRange]:
        """All dots that have been seen here, as ranges."""
        yield from self.store.context.ranges()

    def make_durable(self, patience: int = 3) -> Delta:
        """Make stream samples durable; to be called about once a second.

        Own samples at once; those of another replica only after `patience` calls without news, which
        catches the last samples of a writer that died before it could do so itself. The dots of the
        delta returned are seen here when it is joined.
        """
        self.look_between()

        def due(write: Write, passes: int) -> bool:
            return write.writer == self.rid or passes >= patience

        delta = self.store.take_not_durable(due, self.new_dot)
        self._apply(delta)
        self.store.context.add_range(self.rid, 1, self.counter)  # a write that was broken off leaves no hole
        return delta

    def _ends_at(self, name: str) -> tuple[Dot, ...]:
        dots = tuple(entry.dot for entry in self.node(name)._entries)
        return dots if len(dots) <= MAX_ENDS else tuple(sorted(dots)[-MAX_ENDS:])

    def _entries_of(self, key: Key, add: Add | None, attributes: Iterable[str]) -> list[Dot]:
        return [add.dot] if add else self._owners(self.live(key), attributes)

    def _owners(self, entries: Sequence[Incarnation], attributes: Iterable[str]) -> list[Dot]:
        """The incarnations into which these attributes are written: those where others take that."""
        if len(entries) == 1:
            return [entries[0].dot]
        rights, rid = self.rights, self.rid
        taken = [e.dot for e in entries if rights is None or rights.may_write(rid, e, attributes)]
        owners = taken or [entry.dot for entry in entries]
        return owners if len(owners) <= MAX_WRITTEN else sorted(owners, key=self._is_ours)[-MAX_WRITTEN:]

    def _is_ours(self, dot: Dot) -> tuple[bool, Dot]:
        """Orders creation dots, last those of this agent."""
        return agent_of(dot[0]) == agent_of(self.rid), dot

    def _is_taken(self, entries: Sequence[Incarnation]) -> bool:
        """Whether a name is: where rights are told, what one may not change keeps nobody from making a node."""
        return self.rights is None or any(self.rights.may_write(self.rid, entry, ()) for entry in entries)

    def live(self, key: Key) -> list[Incarnation]:
        """All incarnations of an element that live; the graph must be locked."""
        return list(self.store.by_key.get(key, {}).values())

    def incident_keys(self, name: str) -> list[EdgeKey]:
        """Keys of the edges at a node, visible or not; the graph must be locked."""
        return list(self.incident.get(name, ()))

    def new_dot(self) -> Dot:
        """A dot that was never issued before; it is for a delta that is joined here at once."""
        self.counter += 1
        return self.rid, self.counter

    def _commit(
        self, key: Key, owners: list[Dot], add: Add | None, values: Mapping[str, Any], now: float
    ) -> Delta:
        """Write `values` into every incarnation in `owners`, so that the removal of one loses none."""
        rid, first = self.rid, self.counter + (0 if add else 1)
        tick, known = self.hlc.tick(now), self.schema.attributes
        stamps: dict[str, int] = {}
        if add is None:  # all of them before the first dot: one may have no room
            for name in values:
                stamps[name] = self._stamp(key, owners, name, tick)
        writes = []
        for name, value in values.items():
            stamp = stamps.get(name, tick)
            stream = not add and value is not TOMBSTONE and known[name].stream
            for owner in owners:
                if not stream:
                    self.counter += 1
                writes.append(Write(owner, name, stamp, rid, None if stream else (rid, self.counter), value))
        context = [(rid, first, self.counter)] if self.counter >= first else []
        delta = Delta([add] if add else [], writes, [], context)
        self._apply(delta)
        return delta

    def _commit_removal(self, dots: list[Dot]) -> Delta:
        delta = Delta()
        delta.removed = dots
        rid, counter = self.new_dot()
        delta.context.append((rid, counter, counter))
        self._apply(delta)
        return delta

    def _apply(self, delta: Delta) -> None:
        try:
            self.store.join(delta)
        except BaseException:  # most often KeyboardInterrupt, at any place
            self._recover()
            raise

    def _recover(self) -> None:
        """Derive all else from the store's entries again; what peers lack of them, they will ask for."""
        store = self.store
        store.rebuild()
        store.context.add_range(self.rid, 1, self.counter)
        self._rebuild_indexes()
        for name in dict.fromkeys([*self.nodes, *(key for key in store.by_key if isinstance(key, str))]):
            self._refresh_node(name)
        for key in dict.fromkeys([*self.edges, *(key for key in store.by_key if not isinstance(key, str))]):
            self._refresh_edge(key)
        self._detach_or_bury([entry for entry in store.entries.values() if not isinstance(entry.key, str)])
        elements: list[Node | Edge] = [*self.nodes.values(), *self.edges.values()]
        for element in elements:
            for attribute in element:
                self.watches.updated(element, attribute)

    def _rebuild_indexes(self) -> None:
        self.incident, self._unattached = {}, {}
        for key in self.store.by_key:
            if not isinstance(key, str):
                self._note_incident(key)
        self.nodes_by_type, self.edges_by_type, self.edges_out, self.edges_in = {}, {}, {}, {}
        for node in self.nodes.values():
            self.nodes_by_type.setdefault(node.type, {})[node.name] = node
        for edge in self.edges.values():
            for index, name in self._edge_indexes(edge.key):
                index.setdefault(name, {})[edge.key] = edge

    def clear(self) -> None:
        """Hold nothing any more, unless another one still reads from here; the graph must be locked."""
        if self.is_read:
            return
        self.store = Store(self)
        self.nodes, self.edges = {}, {}
        self._rebuild_indexes()

    # ---- what the store reports: keep the visible elements and the indexes

    def entries_added(self, key: Key, entries: list[Incarnation]) -> None:
        """Show the new incarnations and what depends on them."""
        by_key = self.store.by_key
        if isinstance(key, str):
            is_new = len(by_key[key]) == len(entries)
            self._refresh_node(key)
            for edge in self.incident_keys(key) if key in self.incident else ():
                if is_new or edge not in self.edges or len(by_key.get(edge, ())) > 1:  # others had this end before
                    self._refresh_edge(edge)
            return
        self._note_incident(key)
        whole = [entry for entry in entries if self._has_ends(entry)]
        if whole:
            is_new = len(by_key[key]) == 1 and self.store.owned is None
            self._refresh_edge(key, (whole[0],) if is_new else None)
        if len(whole) < len(entries):
            for entry in entries:
                if not self._has_ends(entry):
                    self._await_ends(entry)

    def _await_ends(self, entry: Incarnation) -> None:
        """Wait for the ends of an edge that has just come, unless they are known to be gone."""
        if self._is_dead(entry):
            self._bury([entry])
        else:
            self._unattached[entry.dot] = entry

    def _note_incident(self, key: EdgeKey) -> None:
        incident = self.incident
        for name in key[:2]:
            keys = incident.get(name)
            if keys is None:
                keys = incident.setdefault(name, {})
            keys[key] = None

    def entries_removed(self, key: Key, entries: list[Incarnation]) -> None:
        """Hide the incarnations and what depended on them."""
        by_key = self.store.by_key
        if isinstance(key, str):
            edges = self.incident_keys(key) if key in self.incident else []
            if key in by_key:  # others of it are left, and so are edges that are bound to those alone
                gone = {entry.dot for entry in entries}
                edges = [edge for edge in edges if any(_is_bound(e, gone) for e in by_key.get(edge, {}).values())]
            for edge in edges:
                self._refresh_edge(edge)
            self._refresh_node(key)
            self._detach_or_bury([e for edge in edges for e in by_key.get(edge, {}).values()])
            return
        for entry in entries:
            self._unattached.pop(entry.dot, None)
        if key not in by_key:
            for name in key[:2]:
                keys = self.incident.get(name)
                if keys is not None:
                    keys.pop(key, None)
                    if not keys:
                        del self.incident[name]
        self._refresh_edge(key)

    def register_changed(self, entry: Incarnation, attribute: str) -> None:
        """Pass on a change of a visible element."""
        key = entry.key
        element = self.nodes.get(key) if key.__class__ is str else self.edges.get(key)  # type: ignore[arg-type]
        if element is not None and entry in element._entries:
            self.watches.updated(element, attribute)

    def _refresh_node(self, name: str) -> None:
        entries = tuple(self.store.by_key.get(name, {}).values())
        if self.store.owned is not None:
            self.before_change(name)
        old = self.nodes.get(name)
        if old is not None and entries:
            self._change_node(old, entries)
        elif old is not None:
            del self.nodes[name]
            _leave(self.nodes_by_type, old.type, name)
            self.watches.removed(old)
        elif entries:
            node = self.nodes[name] = Node(name, entries)
            self.nodes_by_type.setdefault(node.type, {})[name] = node
            self.watches.added(node)

    def _change_node(self, node: Node, entries: tuple[Incarnation, ...]) -> None:
        """Another incarnation came or went; for watches, a node of another type is another node."""
        type = type_of(entries)
        if type == node.type:
            self._change_incarnations(node, entries)
            return
        _leave(self.nodes_by_type, node.type, node.name)
        self.watches.removed(node)
        node._entries = entries
        self.nodes_by_type.setdefault(type, {})[node.name] = node
        self.watches.added(node)

    def _change_incarnations(self, element: Node | Edge, entries: tuple[Incarnation, ...]) -> None:
        """Another incarnation of a visible element came or went: values that it has may be others now."""
        old = element._entries
        before_and_now = {id(entry): entry for entry in (*old, *entries)}
        came_or_went = [before_and_now[each] for each in set(map(id, old)) ^ set(map(id, entries))]
        before = {name: element.get(name) for entry in came_or_went for name in list(entry.registers)}
        if old != entries:  # else it may be an element that a fork reads from its parent
            element._entries = entries
            self.watches.incarnations_changed(element)
        for attribute, value in sorted(before.items(), key=itemgetter(0)):
            if value is not element.get(attribute):
                self.watches.updated(element, attribute)

    def _refresh_edge(self, key: EdgeKey, entries: tuple[Incarnation, ...] | None = None) -> None:
        """Show an edge as it is now; `entries` are its incarnations with both ends, if known."""
        if entries is None:
            entries = tuple([e for e in self.store.by_key.get(key, {}).values() if self._has_ends(e)])
        old = self.edges.get(key)
        if self.store.owned is not None and entries != (old._entries if old else ()):
            self.before_change(key)
            old = self.edges.get(key)
        if old is not None and entries:
            self._change_incarnations(old, entries)
        elif old is not None:
            for index, name in self._edge_indexes(key):
                _leave(index, name, key)
            del self.edges[key]
            self.watches.removed(old)
        elif entries:
            edge = self.edges[key] = Edge(key, entries)
            for index, name in self._edge_indexes(key):
                index.setdefault(name, {})[key] = edge
            self.watches.added(edge)

    def _edge_indexes(self, key: EdgeKey) -> list[tuple[Groups[EdgeKey, Edge], str]]:
        return [(self.edges_out, key[0]), (self.edges_in, key[1]), (self.edges_by_type, key[2])]

    def _has_ends(self, entry: Incarnation) -> bool:
        """Whether a living node is under a creation dot of each end, and is called as the edge says."""
        key = entry.key
        return self._is_there(key[0], entry.sources) and self._is_there(key[1], entry.destinations)

    def _is_there(self, name: str, dots: tuple[Dot, ...]) -> bool:
        for dot in dots:
            node = self.element(dot)
            if node is not None and node.key == name:
                return True
        return False

    def _is_dead(self, entry: Incarnation) -> bool:
        """Whether an end was removed for good, or never was: then the edge can never be seen again."""
        key = entry.key
        return self._is_gone(key[0], entry.sources) or self._is_gone(key[1], entry.destinations)

    def _is_gone(self, name: str, dots: tuple[Dot, ...]) -> bool:
        return all(map(self.is_known, dots)) and not self._is_there(name, dots)

    def _detach_or_bury(self, entries: list[Incarnation]) -> None:
        """Look again at edges that have lost an end: another incarnation of it may be still to come."""
        for entry in entries:
            if not self._has_ends(entry):
                self._unattached[entry.dot] = entry
                self._settle(entry)

    def _settle(self, entry: Incarnation) -> None:
        """Look again at an edge that came before its ends: an end may have come, or turn out to be removed."""
        if self._has_ends(entry) or self.element(entry.dot) is None:
            self._unattached.pop(entry.dot, None)
        elif self._is_dead(entry):
            self._unattached.pop(entry.dot, None)
            self._bury([entry])
        elif all(part_of(end[0]) or self.is_known(end) for end in entry.sources + entry.destinations):
            self._unattached.pop(entry.dot, None)  # it waits for a part alone, which is not held here (dsr/parts)

    def _bury(self, dead: list[Incarnation]) -> None:
        """Drop edges that no replica can ever show again, so that state does not grow with history."""
        delta = Delta()
        delta.removed = [entry.dot for entry in dead]
        self.store.join(delta)


def _is_bound(edge: Incarnation, dots: set[Dot]) -> bool:
    """Whether one of these is an end of the edge."""
    return not dots.isdisjoint(edge.sources) or not dots.isdisjoint(edge.destinations)


def _leave(groups: Groups[Any, Any], name: str, key: Key) -> None:
    """Take an element out of its group; of an empty group no trace is left."""
    group = groups[name]
    del group[key]
    if not group:
        del groups[name]
