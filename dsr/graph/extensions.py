"""Lets the names that users register travel with the graph, so that every process knows their unit and meaning.

Each registered name is a node of type `schema_record` in the base graph, with one attribute, JSON, so that a record
changes as a whole. A process writes its records before its next write of anything. Whoever gets a record learns the
name, unless the own schema knows it already: what was registered here is never replaced by what arrives. If a record
is removed or made unreadable, those who know the name write it again, before their next write.
"""

from __future__ import annotations

import hashlib
import logging
import weakref
from collections.abc import Container, Iterable, Iterator
from typing import Literal, Protocol

import msgspec

from dsr.errors import SchemaError, WireError
from dsr.graph.elements import Node
from dsr.graph.graph import Graph
from dsr.graph.schema import RECORDS, SCHEMA_RECORD, AttributeType, Registered, Schema
from dsr.graph.watch import ChangeFilter, Watch
from dsr.network.decoding import decoded

_log = logging.getLogger("dsr.memory")
_PREFIX = RECORDS[SCHEMA_RECORD]
_LONGEST = 128
"""Characters that a node's name may have."""
_MOST_TOLD = 1000
"""Records about which something is told: made-up ones take neither memory nor lines of the log."""


class ExtensionRecord(msgspec.Struct, frozen=True, omit_defaults=True):
    """A registered name; the value of the attribute `record`."""

    what: Literal["node", "edge", "attribute"]
    name: str
    meaning: str = ""
    geometric: bool = False
    """Whether edges of this type carry a pose."""
    attribute: AttributeType | None = None
    """Kind, unit, length and meaning, if it is an attribute."""

    @property
    def node_name(self) -> str:
        """Name of the node that holds the record."""
        name = f"{_PREFIX}{self.what}.{self.name}"
        if len(name) <= _LONGEST:
            return name
        return f"{_PREFIX}{self.what}.{hashlib.sha256(self.name.encode()).hexdigest()}"


_BUILT_IN = Schema()
_encoder = msgspec.json.Encoder()
_decoder = msgspec.json.Decoder(ExtensionRecord)


class WritesRecord(Protocol):
    """Writes a node of type `schema_record`, with the graph locked."""

    def __call__(self, name: str, record: str) -> None:
        """Create the node `name`, or write its attribute `record`."""


class Extensions:
    """The names beyond the built-in ones that one process and its peers know of a graph.

    Args:
        schema: the process's vocabulary; it grows by what others registered.
        graph: the base graph, which holds the records.
    """

    def __init__(self, schema: Schema, graph: Graph) -> None:
        self._schema = schema
        self._base = graph
        self._graphs: weakref.WeakSet[Graph] = weakref.WeakSet()
        self._published = 0
        """How many of `Schema.registered` the graph holds."""
        self._named: dict[str, Registered] = {}
        """Names by the nodes that hold their records."""
        self._lost: dict[str, None] = {}
        """Nodes of `_named` whose records were removed, or made unreadable, since the last were published."""
        self._warned: set[str] = set()
        self._watch = Watch(ChangeFilter(node_types=frozenset({SCHEMA_RECORD})), notify=self._learn)
        graph.watches.follow(self._watch, ())

    def serve(self, graph: Graph) -> None:
        """Take `graph`, of any world, into account: its edges have poses once their type is known to be geometric."""
        self._graphs.add(graph)

    @property
    def to_publish(self) -> bool:
        """Whether names are known here of which the graph may hold no record."""
        return bool(self._lost) or len(self._schema.registered) != self._published

    def publish(self, write: WritesRecord) -> None:
        """Write the records that the graph lacks, with the graph locked; the cost follows those that it may lack."""
        names = dict.fromkeys([*self._schema.registered[self._published :], *map(self._named.__getitem__, self._lost)])
        count = len(self._schema.registered)
        for record in _records(self._schema, names):
            name = record.node_name
            self._named[name] = record.what, record.name
            node = self._base.nodes.get(name)
            if node is not None and node.type != SCHEMA_RECORD:
                self._warn(name, f"{record.what} {record.name!r} stays here: node {name!r} is a {node.type!r}")
            elif self._may_describe(self._base.rid, record) and (node is None or not self._holds_record(node)):
                write(name, _encoder.encode(record).decode())
            self._lost.pop(name, None)
        self._published = count

    def _lose(self, name: str) -> None:
        """Note that a node holds no valid record; of nodes that stand for no name here, nobody writes one."""
        if name in self._named:
            self._lost[name] = None

    def _learn(self) -> None:
        """Take over what records say; called with the graph locked, while a message is joined."""
        for change in self._watch.poll():
            node = self._base.nodes.get(change.name)
            if node is None or "record" not in node:
                self._lose(change.name)
                continue
            try:
                record = _decode(node["record"])
                if not self._is_rightful(node, record):
                    raise WireError("its writer may not write what it describes")
                conflict = self._take(record)
                self._named[record.node_name] = record.what, record.name
            except (WireError, SchemaError, TypeError) as error:
                self._lose(change.name)
                self._warn(change.name, f"{change.name}: no valid record of a registered name: {error}")
                continue
            if not self._holds_record(node):
                self._lose(change.name)
            if conflict:
                self._warn(change.name, conflict)

    def _holds_record(self, node: Node) -> bool:
        """Whether a node holds a record of the name for which it stands, by somebody who may tell what that means."""
        record = _read(node)
        return record is not None and self._is_rightful(node, record)

    def _is_rightful(self, node: Node, record: ExtensionRecord) -> bool:
        """Whether who wrote a record may write what it describes: else anybody takes a name that another one needs."""
        write = node.newest_write("record")
        return write is not None and self._may_describe(write.writer, record)

    def _may_describe(self, rid: str, record: ExtensionRecord) -> bool:
        rights = self._base.rights
        return rights is None or rights.may_describe(rid, record.what, record.name)

    def _take(self, record: ExtensionRecord) -> str:
        """Learn one name. Returns what contradicts the name's meaning here; empty if nothing does."""
        schema = self._schema
        known: dict[str, Container[str]] = {
            "node": schema.node_types, "edge": schema.edge_types, "attribute": schema.attributes,
        }  # fmt: skip
        if record.name in known[record.what]:
            return self._conflict(record)
        registered = len(schema.registered)
        if record.what == "node":
            schema.register_node_type(record.name, record.meaning)
        elif record.what == "edge":
            schema.register_edge_type(record.name, record.meaning, geometric=record.geometric)
            if record.geometric:
                self._note_poses(record.name)
        else:
            schema.register_attribute(record.name, record.attribute or AttributeType("str", meaning=record.meaning))
        if self._published == registered:  # nothing of our own waits
            self._published = len(schema.registered)
        return ""

    def _conflict(self, record: ExtensionRecord) -> str:
        schema = self._schema
        if record.what == "edge" and (record.name in schema.geometric) != record.geometric:
            return (
                f"edge type {record.name!r} {_carries(record.name in schema.geometric)} here, "
                f"but {_carries(record.geometric)} for another process"
            )
        if record.what == "attribute" and record.attribute is not None:
            mine = schema.attributes[record.name]
            if not mine.agrees_with(record.attribute):
                return (
                    f"attribute {record.name!r} is {mine.described} here, but {record.attribute.described} "
                    "for another process: their values do not mean the same"
                )
        return ""

    def _note_poses(self, type: str) -> None:
        for graph in list(self._graphs):
            for edge in list(graph.edges_by_type.get(type, {}).values()):
                graph.watches.note_pose(edge)

    def _warn(self, name: str, text: str) -> None:
        if name not in self._warned and len(self._warned) < _MOST_TOLD:
            self._warned.add(name)
            _log.warning("%.500s", text)


def _decode(record: str) -> ExtensionRecord:
    return decoded(record, "record of a name", _decoder.decode)


def _read(node: Node) -> ExtensionRecord | None:
    """The record that a node holds; None if it holds none of the name for which the node stands."""
    try:
        record = _decode(node.get("record", ""))
    except (WireError, TypeError):
        return None
    return record if record.node_name == node.name else None


def _carries(geometric: bool) -> str:
    return "carries a pose" if geometric else "carries no pose"


def _records(schema: Schema, names: Iterable[Registered]) -> Iterator[ExtensionRecord]:
    """Those of `names` that are not built in."""
    for what, name in names:
        if what == "node" and name not in _BUILT_IN.node_types:
            yield ExtensionRecord("node", name, schema.node_types[name])
        elif what == "edge" and name not in _BUILT_IN.edge_types:
            yield ExtensionRecord("edge", name, schema.edge_types[name], geometric=name in schema.geometric)
        elif what == "attribute" and name not in _BUILT_IN.attributes:
            yield ExtensionRecord("attribute", name, attribute=schema.attributes[name])
