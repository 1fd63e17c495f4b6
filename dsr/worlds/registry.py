"""The list of the worlds of a system, as nodes of the base graph, whose replication reaches every late joiner.

A record is a node of type `world_record` with one attribute, JSON, so that it changes as a whole. Its `channel` is part
of the keys under which the world's replicas meet. A world that is deleted and made again has another channel, so
whoever still writes into the old one reaches nobody. Two processes that make a world of one name at once have made
one: the winning record tells the channel on which both go on.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Annotated

import msgspec

from dsr.clock import is_time
from dsr.crdt.context import Dot
from dsr.crdt.delta import MAX_ENDS
from dsr.errors import ConfigError, WireError
from dsr.graph.elements import Node
from dsr.graph.graph import Graph
from dsr.graph.schema import RECORDS, WORLD_RECORD
from dsr.graph.shares import shared_by
from dsr.network.decoding import decoded
from dsr.network.keys import BASE, agent_of, check_name

ROOT = "world"
"""Name and type of the root node that a new world has."""
VIA = "via"
"""Attribute of an element that a filter made: the worlds through which it came, comma-separated, first one first."""
MOST_OVERLAYS = 32
"""Overlays that may show one another in a row: each hands on what changes below, in calls within calls."""
_PREFIX = RECORDS[WORLD_RECORD]
_Text = Annotated[str, msgspec.Meta(max_length=1 << 10)]
"""A name in a record, which errors quote: no name that anything may have is longer."""


class WorldInfo(msgspec.Struct, frozen=True):
    """A world in the list of worlds."""

    name: str
    parent: str | None = None
    """Name of the world from which this one was forked; None if it was made anew."""
    follows: bool = False
    """Whether the world is an overlay: it shows its parent, live, where it holds nothing of its own."""
    creator: str = ""
    """Name of the agent that made the world; empty for the base."""
    created: float = 0.0
    """s since the Unix epoch, by the creator's clock; 0 for the base."""

    @property
    def looks_through_to(self) -> str | None:
        """The parent of an overlay; None for any other world."""
        return self.parent if self.follows else None


class Record(msgspec.Struct, frozen=True):
    """A world's entry in the list."""

    info: WorldInfo
    channel: str
    dots: frozenset[Dot]
    """Creation dots of the entry: it is another world when none of them is left."""
    below: frozenset[Dot] = frozenset()
    """Creation dots of the parent's entry when an overlay was made; none if the parent is the base, or not known."""


class _Stored(msgspec.Struct, frozen=True, omit_defaults=True):
    """The value of the attribute `record`."""

    channel: _Text
    parent: _Text | None = None
    follows: bool = False
    creator: _Text = ""
    created: float = 0.0
    below: Annotated[tuple[Dot, ...], msgspec.Meta(max_length=MAX_ENDS)] = ()


BASE_INFO = WorldInfo(BASE)
_encoder = msgspec.json.Encoder()
_decoder = msgspec.json.Decoder(_Stored)


def node_name(world: str) -> str:
    """Name of the node that holds the record of `world`."""
    return f"{_PREFIX}{world}"


def to_attribute(info: WorldInfo, channel: str, below: Iterable[Dot] = ()) -> str:
    """The value of the attribute `record`.

    Of `below`, which is `Record.below`, it names `MAX_ENDS` dots: the newest, and as many of each agent as of others.
    """
    named = shared_by(sorted(below, reverse=True), MAX_ENDS, lambda dot: (agent_of(dot[0]),))
    stored = _Stored(channel, info.parent, info.follows, info.creator, info.created, tuple(sorted(named)))
    return _encoder.encode(stored).decode()


def records(graph: Graph) -> Iterator[Record]:
    """All readable entries in the base graph, by name of the world."""
    nodes = list(graph.nodes_by_type.get(WORLD_RECORD, {}).values())
    for node in sorted(nodes, key=lambda node: node.name):
        found = read_record(node)
        if found is not None:
            yield found


def find_record(graph: Graph, world: str) -> Record | None:
    """The entry of `world` in the base graph; None if there is none."""
    node = graph.nodes.get(node_name(world))
    return None if node is None else read_record(node)


def read_record(node: Node) -> Record | None:
    """The entry that a node of the base graph holds; None if it makes no sense."""
    name = node.name.removeprefix(_PREFIX)
    try:
        stored = decoded(node.get("record", ""), "record of a world", _decoder.decode)
        check_name("world name", name)
        check_name("channel", stored.channel)
    except (WireError, ConfigError, TypeError):
        return None
    if node.type != WORLD_RECORD or not is_time(stored.created) or name in (BASE, node.name):
        return None
    info = WorldInfo(name, stored.parent, stored.follows, stored.creator, stored.created)
    return Record(info, stored.channel, frozenset(node.created), frozenset(stored.below))


def are_one(record: Record, other: Record) -> bool:
    """Whether two worlds of one name, made at the same time, become one: what they hold can be merged.

    Overlays of one world can, and worlds that began empty or as the base. Any other copy may be one of an overlay. That
    holds values of layers in place of newer ones, so it is no state of the history that another copy continues.
    """
    if record.info.looks_through_to != other.info.looks_through_to:
        return False
    same = record.channel == other.channel or record.info.follows
    return same or {record.info.parent, other.info.parent} <= {None, BASE}


def is_orphan(graph: Graph, record: Record) -> bool:
    """Whether the world that an overlay shows, or one that this shows, was deleted, or deleted and made anew.

    Overlays beyond `MOST_OVERLAYS` in a row are orphans, too: nobody opens them.
    """
    passed: set[str] = set()
    while (parent := record.info.looks_through_to) is not None and parent != BASE and parent not in passed:
        if len(passed) >= MOST_OVERLAYS:
            return True
        passed.add(parent)
        found = find_record(graph, parent)
        if found is None or not _shows(record, found):
            return True
        record = found
    return False


def followers_of(graph: Graph, record: Record) -> list[Record]:
    """The overlays of a world."""
    name = record.info.name
    return [other for other in records(graph) if other.info.looks_through_to == name and _shows(other, record)]


def _shows(overlay: Record, parent: Record) -> bool:
    return not overlay.below or bool(overlay.below & parent.dots)


def is_too_deep(graph: Graph, record: Record, *, and_one_more: bool = False) -> bool:
    """Whether more than `MOST_OVERLAYS` show one another down from this one, or from one over it; also in a circle."""
    for _ in range(MOST_OVERLAYS - and_one_more):
        parent = record.info.looks_through_to
        found = None if parent is None or parent == BASE else find_record(graph, parent)
        if found is None:
            return False
        record = found
    return True


def circle_of(graph: Graph, record: Record) -> list[str]:
    """Names of the overlays that follow one another in a circle, this one among or above them; empty if there is no
    circle of `MOST_OVERLAYS` or less.
    """
    names: list[str] = []
    at: Record | None = record
    while at is not None and at.info.name not in names and len(names) <= MOST_OVERLAYS:
        names.append(at.info.name)
        parent = at.info.looks_through_to
        at = None if parent is None else find_record(graph, parent)
    return names[names.index(at.info.name) :] if at is not None and at.info.name in names else []
