"""Derives events from the changes of a graph and the statuses of its agents, without I/O.

Values of a graph are states; an event is the moment at which one of them became another. `Timeline` remembers the
last state and tells the events in order, for live graphs and recordings alike. Of the timeline in the graph it tells
what does not follow from the rest: explanations, and kinds of their own of other agents.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from dsr.graph.elements import Edge, Node
from dsr.graph.watch import Change
from dsr.memory import Memory
from dsr.runtime.status import SILENT_AFTER, State, Status
from dsr.timeline.entries import EVENT, EXPLAINED, SITUATION, kind_of, read_entry
from dsr.timeline.kinds import DERIVED, OBJECTS, RELATIONS
from dsr.timeline.telling import Event, tell
from dsr.vocabulary.halting import HALT_NODE, order_of
from dsr.vocabulary.relations import is_present
from dsr.vocabulary.sentences import explained_sentence

EVENT_KINDS = (
    *("explained", "surprised", "calmed", "began", "ended", "appeared", "gone", "intention", "action", "agent"),
    *("halted", "released"),
)
"""Kinds of the events that are read off changes; agents add their own, such as `Pick`, on the timeline in the graph."""
_ENDED = (State.STOPPED, State.FAILED)


class Timeline:
    """Tells the events of one graph as its changes are handed in."""

    def __init__(self) -> None:
        self._surprising: set[str] = set()
        self._relations: dict[tuple[str, str, str], str] = {}
        self._present: dict[str, bool] = {}
        self._statuses: dict[str, str] = {}
        self._orders: dict[str, str] = {}
        self._explained: dict[str, tuple[Any, Any]] = {}
        self._told: dict[str, set[str]] = {}
        self._agents: dict[str, Status] = {}
        self._heard: dict[str, float] = {}
        self._silent: set[str] = set()

    def note(self, changes: Iterable[Change], memory: Memory, now: float) -> list[Event]:
        """Derive the events from `changes` of `memory`, seen at time `now` (s), in the order of their times."""
        return sorted(self._events(changes, memory, now), key=lambda event: event.time)

    def note_status(self, status: Status, now: float) -> list[Event]:
        """The events that a status heard at time `now` (s) amounts to: an agent started, is at work, ended, is back."""
        agent, before = status.agent, self._agents.get(status.agent)
        self._agents[agent], self._heard[agent] = status, now
        was_silent = agent in self._silent
        self._silent.discard(agent)
        text = ""
        if before is None or before.rid != status.rid:
            first = "started" if status.state is State.STARTING else "is at work"
            text = first if before is None else "started again"
        elif was_silent:
            text = "is heard again"
        if status.state in _ENDED and (before is None or before.state is not status.state):
            text = "stopped" if status.state is State.STOPPED else f"failed: {status.last_error}"
        return [_agent_event(now, agent, text)] if text else []

    def note_silence(self, now: float) -> list[Event]:
        """Derive an event for each agent that fell silent by time `now` (s) without a word: killed, or hanging."""
        events = []
        for agent, heard in self._heard.items():
            ended = self._agents[agent].state in _ENDED
            if now - heard > SILENT_AFTER and not ended and agent not in self._silent:
                self._silent.add(agent)
                events.append(_agent_event(now, agent, f"silent for {SILENT_AFTER:g} s"))
        return events

    def _events(self, changes: Iterable[Change], memory: Memory, now: float) -> Iterator[Event]:
        for change in changes:
            if change.element == "edge":
                if change.type in RELATIONS:
                    yield from self._relation(change, memory, now)
                continue
            node = memory.get_node(change.name) if change.kind != "removed" else None
            yield from self._surprise(change, node, now)
            if change.type in OBJECTS:
                yield from self._presence(change, node, now)
            elif change.type in ("intention", "action"):
                yield from self._status(change, node, now)
            elif change.type == HALT_NODE:
                yield from self._halt(change.name, node, now)
            elif change.type in (EVENT, SITUATION):
                yield from self._entry(change.name, node, now)

    def _relation(self, change: Change, memory: Memory, now: float) -> Iterator[Event]:
        key = (change.src, change.dst, change.type)
        subject = f"{change.src} {change.type} {change.dst}"
        edge = memory.get_edge(*key) if change.kind != "removed" else None
        before = self._relations.pop(key, None)
        if edge is None:
            if before is not None:
                yield Event(now, "ended", subject, f"no more {subject}", {"source": before})
            return
        source = str(edge.get("source", ""))
        self._relations[key] = source
        if before is None:
            text = f"{subject} ({source})" if source else subject
            yield Event(_told_time(edge, "since", now), "began", subject, text, {"source": source})

    def _surprise(self, change: Change, node: Node | None, now: float) -> Iterator[Event]:
        surprising = node is not None and node.get("surprising") is True
        if surprising and node is not None and change.name not in self._surprising:
            self._surprising.add(change.name)
            why = str(node.get("surprise", ""))
            text = f"{change.name} is surprising{f': {why}' if why else ''}"
            yield Event(now, "surprised", change.name, text, {"surprise": why})
        elif not surprising and change.name in self._surprising:
            self._surprising.discard(change.name)
            yield Event(now, "calmed", change.name, f"{change.name} is no longer surprising")

    def _presence(self, change: Change, node: Node | None, now: float) -> Iterator[Event]:
        present = node is not None and is_present(node)
        if present is not self._present.get(change.name, False):
            kind = "appeared" if present else "gone"
            yield Event(now, kind, change.name, f"{change.name} {kind}")
        self._present[change.name] = present
        if node is None:
            del self._present[change.name]

    def _status(self, change: Change, node: Node | None, now: float) -> Iterator[Event]:
        """Of an intention or an action: it came, its status became another, it went."""
        name, before = change.name, self._statuses.get(change.name)
        kind = "intention" if change.type == "intention" else "action"
        if node is None:
            if self._statuses.pop(name, None) is not None:
                yield Event(now, kind, name, f"{name} removed", {"status": "removed"})
            return
        status = str(node.get("status", ""))
        if status != before:
            self._statuses[name] = status
            details = {field: node[field] for field in ("goal", "skill", "target", "destination") if node.get(field)}
            what = " ".join(str(value) for value in details.values())
            why = str(node.get("explanation", ""))
            text = f"{name} ({what}) {status or 'new'}{f': {why}' if why else ''}"
            yield Event(now, kind, name, text, {**details, "status": status, "explanation": why})

    def _halt(self, name: str, node: Node | None, now: float) -> Iterator[Event]:
        """Of an emergency stop, of all arms or of one: it was ordered, it was released."""
        order = order_of(node)
        if order is None or order.id == self._orders.get(name):
            return
        begins, self._orders[name] = name not in self._orders, order.id
        if order.halted:
            yield Event(min(order.stamp or now, now), "halted", name, order.reason, {"source": order.by})
        elif not begins:
            text = f"released by {order.by}"
            yield Event(min(order.stamp or now, now), "released", name, text, {"source": order.by})

    def _entry(self, name: str, node: Node | None, now: float) -> Iterator[Event]:
        """Of the timeline in the graph."""
        if node is None:
            self._explained.pop(name, None)
            self._told.pop(name, None)
        elif node.type == EVENT and kind_of(node) == EXPLAINED:
            yield from self._explanation(node, now)
        elif (entry := read_entry(node)) is not None and entry.kind not in DERIVED:
            told = self._told.setdefault(name, set())
            yield from (event for event in tell([entry]) if event.kind not in told)
            told.update(event.kind for event in tell([entry]))

    def _explanation(self, node: Node, now: float) -> Iterator[Event]:
        explanation = str(node.get("explanation", ""))
        told = (node.get("time"), explanation)
        if not explanation or self._explained.get(node.name) == told:
            return
        self._explained[node.name] = told
        names = ("explanation", "score", "policy", "target", "alternatives")
        details = {name: node[name] for name in names if name in node}
        score = f", score {details['score']:.2f}" if isinstance(details.get("score"), float) else ""
        policy = f" ({details['policy']}{score})" if details.get("policy") else score
        subject = str(details.get("target", "")) or node.name
        text = f"{explained_sentence(node.attributes)}{policy}"
        yield Event(_told_time(node, "time", now), "explained", subject, text, details)


def _told_time(element: Node | Edge, attribute: str, now: float) -> float:
    """When it happened by its own word, if that is no later than it was seen."""
    told = element.get(attribute)
    return told if isinstance(told, float) and 0.0 < told <= now else now


def _agent_event(now: float, agent: str, text: str) -> Event:
    return Event(now, "agent", agent, f"{agent} {text}")
