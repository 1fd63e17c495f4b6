"""The list of the parts of a graph, as nodes of its base, which every process holds.

A record is a node of type `part_record` with one attribute, JSON, so that it changes as a whole. A part is never taken
off the list: the dots of its elements name it for ever.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

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


class PartList:
    """The parts that a base graph lists, as it is now."""

    def __init__(self) -> None:
        self._graph: Graph | None = None
        self._known: dict[str, PartInfo] = {}
        self._by_type: dict[str, list[str]] = {}
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
            found = [info for node in nodes if (info := read_record(node)) is not None]
            self._known = {info.name: info for info in sorted(found, key=lambda info: info.name)}
            self._by_type = _claims(self._known.values())
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
        return self._by_type.get(type, ()) if self.parts else ()


def _claims(parts: Iterable[PartInfo]) -> dict[str, list[str]]:
    """The names of the parts that claim each type; the list of parts itself is in none."""
    claims: dict[str, list[str]] = {}
    for info in parts:
        for type in info.types:
            if type not in RECORDS:
                claims.setdefault(type, []).append(info.name)
    return claims


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
