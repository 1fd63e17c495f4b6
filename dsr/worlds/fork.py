"""A fork of a graph that shares with it all that neither has changed: made in constant time and memory.

An entry of the store is never changed while another graph may read it: whoever changes it copies it first
(`Store.owned`), after its forks have taken the element over as it was. So a fork grows by what changes, in it or in
its parent, and by nothing else. Parent and forks are locked together; see `tables` for what readers rely on.
"""

from __future__ import annotations

from collections.abc import MutableMapping
from typing import Any

from dsr.crdt.context import CausalContext
from dsr.crdt.delta import EdgeKey, Key
from dsr.crdt.store import Incarnation
from dsr.graph.elements import Edge, Node
from dsr.graph.graph import Graph
from dsr.graph.watches import Watches
from dsr.worlds.handles import SharedEdge, SharedNode
from dsr.worlds.tables import ByKey, Elements, Entries, Groups, Taken


class ForkedGraph(Graph):
    """A replica of a new world that begins as `parent` is at this moment.

    It has the parent's history: whatever the parent has seen, the fork has.

    Args:
        rid: id of the replica, unlike any that ever wrote into the parent.
        parent: the graph to begin as; it must be locked.
        watches: told about changes; it is taken to know what the fork begins with.
    """

    def __init__(self, rid: str, parent: Graph, watches: Watches | None = None) -> None:
        super().__init__(rid, parent.schema, watches)
        self.parent: Graph | None = parent
        """None once nothing is read from it any more."""
        self._taken: Taken = {}
        self._read_from(parent)
        theirs, store = parent.store, self.store
        store.context = CausalContext(theirs.context.ranges())
        store.fingerprint = theirs.fingerprint
        store.forget_order()
        store.unsettled = theirs.unsettled.copy()
        store.owned = set()
        self.hlc.latest = parent.hlc.latest
        self._unattached = parent._unattached.copy()
        parent.share_with(self)

    def _read_from(self, parent: Graph) -> None:
        taken, store = self._taken, parent.store
        self._entries = self.store.entries = Entries(taken, lambda: store.entries)
        self._by_key = self.store.by_key = ByKey(taken, lambda: store.by_key)
        self._nodes = self.nodes = Elements(taken, lambda: parent.nodes, _shared_node)
        self._edges = self.edges = Elements(taken, lambda: parent.edges, _shared_edge)
        self.nodes_by_type = Groups(taken, lambda: parent.nodes_by_type, self._nodes)
        self.edges_by_type = Groups(taken, lambda: parent.edges_by_type, self._edges)
        self.edges_out = Groups(taken, lambda: parent.edges_out, self._edges)
        self.edges_in = Groups(taken, lambda: parent.edges_in, self._edges)
        self.incident = Groups(taken, lambda: parent.incident)

    def forget_handles(self) -> None:
        """See `Graph.forget_handles`."""
        if self.parent is not None:
            tables: list[Any] = [self._nodes, self._edges, self.nodes_by_type, self.edges_by_type]
            for table in [*tables, self.edges_out, self.edges_in, self.incident]:
                table.forget_handles()

    # ---- taking over

    def before_change(self, key: Key) -> None:
        """Take the element over, and let the forks of this fork keep it as it was."""
        self.take_over(key)
        super().before_change(key)

    def take_over(self, key: Key) -> None:
        """Keep the element as it is in the parent, from now on whatever happens there."""
        if self.parent is None or key in self._taken:
            return
        entries = self.parent.store.by_key.get(key)
        if entries is not None:
            self._entries.own.update(entries)
            self._by_key.own[key] = dict(entries)
        if isinstance(key, str):
            self._take_node(key, self.parent)
        else:
            self._take_edge(key, self.parent, known=entries is not None)

    def _take_node(self, name: str, parent: Graph) -> None:
        theirs = parent.nodes.get(name)
        if theirs is not None:
            node = self._nodes.own[name] = Node(name, theirs._entries)
            _take(self.nodes_by_type, node.type, name, node)
        self._taken[name] = None
        self._nodes.forget(name)

    def _take_edge(self, key: EdgeKey, parent: Graph, *, known: bool) -> None:
        theirs = parent.edges.get(key)
        if theirs is not None:
            edge = self._edges.own[key] = Edge(key, theirs._entries)
            for index, name in self._edge_indexes(key):
                _take(index, name, key, edge)
        for name in dict.fromkeys(key[:2]) if known else ():
            _take(self.incident, name, key, None)
        self._taken[key] = None
        self._edges.forget(key)

    # ---- standing alone

    def release(self, fork: Any) -> None:
        """See `Graph.release`; what is shared with the parent stays to be copied."""
        super().release(fork)
        if self.store.owned is None and self.parent is not None:
            self.store.owned = set()

    def clear(self) -> None:
        """See `Graph.clear`; whom others read, however little there is, goes on to keep what its parent changes."""
        if self.is_read:
            return
        super().clear()
        if self.parent is not None:
            self.parent.release(self)
            self.parent = None

    def detach(self) -> None:
        """Hold everything of its own; the graph must be locked."""
        if self.parent is None:
            return
        parent, store = self.parent, self.store
        copies = {dot: entry if dot in (store.owned or ()) else _copied(entry) for dot, entry in store.entries.items()}
        by_key = {key: {dot: copies[dot] for dot in entries} for key, entries in store.by_key.items()}
        nodes, edges = self._nodes.own, self._edges.own  # handles that somebody holds look there
        nodes |= {name: Node(name, node._entries) for name, node in self._nodes.items() if name not in nodes}
        edges |= {key: Edge(key, edge._entries) for key, edge in self._edges.items() if key not in edges}
        elements: list[Node | Edge] = [*nodes.values(), *edges.values()]
        for element in elements:
            element._entries = tuple(copies[entry.dot] for entry in element._entries)
        unattached, self.parent = self._unattached, None
        store.entries, store.by_key, store.owned = copies, by_key, set() if self._forks else None
        self.nodes, self.edges = nodes, edges
        self._rebuild_indexes()
        self._unattached = unattached
        parent.release(self)

    def _recover(self) -> None:
        self.detach()
        super()._recover()


def _shared_node(name: str, theirs: Node, own: dict[str, Node]) -> Node:
    return SharedNode(name, theirs._entries, own)


def _shared_edge(key: EdgeKey, theirs: Edge, own: dict[EdgeKey, Edge]) -> Edge:
    return SharedEdge(key, theirs._entries, own)


def _take(groups: MutableMapping[str, Any], name: str, key: Key, value: Any) -> None:
    assert isinstance(groups, Groups)
    groups.take(name, key, value)


def _copied(entry: Incarnation) -> Incarnation:
    copy = Incarnation(entry)
    copy.registers, copy.announced = entry.registers.copy(), entry.announced
    return copy
