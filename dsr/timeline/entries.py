"""Entries of the timeline: events and situations as values, read off their nodes."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import msgspec

from dsr.clock import is_time
from dsr.graph.elements import Node
from dsr.memory import Memory
from dsr.network.keys import agent_of
from dsr.timeline.allen import Interval

TIMELINE = "timeline"
"""The node from which events and situations hang; it hangs from `mind`, if that is there."""
EVENT, SITUATION = "event", "situation"
"""Node types of an instant, and of what has a begin and, once it is over, an end."""
EXPLAINED = "explained"
"""Kind of the events that explain a surprise."""
_FIELDS = ("kind", "participants", "time", "begin", "end", "text", "outcome", "confidence", "source")


class Entry(msgspec.Struct, frozen=True, kw_only=True):
    """An event or a situation."""

    name: str
    """Name of the entry's node."""
    type: str
    """`EVENT` or `SITUATION`."""
    kind: str
    """Kind of the entry: `Pick`, `on`, `surprising`."""
    participants: tuple[str, ...]
    """Names of nodes or agents; the first is what it is about, of a relation the source comes first."""
    begin: float
    """s; of an event, when it happened"""
    end: float | None
    """s; None while a situation lasts; of an event the same as `begin`"""
    text: str = ""
    outcome: str = ""
    """How a situation ended; empty for an event."""
    confidence: float = 1.0
    """Probability (0 to 1) that the entry is true."""
    source: str = ""
    """The source of the entry: an agent, or the evidence that it used (`contact`, `gripper`)."""
    writers: tuple[str, ...] = ()
    """Names of the agents that wrote the entry."""
    details: dict[str, Any] = {}
    """All other attributes of the entry's node."""

    @property
    def interval(self) -> Interval:
        """The time of the entry, from its begin to its end (s)."""
        return Interval(self.begin, self.end)

    @property
    def is_open(self) -> bool:
        """Whether the situation lasts."""
        return self.end is None

    @property
    def last(self) -> float:
        """Time (s) when the entry was over; infinity while it lasts."""
        return math.inf if self.end is None else self.end


def read_entry(node: Node) -> Entry | None:
    """The entry that an event or situation node holds; None if it has no time, or is of another type."""
    begin = _time(node, "time" if node.type == EVENT else "begin")
    if begin is None or node.type not in (EVENT, SITUATION):
        return None
    values = node.attributes
    if node.type == EVENT:
        end: float | None = begin
    else:
        told = _time(node, "end")
        end = None if told is None else max(begin, told)
    confidence = values.get("confidence", 1.0)
    return Entry(
        name=node.name,
        type=node.type,
        kind=kind_of(node),
        participants=split_names(str(values.get("participants", ""))),
        begin=begin,
        end=end,
        text=str(values.get("text", "")),
        outcome=str(values.get("outcome", "")),
        confidence=confidence if isinstance(confidence, float) else 1.0,
        source=str(values.get("source", "")),
        writers=tuple(dict.fromkeys(agent_of(rid) for rid, _ in node.created)),
        details={name: value for name, value in values.items() if name not in _FIELDS},
    )


def kind_of(node: Node) -> str:
    """The kind of an event or situation node; events without a kind that have an `explanation` are explanations."""
    return str(node.get("kind", EXPLAINED if node.get("explanation", "") else ""))


def explanations(memory: Memory) -> list[Node]:
    """List the event nodes of explanations, oldest first."""
    found = [node for node in memory.nodes(EVENT) if kind_of(node) == EXPLAINED]
    return sorted(found, key=lambda node: (_time(node, "time") or 0.0, node.name))


def split_names(text: str) -> tuple[str, ...]:
    """The names of a comma-separated list."""
    return tuple(name for part in text.split(",") if (name := part.strip()))


def joined_names(names: str | Iterable[str]) -> str:
    """Names as the attribute `participants` holds them."""
    return ",".join(split_names(names) if isinstance(names, str) else names)


def _time(node: Node, attribute: str) -> float | None:
    value = node.get(attribute)
    return value if is_time(value) else None
