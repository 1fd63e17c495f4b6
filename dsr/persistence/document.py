"""The graph as JSON that a person can read and edit, and back; every problem is told with its place.

    {"format": "dsr-graph", "version": 1, "graph": "tabletop",
     "schema": {"node_types": {"drawer": "can be opened"}, "attributes": {"depth": {"kind": "float", "unit": "m"}}},
     "nodes": [{"name": "table", "type": "table", "attributes": {"size": [1.2, 0.8, 0.04]}}],
     "edges": [{"src": "world", "dst": "table", "type": "RT", "attributes": {"pose": {"translation": [0.5, 0, 0]}}}]}

`schema` describes names beyond the built-in ones. Bytes stand as {"base64": "..."}, a pose as its parts, of which only
the translation is required. What is written is sorted, so that equal graphs are equal files.
"""

from __future__ import annotations

import base64
import binascii
from collections.abc import Callable
from typing import Any, TypeVar

import msgspec
import numpy as np

from dsr.config.toml import MisfitError, convert
from dsr.errors import SchemaError, suggest
from dsr.graph.schema import AttributeType, Schema, Value
from dsr.math3d.transforms import Pose
from dsr.persistence.content import GraphContent, NodeContent
from dsr.persistence.json_text import JsonFile, Problems, ValuePath, dotted, to_text

T = TypeVar("T")

FORMAT = "dsr-graph"
VERSION = 1


class _EdgeType(msgspec.Struct, frozen=True, omit_defaults=True):
    meaning: str = ""
    geometric: bool = False


class _Names(msgspec.Struct, frozen=True, omit_defaults=True):
    node_types: dict[str, Any] = {}
    """meanings"""
    edge_types: dict[str, Any] = {}
    """`_EdgeType`"""
    attributes: dict[str, Any] = {}
    """`AttributeType`"""


class _Document(msgspec.Struct, frozen=True):
    format: str
    version: int
    nodes: list[Any]
    edges: list[Any] = []
    graph: str = ""
    schema: _Names = _Names()


class _Node(msgspec.Struct, frozen=True):
    name: str
    type: str
    attributes: dict[str, Any] = {}


class _Edge(msgspec.Struct, frozen=True):
    src: str
    dst: str
    type: str
    attributes: dict[str, Any] = {}


class _Pose(msgspec.Struct, frozen=True):
    translation: list[float]
    rotation: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)
    stamp: float = 0.0
    covariance: list[list[float]] | None = None


class _Bytes(msgspec.Struct, frozen=True):
    base64: str


# ---- writing


def to_document(content: GraphContent) -> str:
    """The text of a file that holds `content`."""
    nodes = [
        _element({"name": name, "type": node.type}, node.attributes) for name, node in sorted(content.nodes.items())
    ]
    edges = [
        _element(dict(zip(("src", "dst", "type"), key, strict=True)), attributes)
        for key, attributes in sorted(content.edges.items())
    ]
    names = _custom_names(content)
    head = {"format": FORMAT, "version": VERSION, "graph": content.graph, **({"schema": names} if names else {})}
    return to_text({**head, "nodes": nodes, "edges": edges})


def _element(identity: dict[str, str], attributes: dict[str, Value]) -> dict[str, Any]:
    plain = {name: _plain(value) for name, value in sorted(attributes.items())}
    return {**identity, "attributes": plain} if plain else {**identity}


def _plain(value: Value) -> Any:
    if isinstance(value, Pose):
        covariance = None if value.covariance is None else np.asarray(value.covariance).tolist()
        parts: dict[str, Any] = {"translation": list(value.t), "rotation": list(value.q)}
        parts |= {"stamp": value.stamp} if value.stamp else {}
        return parts | ({"covariance": covariance} if covariance else {})
    if isinstance(value, bytes):
        return {"base64": base64.b64encode(value).decode()}
    return list(value) if isinstance(value, tuple) else value


def _custom_names(content: GraphContent) -> dict[str, Any]:
    """The names in use that the built-in schema lacks."""
    schema, builtin = content.schema, Schema()
    node_types = {node.type for node in content.nodes.values()} - builtin.node_types.keys()
    edge_types = {type for _, _, type in content.edges} - builtin.edge_types.keys()
    attributes = {name for _, values in content.elements() for name in values} - builtin.attributes.keys()
    names = _Names(
        {name: schema.node_types[name] for name in sorted(node_types)},
        {name: _EdgeType(schema.edge_types[name], name in schema.geometric) for name in sorted(edge_types)},
        {name: schema.attributes[name] for name in sorted(attributes)},
    )
    plain: dict[str, Any] = msgspec.to_builtins(names)
    for name, attribute in plain.get("attributes", {}).items():
        plain["attributes"][name] = {key: value for key, value in attribute.items() if value or key == "kind"}
    return plain


# ---- reading


def from_document(file: JsonFile) -> GraphContent:
    """The content of a file. Raises `ConfigError` that names up to 20 problems with their places."""
    return _Reader(file).read()


class _Reader:
    """Goes through a file and collects what is wrong with it."""

    def __init__(self, file: JsonFile) -> None:
        self._file = file
        self._problems = Problems(file)
        self._misread: set[str] = set()
        """Names of nodes that are there but wrong."""

    def read(self) -> GraphContent:
        for name, wanted in (("format", FORMAT), ("version", VERSION)):
            found = self._file.data.get(name)
            if found != wanted:
                raise self._file.error([((name,), f"{name} {found!r}: this program reads {wanted!r}")])
        document = self._try((), convert, self._file.data, _Document)
        if document is not None:
            self._content = GraphContent(document.graph)
            self._register(document.schema)
        self._problems.tell()
        assert document is not None
        for index, node in enumerate(document.nodes):
            self._node(node, ("nodes", index))
        for index, edge in enumerate(document.edges):
            self._edge(edge, ("edges", index))
        self._problems.tell()
        return self._content

    def _register(self, names: _Names) -> None:
        for name, data in names.node_types.items():
            self._try(("schema", "node_types", name), self._register_node_type, name, data)
        for name, data in names.edge_types.items():
            self._try(("schema", "edge_types", name), self._register_edge_type, name, data)
        for name, data in names.attributes.items():
            self._try(("schema", "attributes", name), self._register_attribute, name, data)

    def _register_node_type(self, name: str, data: Any) -> None:
        self._content.schema.register_node_type(name, convert(data, str))

    def _register_edge_type(self, name: str, data: Any) -> None:
        edge = convert(data, _EdgeType)
        self._content.schema.register_edge_type(name, edge.meaning, geometric=edge.geometric)

    def _register_attribute(self, name: str, data: Any) -> None:
        self._content.schema.register_attribute(name, convert(data, AttributeType))

    def _try(self, path: ValuePath, action: Callable[..., T], *arguments: Any, **options: Any) -> T | None:
        """The result of a call; None after noting why it was refused."""
        try:
            return action(*arguments, **options)
        except MisfitError as error:
            message = str(error).removeprefix(f"{dotted(error.path)}: ")
            self._problems.add((*path, *error.path), message)
        except (SchemaError, ValueError) as error:
            self._problems.add(path, str(error))
        return None

    def _node(self, data: Any, path: ValuePath) -> None:
        node = self._try(path, convert, data, _Node)
        if node is None:
            if isinstance(data, dict) and isinstance(data.get("name"), str):
                self._misread.add(data["name"])
            return
        self._try(path, self._content.schema.check_node, node.name, node.type)
        if node.name in self._content.nodes:
            self._problems.add((*path, "name"), f"a second node is called {node.name!r}")
        attributes = self._attributes(node.attributes, (*path, "attributes"))
        self._content.nodes[node.name] = NodeContent(node.type, attributes)

    def _edge(self, data: Any, path: ValuePath) -> None:
        edge = self._try(path, convert, data, _Edge)
        if edge is None:
            return
        nodes = self._content.nodes
        for end in ("src", "dst"):
            name = getattr(edge, end)
            if name not in nodes and name not in self._misread:
                self._problems.add((*path, end), f"no node {name!r} in this file; {suggest(name, nodes)}")
        self._try((*path, "type"), self._content.schema.check_edge_type, edge.type)
        key = (edge.src, edge.dst, edge.type)
        if key in self._content.edges:
            self._problems.add(path, f"a second {edge.type} edge from {edge.src!r} to {edge.dst!r}")
        self._content.edges[key] = self._attributes(edge.attributes, (*path, "attributes"))

    def _attributes(self, data: dict[str, Any], path: ValuePath) -> dict[str, Value]:
        schema = self._content.schema
        values = {name: self._try((*path, name), _to_value, schema, name, value) for name, value in data.items()}
        return {name: value for name, value in values.items() if value is not None}


def _to_value(schema: Schema, name: str, plain: Any) -> Value:
    """What `_plain` made plain. Raises `SchemaError`, `MisfitError`, `ValueError`."""
    kind = schema.attribute(name).kind
    if kind == "pose":
        parts = convert(plain, _Pose)
        plain = Pose(parts.translation, parts.rotation, parts.stamp, parts.covariance)
    elif kind == "bytes":
        plain = _decoded(convert(plain, _Bytes).base64)
    return schema.to_value(name, plain)


def _decoded(text: str) -> bytes:
    try:
        return base64.b64decode(text, validate=True)
    except binascii.Error as error:
        raise ValueError(f"not valid base64: {error}") from error
