"""Reads the JSON graph files of CORTEX: nothing is lost; values that our graph cannot hold stay in a note.

    {"DSRModel": {"symbols": {"1": {"id": "1", "name": "world", "type": "world", "attribute": {NAME: {"type": CODE,
     "value": V}}, "links": [{"src": "1", "dst": "2", "label": "RT", "linkAttribute": {...}}]}}}}

- Names beyond our schema become custom ones, with a warning each. Names that ours may not have are changed; the note
  keeps the original.
- Values that our kinds cannot hold, or of another kind than our schema says, stand as JSON text under `cortex.NAME`.
- `rt_translation` (mm) and `rt_rotation_euler_xyz` (rad) of geometric links become the `pose`.
- `level` and `parent` of nodes are dropped: writing derives them anew.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import msgspec

from dsr.config.toml import MisfitError, convert
from dsr.errors import SchemaError, suggest
from dsr.graph.schema import MAX_LENGTH, POSE_FIELDS, AttributeType, Kind, Schema, Value
from dsr.persistence.content import GraphContent, NodeContent
from dsr.persistence.cortex_poses import POSE_CODES, ROTATION, TRANSLATION, pose_of
from dsr.persistence.cortex_values import (
    NOTE,
    PREFIX,
    Note,
    Origin,
    default_code,
    to_ours,
)
from dsr.persistence.json_text import JsonFile, Problems, ValuePath, dotted

DERIVED = ("level", "parent")
"""Attributes of nodes that follow from the RT links."""
_RESERVED = {NOTE, "pose", *POSE_FIELDS}
_REFUSED = re.compile(r"[^A-Za-z0-9_.\-]")
_LONGEST = 110


class _Attribute(msgspec.Struct, frozen=True):
    type: int
    value: Any


class _Link(msgspec.Struct, frozen=True, rename={"attributes": "linkAttribute"}):
    src: str | int
    dst: str | int
    label: str
    attributes: dict[str, Any] = {}


class _Symbol(msgspec.Struct, frozen=True, rename={"attributes": "attribute"}):
    id: str | int
    name: str
    type: str
    attributes: dict[str, Any] = {}
    links: list[Any] = []


class _Found(NamedTuple):
    """A checked piece of the file, with where it stands and the members that we do not know."""

    value: Any
    path: ValuePath
    extra: dict[str, Any]


def from_cortex(file: JsonFile) -> GraphContent:
    """The content of a file. Raises `ConfigError` that names up to 20 problems with their places."""
    return _Importer(file).content()


class _Importer:
    """Checks the structure first, then chooses names, then takes everything over."""

    def __init__(self, file: JsonFile) -> None:
        self._file = file
        self._problems = Problems(file)
        self._result = GraphContent("")
        self._warned: set[tuple[str, str]] = set()

    def content(self) -> GraphContent:
        symbols = self._symbols()
        links = [self._links(symbol) for symbol in symbols]
        self._check_identities(symbols)
        self._check_links(symbols, links)
        self._problems.tell()
        flat = [link for of_symbol in links for link in of_symbol]
        self._choose_names(symbols, flat)
        for symbol in symbols:
            self._add_node(symbol)
        for link in flat:
            self._add_edge(link)
        self._problems.tell()
        return self._result

    # ---- structure

    def _symbols(self) -> list[_Found]:
        model = self._file.data["DSRModel"]
        symbols = model.get("symbols") if isinstance(model, dict) else None
        if not isinstance(symbols, dict):
            raise self._file.error([(("DSRModel",), 'expected an object with "symbols": an object of nodes by id')])
        for name in model.keys() - {"symbols"}:
            self._warn("member", name, f"{name!r} beside the symbols is left out")
        found = [self._checked(data, _Symbol, ("DSRModel", "symbols", key)) for key, data in symbols.items()]
        return [symbol for symbol in found if symbol is not None]

    def _links(self, symbol: _Found) -> list[_Found]:
        path = (*symbol.path, "links")
        found = [self._checked(data, _Link, (*path, index)) for index, data in enumerate(symbol.value.links)]
        return [link for link in found if link is not None]

    def _checked(self, data: Any, kind: type[msgspec.Struct], path: ValuePath) -> _Found | None:
        """`data` as a `kind`, with the members that this does not have put aside."""
        fields = kind.__struct_encode_fields__
        if not isinstance(data, dict):
            self._problems.add(path, f"expected an object with {', '.join(fields)}")
            return None
        try:
            value = convert({name: data[name] for name in fields if name in data}, kind)
        except MisfitError as error:
            self._problems.add((*path, *error.path), str(error).removeprefix(f"{dotted(error.path)}: "))
            return None
        return _Found(value, path, {name: item for name, item in data.items() if name not in fields})

    def _check_identities(self, symbols: list[_Found]) -> None:
        names: set[str] = set()
        for symbol in symbols:
            if str(symbol.value.id) != symbol.path[-1]:
                self._problems.add((*symbol.path, "id"), f"id {symbol.value.id!r} under {symbol.path[-1]!r}")
            if symbol.value.name in names:
                self._problems.add((*symbol.path, "name"), f"a second node is called {symbol.value.name!r}")
            names.add(symbol.value.name)

    def _check_links(self, symbols: list[_Found], links: list[list[_Found]]) -> None:
        ids = {str(symbol.path[-1]) for symbol in symbols}
        for symbol, of_symbol in zip(symbols, links, strict=True):
            seen: set[tuple[str, str]] = set()
            for link in of_symbol:
                dst, label = str(link.value.dst), link.value.label
                if str(link.value.src) != str(symbol.value.id):
                    message = f"src {link.value.src!r} of a link that stands with node {symbol.value.id!r}"
                    self._problems.add((*link.path, "src"), message)
                if dst not in ids:
                    self._problems.add((*link.path, "dst"), f"no node {dst!r} in this file; {suggest(dst, ids)}")
                if (dst, label) in seen:
                    self._problems.add(link.path, f"a second {label!r} link to {dst!r}")
                seen.add((dst, label))

    # ---- names

    def _choose_names(self, symbols: list[_Found], links: list[_Found]) -> None:
        """Our names for theirs; types that our schema lacks are registered."""
        schema = self._result.schema
        self._names = _mapping(symbol.value.name for symbol in symbols)
        self._by_id = {str(symbol.value.id): self._names[symbol.value.name] for symbol in symbols}
        self._node_types = _mapping(symbol.value.type for symbol in symbols)
        self._edge_types = _mapping(link.value.label for link in links)
        self._attributes = _mapping(name for found in (*symbols, *links) for name in found.value.attributes)
        self._register("node type", self._node_types, schema.node_types, schema.register_node_type)
        self._register("edge type", self._edge_types, schema.edge_types, schema.register_edge_type)
        schema.register_attribute(NOTE, AttributeType("str", meaning="what a CORTEX file said beyond this graph"))

    def _register(
        self, what: str, names: dict[str, str], known: dict[str, str], register: Callable[[str, str], None]
    ) -> None:
        for theirs, ours in sorted(names.items()):
            if ours not in known:
                register(ours, "of a CORTEX file")
                message = f"{what} {theirs!r} is not in the schema: kept as a custom one"
                self._warn(what, theirs, message + _as(theirs, ours))

    def _warn(self, what: str, name: str, message: str) -> None:
        if (what, name) not in self._warned:
            self._warned.add((what, name))
            self._result.warnings.append(message)

    # ---- content

    def _add_node(self, symbol: _Found) -> None:
        node = symbol.value
        name, type = self._names[node.name], self._node_types[node.type]
        kept = {key: value for key, value in node.attributes.items() if key not in DERIVED}
        attributes, origins = self._convert(kept, (*symbol.path, "attribute"))
        if name != node.name:
            self._warn("node", node.name, f"node {node.name!r} is called {name!r}: ours have other names")
        note = Note(str(node.id), _if_other(node.name, name), _if_other(node.type, type), origins, symbol.extra)
        self._result.nodes[name] = NodeContent(type, {**attributes, NOTE: note.encoded()})

    def _add_edge(self, found: _Found) -> None:
        link = found.value
        type = self._edge_types[link.label]
        geometric = type in self._result.schema.geometric
        pose, taken = pose_of(link.attributes) if geometric else (None, {})
        if geometric and pose is None:
            self._warn("edge", type, f"some {link.label} links have no {TRANSLATION} and {ROTATION} of 3: no pose")
        rest = {name: data for name, data in link.attributes.items() if name not in taken}
        attributes, origins = self._convert(rest, (*found.path, "linkAttribute"))
        origins |= {name: Origin(code) for name, code in taken.items() if code != POSE_CODES[name]}
        note = Note(type=_if_other(link.label, type), attributes=origins, extra=found.extra)
        if note != Note():
            attributes[NOTE] = note.encoded()
        if pose is not None:
            attributes["pose"] = pose
        self._result.edges[self._by_id[str(link.src)], self._by_id[str(link.dst)], type] = attributes

    def _convert(self, attributes: dict[str, Any], path: ValuePath) -> tuple[dict[str, Value], dict[str, Origin]]:
        """Our attributes for theirs, and how each stood in the file if that is worth a note."""
        values: dict[str, Value] = {}
        origins: dict[str, Origin] = {}
        for theirs, data in attributes.items():
            found = self._checked(data, _Attribute, (*path, theirs))
            if found is None:
                continue
            try:
                kind, value = to_ours(found.value.type, found.value.value)
            except ValueError as error:
                self._problems.add((*path, theirs, "value"), f"{error} (type {found.value.type})")
                continue
            name = self._fitting_name(theirs, kind, value, found.value.type)
            text = name.startswith(PREFIX)
            kept = json.dumps(found.value.value) if text else value
            if isinstance(kept, str) and len(kept) > MAX_LENGTH:
                self._problems.add((*path, theirs), f"larger than a value may be ({MAX_LENGTH} characters)")
                continue
            values[name] = self._result.schema.to_value(name, kept)
            origin = Origin(found.value.type, _if_other(theirs, name), text, found.extra)
            if origin != Origin(default_code(values[name])):
                origins[name] = origin
        return values, origins

    def _fitting_name(self, theirs: str, kind: Kind, value: Value | None, code: int) -> str:
        """Our name for an attribute of this value: the one under which JSON text is kept if it does not fit."""
        schema = self._result.schema
        name = self._attributes[theirs]
        reserved = name in _RESERVED or name.startswith(PREFIX)
        if value is not None and not reserved:
            if name not in schema.attributes:
                schema.register_attribute(name, AttributeType(kind, meaning="of a CORTEX file"))
                what = f"attribute {theirs!r} is not in the schema"
                self._warn("attribute", theirs, f"{what}: kept as a custom {kind}{_as(theirs, name)}")
            if _fits(schema, name, value):
                return name
        kept = PREFIX + name
        if kept not in schema.attributes:
            schema.register_attribute(kept, AttributeType("str", meaning="JSON text of a CORTEX attribute"))
        self._warn("text", theirs, f"attribute {theirs!r}: some values of type {code} are kept as text in {kept!r}")
        return kept


def _fits(schema: Schema, name: str, value: Value) -> bool:
    """Whether an attribute takes a value without changing it."""
    try:
        return schema.to_value(name, value) == value
    except SchemaError:
        return False


def _mapping(theirs: Iterable[str]) -> dict[str, str]:
    """A different name of ours for each of theirs: the same one where our rules allow it."""
    names = sorted(set(theirs))
    used = {name for name in names if _ours(name) == name}
    mapping = {name: name for name in used}
    for name in names:
        if name not in mapping:
            stem = _ours(name)
            candidates = (stem, *(f"{stem}_{number}" for number in range(2, len(names) + 2)))
            mapping[name] = next(candidate for candidate in candidates if candidate not in used)
            used.add(mapping[name])
    return mapping


def _ours(name: str) -> str:
    return _REFUSED.sub("_", name)[:_LONGEST] or "_"


def _if_other(theirs: str, ours: str) -> str | None:
    return None if theirs == ours else theirs


def _as(theirs: str, ours: str) -> str:
    return "" if theirs == ours else f", called {ours!r}"
