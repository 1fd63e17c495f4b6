"""Reads the present facts from the graph: the situations that should be open on the timeline."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from dsr.graph.elements import Edge, Node
from dsr.graph.schema import is_name
from dsr.graph.shares import makers, shared_by
from dsr.memory import Memory
from dsr.timeline import ACTION, FORBIDDEN, INTENTION, OBJECTS, PRESENT, SURPRISING, Entry
from dsr.vocabulary.halting import HALT_NODE, order_of
from dsr.vocabulary.intentions import ACTIVE, RUNNING
from dsr.vocabulary.relations import is_present


class ChronicledFact(NamedTuple):
    """A fact that holds now."""

    kind: str
    participants: tuple[str, ...]
    begin: float
    """Since when (s), as far as the graph tells."""
    key: str
    """Tells it from others of its kind and participants, the same in all replicas."""
    is_dated: bool
    """Whether its writer says since when: then with another time it is another one."""
    text: str
    source: str = ""


_Read = Callable[[Any, float], ChronicledFact | None]
"""What an element tells at a time (s)."""


def read_facts(
    memory: Memory, relations: Iterable[str], surprising: Iterable[str], now: float, most: int
) -> list[ChronicledFact]:
    """Read the facts that hold at time `now` (s); of more than `most`, as many by each agent as by others.

    Args:
        memory: the graph.
        relations: edge types to tell of.
        surprising: names of nodes that may be surprising.
        now: s.
        most: count of facts.
    """
    nodes = [node for name in sorted(surprising) if (node := memory.get_node(name)) is not None]
    about: list[tuple[_Read, Node | Edge]] = [
        *((_halt, node) for node in memory.nodes(HALT_NODE)),
        *((_doing, node) for kind in (INTENTION, ACTION) for node in memory.nodes(kind)),
        *((_surprise, node) for node in nodes if node.get("surprising") is True),
        *((_relation, edge) for kind in relations for edge in memory.edges(kind)),
        *((_presence, node) for node in memory.nodes(OBJECTS) if is_present(node)),
    ]
    chosen = shared_by(about, most, lambda pair: makers(pair[1]))
    return [fact for read, element in chosen if (fact := read(element, now)) is not None]


def ending(memory: Memory, entry: Entry, now: float) -> tuple[float, str]:
    """When (s) and how a situation ended that holds no more, as far as the graph tells: else now."""
    name = entry.participants[0] if entry.participants else ""
    node = memory.get_node(name)
    if entry.kind == PRESENT:
        return _written(node, "present", now), f"{name} gone"
    if entry.kind == SURPRISING:
        return _written(node, "surprising", now), f"{name} is no longer surprising"
    if entry.kind == FORBIDDEN:
        order = order_of(node)
        by = "" if order is None or order.halted else f" by {order.by}"
        return _written(node, "halted", now), f"released{by}"
    if entry.kind in (ACTION, INTENTION):
        return _written(node, "status", now), "removed" if node is None else describe_status(node)
    return now, ""


def describe_status(node: Node) -> str:
    """The status of an intention or an action, with why."""
    status, why = str(node.get("status", "")) or "new", str(node.get("explanation", ""))
    return f"{status}: {why}" if why else status


def _relation(edge: Edge, now: float) -> ChronicledFact:
    what, source = f"{edge.src} {edge.type} {edge.dst}", str(edge.get("source", ""))
    text = f"{what} ({source})" if source else what
    since = edge.get("since")
    if isinstance(since, float) and 0.0 < since <= now:
        return ChronicledFact(edge.type, (edge.src, edge.dst), since, repr(since), True, text, source)
    begin = min((edge.written_at(name) or now for name in edge), default=now)
    return ChronicledFact(edge.type, (edge.src, edge.dst), min(begin, now), repr(edge.created[0]), False, text, source)


def _presence(node: Node, now: float) -> ChronicledFact:
    """Without `present`, since the oldest of its values: those that never change came with the node."""
    came = node.written_at("present")
    begin = min((node.written_at(name) or now for name in node), default=now) if came is None else came
    key = f"{node.created[0]} {came!r}"
    return ChronicledFact(PRESENT, (node.name,), min(begin, now), key, False, f"{node.name} appeared")


def _surprise(node: Node, now: float) -> ChronicledFact:
    begin, why = _written(node, "surprising", now), str(node.get("surprise", ""))
    text = f"{node.name} is surprising{f': {why}' if why else ''}"
    return ChronicledFact(SURPRISING, (node.name,), begin, repr(begin), False, text)


def _halt(node: Node, now: float) -> ChronicledFact | None:
    """An emergency stop, while it forbids motion."""
    order = order_of(node)
    if order is None or not order.halted:
        return None
    begin = min(order.stamp or now, now)
    return ChronicledFact(FORBIDDEN, (node.name,), begin, order.id, True, order.reason, order.by)


def _doing(node: Node, now: float) -> ChronicledFact | None:
    """An intention that is pursued, or an action that runs."""
    if node.get("status") not in (ACTIVE if node.type == INTENTION else (RUNNING,)):
        return None
    begin = _written(node, "status", now)
    return ChronicledFact(node.type, participants_of(node), begin, repr(begin), False, task_of(node))


def participants_of(node: Node) -> tuple[str, ...]:
    """An intention or an action, and what an action is about; a text that names nothing is left out."""
    about = (node.get(name) for name in ("target", "destination"))
    return (node.name, *(name for name in about if is_name(name)))


def task_of(node: Node) -> str:
    """The task of an intention or an action, in words."""
    return " ".join(str(node[field]) for field in ("goal", "skill", "target", "destination") if node.get(field))


def _written(node: Node | None, attribute: str, now: float) -> float:
    """When an attribute got its value, s; now if that cannot be told."""
    time = None if node is None else node.written_at(attribute)
    return now if time is None else min(time, now)
