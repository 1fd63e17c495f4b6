"""The content of a graph file: nodes, edges and the vocabulary they need; taken from a memory and put into one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from dsr.crdt.delta import EdgeKey
from dsr.errors import ConfigError, CycleError, SchemaError
from dsr.graph.cycles import without_circles
from dsr.graph.elements import Edge, Node
from dsr.graph.schema import AttributeType, Kind, Schema, Value
from dsr.math3d.transforms import Pose
from dsr.memory import Memory

_CHUNK = 500
"""Nodes or edges that are written together: a replica's outbox is bounded."""
_KINDS: dict[type, Kind] = {
    bool: "bool", int: "int", float: "float", str: "str", bytes: "bytes", tuple: "vector", Pose: "pose",
}  # fmt: skip


class NodeContent(NamedTuple):
    """One node of a file."""

    type: str
    attributes: dict[str, Value]


@dataclass
class GraphContent:
    """A graph at rest.

    All names are known to `schema` and all values fit it; both ends of every edge are among the nodes.
    """

    graph: str
    """The graph's name; a file may do without."""
    schema: Schema = field(default_factory=Schema)
    nodes: dict[str, NodeContent] = field(default_factory=dict)
    edges: dict[EdgeKey, dict[str, Value]] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    """Values that could not be taken over as they were, in words."""

    @staticmethod
    def of(memory: Memory) -> GraphContent:
        """Copy the present content of `memory`; names that its schema lacks are described by their values."""
        with memory.replica.lock:
            nodes = {node.name: NodeContent(node.type, dict(node)) for node in memory.nodes()}
            edges = {edge.key: dict(edge) for edge in memory.edges()}
        content = GraphContent(memory.graph_name, nodes=nodes, edges=edges)
        content._describe_names(memory.schema)
        content._drop_misfits()
        return content

    def elements(self) -> Iterator[tuple[str, dict[str, Value]]]:
        """Each node and edge, described for messages, with its attributes."""
        for name, node in self.nodes.items():
            yield f"{node.type} {name!r}", node.attributes
        for (src, dst, type), attributes in self.edges.items():
            yield f"{type} edge {src!r} -> {dst!r}", attributes

    def _describe_names(self, known: Schema) -> None:
        """Register every name in use that is not built in, as `known` has it or else as its values show."""
        for node_type in {node.type for node in self.nodes.values()} - self.schema.node_types.keys():
            self.schema.register_node_type(node_type, known.node_types.get(node_type, ""))
        for edge_type in {key[2] for key in self.edges} - self.schema.edge_types.keys():
            posed = any("pose" in values for key, values in self.edges.items() if key[2] == edge_type)
            self.schema.register_edge_type(
                edge_type, known.edge_types.get(edge_type, ""), geometric=posed or edge_type in known.geometric
            )
        kinds: dict[str, list[Kind]] = {}
        for _, attributes in self.elements():
            for name, value in attributes.items():
                if name not in self.schema.attributes:
                    kinds.setdefault(name, []).append(kind_of(value))
        for name, found in kinds.items():
            self.schema.register_attribute(name, known.attributes.get(name) or AttributeType(_common_kind(found)))

    def _drop_misfits(self) -> None:
        """Leave out values that another kind of the same name rules out: no schema could read them back."""
        for element, attributes in self.elements():
            for name, value in list(attributes.items()):
                try:
                    attributes[name] = self.schema.to_value(name, value)
                except SchemaError as error:
                    self.warnings.append(f"{element}: left out: {error}")
                    del attributes[name]

    def put_into(self, memory: Memory, *, replace: bool = False) -> list[str]:
        """Add the missing elements to `memory`, and write all attributes.

        An edge by which frames would hang in a circle, with others of this content or of this agent, is left out: of a
        circle the one that leads back up, seen from the root.

        Args:
            memory: a replica of the graph; it need not have the name in the file.
            replace: also remove nodes, edges and attributes that this content lacks, and take over types.

        Returns:
            What was left out, in words.

        Raises:
            ConfigError: if a node has another type there, or a name or type that is the graph's own, or if a custom
                name has another kind; nothing is written then.
        """
        self._check_names()
        register(self.schema, memory.schema)
        self._check_types(memory, replace)
        if replace:
            self._remove_others(memory)
        for names in _chunks(self.nodes):
            with memory.batch():
                for name in names:
                    memory.add_node(name, self.nodes[name].type, **self.nodes[name].attributes)
        kept, loose = without_circles(self.edges, memory.schema.geometric)
        left_out = [f"left out: {key[2]} edge {key[0]!r} -> {key[1]!r}: it closes a circle of frames" for key in loose]
        for keys in _chunks(kept):
            with memory.batch():
                for key in keys:
                    try:
                        memory.add_edge(*key, **self.edges[key])
                    except CycleError as error:  # with edges of this agent that are there
                        left_out.append(f"left out: {error!s:.300}")
        return left_out

    def _check_names(self) -> None:
        """Raise `ConfigError` for a node that no user may make."""
        for name, node in self.nodes.items():
            try:
                self.schema.check_node(name, node.type)
            except SchemaError as error:
                raise ConfigError(str(error)) from error

    def _check_types(self, memory: Memory, replace: bool) -> None:
        there = {name: node.type for name in self.nodes if (node := memory.get_node(name))}
        wrong = [name for name, type in there.items() if type != self.nodes[name].type]
        if wrong and not replace:
            listed = ", ".join(f"{name!r} is a {there[name]}, not a {self.nodes[name].type}" for name in wrong[:5])
            more = f" and {len(wrong) - 5} more" if len(wrong) > 5 else ""
            raise ConfigError(f"graph {memory.graph_name!r} holds nodes of other types: {listed}{more}")

    def _remove_others(self, memory: Memory) -> None:
        with memory.batch():
            for node in memory.nodes():
                if node.name not in self.nodes or node.type != self.nodes[node.name].type:
                    memory.remove_node(node.name)
                else:
                    _remove_attributes(memory, node, self.nodes[node.name].attributes)
            for edge in memory.edges():
                if edge.key not in self.edges:
                    memory.remove_edge(*edge.key)
                else:
                    _remove_attributes(memory, edge, self.edges[edge.key])


def _remove_attributes(memory: Memory, element: Node | Edge, kept: Mapping[str, Value]) -> None:
    for name in set(element) - kept.keys():
        memory.remove_attribute(element, name)


def _chunks(items: Iterable[Any]) -> Iterator[list[Any]]:
    listed = list(items)
    return (listed[start : start + _CHUNK] for start in range(0, len(listed), _CHUNK))


def register(names: Schema, schema: Schema) -> None:
    """Let `schema` know all that `names` does. Raises `ConfigError` if a name means something else there."""
    try:
        for name, attribute in names.attributes.items():
            if name not in schema.attributes or not schema.attributes[name].agrees_with(attribute):
                schema.register_attribute(name, attribute)
        for name in names.node_types.keys() - schema.node_types.keys():
            schema.register_node_type(name, names.node_types[name])
        for name, meaning in names.edge_types.items():
            geometric = name in names.geometric
            if name not in schema.edge_types or (name in schema.geometric) != geometric:
                schema.register_edge_type(name, meaning, geometric=geometric)
    except SchemaError as error:
        raise ConfigError(str(error)) from error


def kind_of(value: Any) -> Kind:
    """The kind of attribute that has a value like this one."""
    return _KINDS[type(value)]


def _common_kind(kinds: list[Kind]) -> Kind:
    """The kind that most values of one name have; floats may look like integers."""
    if set(kinds) == {"int", "float"}:
        return "float"
    return max(sorted(set(kinds)), key=kinds.count)
