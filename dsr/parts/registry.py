"""The list of the parts of a graph, as nodes of its base, which every process holds.

A record is a node of type `part_record` with one attribute, JSON, so that it changes as a whole. A part is never taken
off the list: the dots of its elements name it for ever.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from dsr.clock import is_time
from dsr.errors import ConfigError, PartNotFoundError, WireError, suggest
from dsr.graph.elements import Node
from dsr.graph.graph import Graph
from dsr.graph.schema import PART_RECORD, RECORDS
from dsr.graph.watch import ChangeFilter, Watch
from dsr.network.decoding import decoded
from dsr.network.keys import check_part

_PREFIX = RECORDS[PART_RECORD]


class PartInfo(msgspec.Struct, frozen=True):
    """A part in the list of parts."""

    name: str
    types: tuple[str, ...] = ()
    """Node types of which new nodes are made in this part, unless another one is named."""
    creator: str = ""
    """Name of the agent that listed the part."""
    created: float = 0.0
    """s since the Unix epoch, by the creator's clock."""


class _Stored(msgspec.Struct, frozen=True, omit_defaults=True):
    """The value of the attribute `record`."""

    types: tuple[str, ...] = ()
    creator: str = ""
    created: float = 0.0


_encoder = msgspec.json.Encoder()
_decoder = msgspec.json.Decoder(_Stored)


def node_name(part: str) -> str:
    """Name of the node that holds the record of `part`."""
    return f"{_PREFIX}{part}"


def to_attribute(info: PartInfo) -> str:
    """The value of the attribute `record`."""
    return _encoder.encode(_Stored(info.types, info.creator, info.created)).decode()


class _Entry(msgspec.Struct, frozen=True):
    """What a node of the base graph says about a part."""

    record: object
    """As it stands there."""
    info: PartInfo | None
    """None if it makes no sense."""
    types: frozenset[str]
    """What the part claims."""


class PartList:
    """The parts that a base graph lists, as it is now. An entry is read when it has changed, whatever else changes."""

    def __init__(self) -> None:
        self._graph: Graph | None = None
        self._entries: dict[str, _Entry] = {}
        """By name of the node."""
        self._known: dict[str, PartInfo] = {}
        self._claims: dict[str, list[str]] = {}
        """Names of the parts that claim a type, for each that was asked for since the list changed."""
        self._changes = self._read = 0
        """How often the list has changed, and at which of these changes it was read last."""

    def follow(self, graph: Graph) -> None:
        """Read the list in this graph, from now on."""
        self._graph = graph
        self._watch = Watch(ChangeFilter(node_types=frozenset({PART_RECORD})), notify=self._outdate)
        graph.watches.follow(self._watch, ())

    def _outdate(self) -> None:
        self._watch.poll()
        self._changes += 1

    @property
    def parts(self) -> dict[str, PartInfo]:
        """The readable entries by name, in order."""
        if (changes := self._changes) != self._read and self._graph is not None:
            nodes = list(self._graph.nodes_by_type.get(PART_RECORD, {}).values())
            self._entries = {node.name: _entry(node, self._entries.get(node.name)) for node in nodes}
            found = [entry.info for entry in self._entries.values() if entry.info is not None]
            self._known = {info.name: info for info in sorted(found, key=lambda info: info.name)}
            self._claims = {}
            self._read = changes  # last: another thread must not take what was before for the list, nor Ctrl-C leave it
        return self._known

    def info(self, part: str) -> PartInfo:
        """The entry of a part. Raises `PartNotFoundError`."""
        found = self.parts.get(part)
        if found is None:
            raise PartNotFoundError(f"no part {part!r}; {suggest(part, self.parts)}")
        return found

    def claiming(self, type: str) -> Sequence[str]:
        """Names of the parts that claim new nodes of a type, in order."""
        if not self.parts:
            return ()
        claims, entries = self._claims, self._entries  # made in the other order: claims never outlive their entries
        names = claims.get(type)
        if names is None:
            names = [entry.info.name for entry in entries.values() if entry.info is not None and type in entry.types]
            names = claims[type] = sorted(names)
        return names


def _entry(node: Node, before: _Entry | None) -> _Entry:
    """What a node says; that is what it said before unless it has changed."""
    record = node.get("record", "")
    if before is not None and before.record == record:
        return before
    info = read_record(node)
    return _Entry(record, info, frozenset(info.types if info is not None else ()) - RECORDS.keys())


def read_record(node: Node) -> PartInfo | None:
    """The entry that a node of the base graph holds; None if it makes no sense."""
    name = node.name.removeprefix(_PREFIX)
    try:
        stored = decoded(node.get("record", ""), "record of a part", _decoder.decode)
        check_part(name)
    except (WireError, ConfigError, TypeError):
        return None
    if node.type != PART_RECORD or not is_time(stored.created) or name == node.name:
        return None
    return PartInfo(name, stored.types, stored.creator, stored.created)
