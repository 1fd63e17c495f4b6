"""An overlay of a graph: its own content, and everything else live from its parent, attribute by attribute.

Only the overlay's own layer is state, replicated among those that have the overlay open; each of them also has the
parent open, and looks through. A key that is *taken* has a view of its own in the tables, made anew when the layer or
the parent changes; every other key is read from the parent. What depends on the parent: an edge of the layer is visible
while both its ends are, here; an edge of the parent is hidden with an end of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from dsr.crdt.context import Dot, DotRange
from dsr.crdt.delta import Add, Delta, EdgeKey, Key
from dsr.crdt.store import Incarnation
from dsr.graph.elements import Edge, Node
from dsr.graph.graph import Graph
from dsr.graph.watches import Watches
from dsr.worlds.handles import LayeredEdge, LayeredNode, LiveEdge, LiveNode
from dsr.worlds.layer import Layer, LayerObserver
from dsr.worlds.overlay_frames import OverlayFrames
from dsr.worlds.tables import Elements, Groups, Taken


class Overlay(Graph, LayerObserver):
    """A replica of an overlay of `parent`, empty at first.

    Args:
        rid: id of the replica, unlike any that ever wrote into the parent.
        parent: the graph to look through to; it must be locked, and is locked together with the overlay.
        watches: those over the overlay, with `frames`.
        frames: look through to those of the parent.
    """

    store: Layer

    def __init__(self, rid: str, parent: Graph, watches: Watches, frames: OverlayFrames) -> None:
        super().__init__(rid, parent.schema, watches)
        self.parent = parent
        self._frames = frames
        self._clear_tables()
        parent.watches.show_through(self)

    def _clear_tables(self) -> None:
        parent = self.parent
        taken: Taken = {}
        self._taken = taken
        self._types: dict[Key, str] = {}
        """Of what is taken and seen, the type under which it is listed."""
        self.store = Layer(self, parent.element, parent.is_known, parent.dots_between)
        self._nodes = self.nodes = Elements(taken, lambda: parent.nodes, LiveNode)
        self._edges = self.edges = Elements(taken, lambda: parent.edges, LiveEdge)
        self.nodes_by_type = Groups(taken, lambda: parent.nodes_by_type, self._nodes)
        self.edges_by_type = Groups(taken, lambda: parent.edges_by_type, self._edges)
        self.edges_out = Groups(taken, lambda: parent.edges_out, self._edges)
        self.edges_in = Groups(taken, lambda: parent.edges_in, self._edges)
        self.incident = {}

    def forget_handles(self) -> None:
        """See `Graph.forget_handles`."""
        tables: list[Any] = [self._nodes, self._edges, self.nodes_by_type, self.edges_by_type]
        for table in [*tables, self.edges_out, self.edges_in]:
            table.forget_handles()

    def clear(self) -> None:
        """See `Graph.clear`."""
        self.parent.watches.show_no_more(self)
        self.parent = Graph(self.rid, self.schema)
        self._clear_tables()

    def make_durable(self, patience: int = 3) -> Delta:
        """See `Graph.make_durable`; what was said of elements that the parent has removed goes with them."""
        known, element = self.parent.is_known, self.parent.element
        for dot in [dot for dot in self.store.patches if known(dot) and element(dot) is None]:
            self.store.bury(dot)
        self.store.count_early()
        return super().make_durable(patience)

    def restore(self, delta: Delta, now: float) -> None:
        """See `Graph.restore`."""
        self.store.is_trusted = True
        try:
            super().restore(delta, now)
        finally:
            self.store.is_trusted = False

    # ---- incarnations, here and below

    def live(self, key: Key) -> list[Incarnation]:
        """See `Graph.live`: own ones, and those of the parent that are not hidden."""
        below = [entry for entry in self.parent.live(key) if entry.dot not in self.store.context]
        return [*below, *super().live(key)]

    def incident_keys(self, name: str) -> list[EdgeKey]:
        """See `Graph.incident_keys`."""
        return list(dict.fromkeys([*self.parent.incident_keys(name), *super().incident_keys(name)]))

    def element(self, dot: Dot) -> Incarnation | None:
        """See `Graph.element`."""
        return self.store.element(dot)

    def is_known(self, dot: Dot) -> bool:
        """See `Graph.is_known`."""
        return self.store.is_known(dot)

    def dots_between(self, rid: str, first: int, last: int) -> Iterator[Dot]:
        """See `Graph.dots_between`; those of the parent, too, hidden or not."""
        yield from self.parent.dots_between(rid, first, last)
        yield from super().dots_between(rid, first, last)

    def newest_stamp(self, owner: Dot, attribute: str) -> int:
        """See `Graph.newest_stamp`; the parent's counts, too, unless it is further ahead than the clock follows."""
        below = self.parent.newest_stamp(owner, attribute)
        return max(super().newest_stamp(owner, attribute), below if below <= self.hlc.limit else 0)

    def split(
        self, element: Node | Edge, below: tuple[Incarnation, ...]
    ) -> tuple[tuple[Incarnation, ...], tuple[Incarnation, ...]]:
        """See `Splitting.split`."""
        assert isinstance(element, LayeredNode | LayeredEdge)
        key: Key = element.name if isinstance(element, LayeredNode) else element.key
        own = tuple(super().live(key))
        shown = tuple(entry for entry in below if entry.dot not in self.store.context)
        if isinstance(element, LayeredNode):
            return own, shown
        return tuple(filter(self._has_ends, own)), tuple(filter(self._has_ends, shown))

    def patches_of(self, entries: Iterable[Incarnation]) -> tuple[Incarnation, ...]:
        """See `Splitting.patches_of`."""
        patches = self.store.patches
        return tuple(patches[entry.dot] for entry in entries if entry.dot in patches) if patches else ()

    # ---- what the layer's store reports

    def entries_added(self, key: Key, entries: list[Incarnation]) -> None:
        """See `Graph.entries_added`."""
        if not isinstance(key, str):
            self._note_incident(key)
            for entry in entries:
                if not self._has_ends(entry):
                    self._await_ends(entry)
        self._refresh_with_edges(key)

    def entries_removed(self, key: Key, entries: list[Incarnation]) -> None:
        """See `Graph.entries_removed`."""
        for entry in entries:
            self._unattached.pop(entry.dot, None)
        if not isinstance(key, str) and key not in self.store.by_key:
            for name in key[:2]:
                keys = self.incident.get(name, {})
                keys.pop(key, None)
                if not keys:
                    self.incident.pop(name, None)
        self._refresh_with_edges(key)

    def _refresh_with_edges(self, key: Key) -> None:
        """Look again at an element, and at edges that are bound to those incarnations of a node that came or went."""
        self._refresh(key)
        if isinstance(key, str):
            self._refresh_edges_at(key)

    def register_changed(self, entry: Incarnation, attribute: str) -> None:
        """See `Graph.register_changed`."""
        below = self.parent.element(entry.dot) if entry.type == "" else entry
        if below is None:
            return  # the parent's element is still to come
        key = below.key
        if key not in self._taken:
            self._refresh(key, told=False)
        element = self._visible(key)
        if isinstance(element, LayeredNode | LayeredEdge):
            element.outdate(element._below)
            self.watches.updated(element, attribute)

    def hidden(self, dot: Dot) -> None:
        """See `LayerObserver.hidden`."""
        below = self.parent.element(dot)
        if below is not None:
            self._refresh_with_edges(below.key)

    def _look_below(self, elements: Any) -> None:
        """Look again at what is hidden, or has patches that came before it."""
        for key, element in list(elements.items()):
            if self._concerns(element):
                self._refresh(key)

    def _concerns(self, element: Node | Edge) -> bool:
        """Whether the layer changes how this element of the parent is seen."""
        store = self.store
        return any(
            entry.dot in store.context or entry.dot in store.patches or not self._shows_ends(entry)
            for entry in element._entries
        )

    def _shows_ends(self, entry: Incarnation) -> bool:
        return isinstance(entry.key, str) or self._has_ends(entry)

    # ---- what the parent reports

    def below_came(self, element: Node | Edge) -> None:
        """Note that the parent shows an element that it did not show before."""
        key = element.key
        self._outdate(element)
        if key in self._taken or self._concerns(element):
            self._refresh(key, was_below=False)
        else:
            shown = self._visible(key)
            assert shown is not None
            self.watches.added(shown)
        if isinstance(key, str):
            self._refresh_edges_at(key)

    def below_went(self, element: Node | Edge) -> None:
        """The parent does not show an element any more."""
        key = element.key
        self._outdate(element)
        if key in self._taken:
            self._refresh(key)
        else:
            self.watches.removed(element)
        if isinstance(key, str):
            self._refresh_edges_at(key)

    def below_changed(self, element: Node | Edge, attribute: str) -> None:
        """An attribute of an element of the parent changed."""
        key = element.key
        shown = self._visible(key)
        if isinstance(shown, LayeredNode | LayeredEdge) and shown.layer_write(attribute) is not None:
            return
        if shown is not None:
            self.watches.updated(shown, attribute)

    def below_has_others(self, element: Node | Edge) -> None:
        """Other incarnations of an element of the parent are seen there now."""
        key = element.key
        if key in self._taken or self._concerns(element):
            self._show_others(key)
        elif (shown := self._visible(key)) is not None:
            self.watches.incarnations_changed(shown)  # overlays of this one may hide some of them
        if isinstance(key, str):
            self._refresh_edges_at(key)  # the layer may have had edges of these before

    def _show_others(self, key: Key) -> None:
        old = self._visible(key)
        said = old.said() if isinstance(old, LayeredNode | LayeredEdge) else frozenset()
        self._refresh(key)
        new = self._visible(key)
        if new is old and isinstance(new, LayeredNode | LayeredEdge):  # which values come with which incarnation?
            for attribute in sorted(said | new.said()):
                self.watches.updated(new, attribute)

    def _outdate(self, element: Node | Edge) -> None:
        """What was listed for readers may be other elements now."""
        key = element.key
        if isinstance(key, str):
            self._nodes.forget(key)
            _outdate(self.nodes_by_type, element.type)
        else:
            self._edges.forget(key)
            for index, name in self._edge_indexes(key):
                _outdate(index, name)

    # ---- what is seen

    def _refresh_edges_at(self, name: str) -> None:
        """Look again at edges that are seen, or not, because of this end.

        Those of the parent alone are seen as there, unless something of this end is hidden here.
        """
        hides = any(entry.dot in self.store.context for entry in self.parent.live(name))
        for key in self.incident_keys(name):
            is_own = key in self._taken or key in self.store.by_key
            if is_own or (hides and not all(map(self._shows_ends, self.parent.live(key)))):
                self._refresh(key)
        own = [entry for key in super().incident_keys(name) for entry in super(Overlay, self).live(key)]
        self._detach_or_bury(own)

    def _refresh(self, key: Key, *, told: bool = True, was_below: bool = True) -> None:
        """Take the element, or look again at how it is seen now, and tell what changed by that.

        Args:
            key: of the element.
            told: tell the watches.
            was_below: whether, if it is taken only now, it was seen before as the parent has it.
        """
        old = self._visible(key) if was_below or key in self._taken else None
        type = "" if old is None else self._types.get(key, old.type)
        below: Any = self.parent.nodes.get(key) if isinstance(key, str) else self.parent.edges.get(key)
        view: LayeredNode | LayeredEdge
        view = LayeredNode(key, below, self) if isinstance(key, str) else LayeredEdge(key, below, self)
        new = view if view._entries else None
        before = _values_that_may_change(old, view) if told and old is not None else {}
        if isinstance(old, LayeredNode | LayeredEdge) and new is not None and type == new.type:
            old.outdate(below)
            new = old
        self._put(key, new, below, type)
        if told:
            self._tell(key, old, new, before, type)

    def _put(self, key: Key, new: Any, below: Node | Edge | None, old_type: str) -> None:
        """Have the tables show `new`, or nothing, under this key."""
        first = key not in self._taken
        if isinstance(key, str):
            elements: Any = self._nodes
            groups: list[tuple[Any, str]] = [(self.nodes_by_type, type) for type in {old_type} - {""}]
            into: list[tuple[Any, str]] = [] if new is None else [(self.nodes_by_type, new.type)]
        else:
            elements, groups = self._edges, list(self._edge_indexes(key))
            into = [] if new is None else groups
            if first:
                self._frames.take_over(key[2], key[1])
        kept = {(id(group), name) for group, name in into}  # tables are equal if all that they show is
        for group, name in groups:
            if (id(group), name) not in kept:
                _drop(group, name, key)
        if new is None:
            self._types.pop(key, None)
        else:
            self._types[key] = new.type
            elements.own[key] = new
            for group, name in into:
                group.setdefault(name)[key] = new
        self._taken[key] = None
        if new is None:
            elements.own.pop(key, None)
        elements.forget(key)
        if first and below is not None:
            for group, name in [*into, *groups, *([(self.nodes_by_type, below.type)] if isinstance(key, str) else [])]:
                _outdate(group, name)
        if first and new is None and not isinstance(key, str):
            self._frames.remove(key[2], key[0], key[1])

    def _tell(self, key: Key, old: Any, new: Any, before: dict[str, Any], type: str) -> None:
        if old is not None and (new is None or new.type != type):
            self.watches.removed(old)
            old = None
            if new is None:
                if isinstance(key, str):
                    self._refresh_edges_at(key)
                return
        if new is None:
            return
        if old is None:
            self.watches.added(new)
            if isinstance(key, str):
                self._refresh_edges_at(key)
            return
        for attribute in sorted(before):
            if before[attribute] is not new.get(attribute):
                self.watches.updated(new, attribute)
        self.watches.incarnations_changed(new)

    # ---- as a whole

    def flattened(self) -> Delta:
        """Everything that is seen, as the state of a graph of its own; the graph must be locked.

        Each write is there once, although all incarnations of an element show it: a replica that has seen the dot of
        a write has all that was written under that dot.
        """
        delta = Delta()
        elements: list[Node | Edge] = [*self.nodes.values(), *self.edges.values()]
        for element in elements:
            delta.adds += [Add(e.dot, e.key, e.type, e.sources, e.destinations) for e in element._entries]
            delta.writes += [write for name in element.written if (write := element.newest_write(name)) is not None]
        delta.context = [*self.contexts()]
        return delta

    def contexts(self) -> Iterator[DotRange]:
        """See `Graph.contexts`; all that the parent has seen, too."""
        yield from self.parent.contexts()
        yield from self.store.context.ranges()

    def _recover(self) -> None:
        self.store.rebuild()
        self.store.context.add_range(self.rid, 1, self.counter)
        self.incident, self._unattached = {}, {}
        for key in list(self.store.by_key):
            if not isinstance(key, str):
                self._note_incident(key)
        own = [entry for entry in self.store.entries.values() if not isinstance(entry.key, str)]
        for key in dict.fromkeys([*self._taken, *self.store.by_key]):
            self._refresh(key)
        self._look_below(self.parent.nodes)
        self._look_below(self.parent.edges)
        self._detach_or_bury(own)


def _values_that_may_change(old: Node | Edge, new: LayeredNode | LayeredEdge) -> dict[str, Any]:
    """The values of an element in what is not of both views of it: somebody else may have written any number more."""
    seen = old.read() if isinstance(old, LayeredNode | LayeredEdge) else old._entries
    entries = {id(entry): entry for entry in seen}
    others = {id(entry): entry for entry in new.read()}
    differing = [(entries | others)[each] for each in entries.keys() ^ others.keys()]
    return {name: old.get(name) for entry in differing for name in list(entry.registers)}


def _drop(groups: Any, name: str, key: Key) -> None:
    group = groups.known(name)
    if group is not None and key in group.own:
        del group[key]


def _outdate(groups: Any, name: str) -> None:
    group = groups.known(name)
    if group is not None:
        group.outdate()
