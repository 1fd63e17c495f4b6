"""Keeps one graph equal to another by ordinary writes: whoever follows it sees it change as if it were live."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import TypeVar

from dsr.crdt.delta import EdgeKey
from dsr.errors import DsrError
from dsr.graph.elements import Edge, Node
from dsr.graph.schema import AttributeType, Schema
from dsr.graph.watch import Change
from dsr.memory import Memory
from dsr.persistence.content import kind_of

T = TypeVar("T")
_CHUNK = 500
"""Elements that are written together: a replica's outbox is bounded."""


class GraphMirror:
    """Writes into `target` all that it lacks of a source.

    Names that the target's schema lacks are registered there, as the values show. What cannot be written, because
    a name means another kind there or is none at all, is counted in `left_out` and does no further harm.
    """

    def __init__(self, target: Memory) -> None:
        self._target = target
        self.left_out: Counter[str] = Counter()
        """How often something was not written, by reason."""

    def apply(self, changes: Iterable[Change], source: Memory) -> None:
        """Bring the elements of `changes` into step with `source`."""
        nodes: dict[str, None] = {}
        edges: dict[EdgeKey, None] = {}
        for change in changes:
            if change.element == "node":
                nodes[change.name] = None
            else:
                edges[change.src, change.dst, change.type] = None
        self._write(source, nodes, edges)

    def copy(self, source: Memory) -> None:
        """Bring everything into step with `source`."""
        memories = (source, self._target)
        nodes = {node.name: None for memory in memories for node in memory.nodes()}
        edges = {edge.key: None for memory in memories for edge in memory.edges()}
        self._write(source, nodes, edges)

    def _write(self, source: Memory, nodes: dict[str, None], edges: dict[EdgeKey, None]) -> None:
        """Edges go before their nodes, and come after them."""
        for keys in _chunks(edges):
            with self._target.batch():
                for key in keys:
                    if source.get_edge(*key) is None:
                        self._target.remove_edge(*key)
        for names in _chunks(nodes):
            with self._target.batch():
                for name in names:
                    if self._write_node(source, name):
                        edges |= {edge.key: None for edge in [*source.edges(src=name), *source.edges(dst=name)]}
        for keys in _chunks(edges):
            with self._target.batch():
                for key in keys:
                    self._write_edge(source, key)

    def _write_node(self, source: Memory, name: str) -> bool:
        """Whether the edges at it must be looked at again: the node was made anew."""
        theirs, ours = source.get_node(name), self._target.get_node(name)
        if ours is not None and (theirs is None or theirs.type != ours.type):
            self._target.remove_node(name)
            ours = None
        if theirs is None:
            return False
        try:
            self._know(theirs)
            if ours is None:
                self._target.add_node(name, theirs.type, **self._fitting(theirs, theirs.attributes))
                return True
        except DsrError as error:
            self.left_out[str(error)] += 1
            return False
        self._write_values(theirs, ours)
        return False

    def _write_edge(self, source: Memory, key: EdgeKey) -> None:
        theirs, ours = source.get_edge(*key), self._target.get_edge(*key)
        if theirs is None:
            return
        try:
            self._know(theirs)
            if ours is None:
                values = self._fitting(theirs, theirs.attributes)
                self._target.add_edge(*key, **values)
                return
        except DsrError as error:
            self.left_out[str(error)] += 1
            return
        self._write_values(theirs, ours)

    def _write_values(self, theirs: Node | Edge, ours: Node | Edge) -> None:
        wanted, present = theirs.attributes, ours.attributes
        changed = {name: value for name, value in wanted.items() if name not in present or present[name] != value}
        values = self._fitting(theirs, changed)
        if values and isinstance(theirs, Node):
            self._target.update_node(theirs.name, **values)
        elif values and isinstance(theirs, Edge):
            self._target.update_edge(*theirs.key, **values)
        for name in present.keys() - wanted.keys():
            self._target.remove_attribute(ours, name)

    def _know(self, element: Node | Edge) -> None:
        """Let the target's schema know the names of an element. Raises `SchemaError` for one that is no name."""
        schema = self._target.schema
        if isinstance(element, Node) and element.type not in schema.node_types:
            schema.register_node_type(element.type, "")
        elif isinstance(element, Edge) and element.type not in schema.edge_types:
            schema.register_edge_type(element.type, "", geometric="pose" in element)

    def _fitting(self, element: Node | Edge, values: dict[str, object]) -> dict[str, object]:
        """Those of `values` that the target can hold."""
        fitting = {}
        for name, value in values.items():
            try:
                fitting[name] = _stored(self._target.schema, name, value)
            except DsrError as error:
                self.left_out[f"{element.type}: {error}"] += 1
        return fitting


def _stored(schema: Schema, name: str, value: object) -> object:
    if name not in schema.attributes:
        schema.register_attribute(name, AttributeType(kind_of(value)))
    return schema.to_value(name, value)


def _chunks(keys: Iterable[T]) -> Iterator[list[T]]:
    listed = list(keys)
    return (listed[start : start + _CHUNK] for start in range(0, len(listed), _CHUNK))
