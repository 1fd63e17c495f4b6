"""Writes and queries the timeline, for every agent that has something to tell."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable
from itertools import count
from numbers import Real
from typing import Any

from dsr.errors import SchemaError
from dsr.memory import Memory
from dsr.network.keys import agent_of
from dsr.timeline.allen import AllenRelation
from dsr.timeline.entries import EVENT, SITUATION, TIMELINE, Entry, joined_names, read_entry
from dsr.timeline.queries import Time, query
from dsr.timeline.retention import Orphans, Retention, read_all, written_by
from dsr.vocabulary.intentions import MIND

WRITTEN_NODES = (TIMELINE, EVENT, SITUATION)
"""Node types that an agent with a `Chronicle` declares to write (`Access.nodes`). Exclusive for nobody."""
WRITTEN_EDGES = ("has",)
"""Edge types that an agent with a chronicle writes."""
WRITTEN_ATTRIBUTES = (
    "kind", "participants", "time", "begin", "end", "text", "outcome", "confidence", "source",
)  # fmt: skip
"""Attributes that an agent with a chronicle writes; with those that it adds as details."""
_KEYED = re.compile(rf"({EVENT}|{SITUATION})_[0-9a-f]{{20}}")
_LOOK = 5.0  # s between two looks at what is to be forgotten


class Chronicle:
    """The timeline of a working memory, for one agent that writes to it.

    Events and situations are nodes below `timeline`, named after the writing replica, so that nobody's writes meet
    another's. With a `key`, the name follows from that instead: writers that tell the same with the same key write one
    entry, also after a restart. A time in the future is taken as it is: an agent may foresee.

    Args:
        memory: where the timeline is.
        agent: default of `source`; the memory's agent if empty.
        keep: how much of this agent's own stays; see dsr/timeline/retention.py.
    """

    def __init__(self, memory: Memory, agent: str = "", *, keep: Retention | None = None) -> None:
        self._memory = memory
        self._agent = agent or memory.agent
        self._writer = agent_of(memory.rid) or memory.agent
        self._keep = keep or Retention()
        self._orphans = Orphans(memory, self._keep)
        self._numbers = count()
        self._room = 0
        self._looked = -math.inf
        self._complete_from = -math.inf
        """s; of what was over before, some has been forgotten for want of room"""

    def happened(
        self,
        kind: str,
        participants: str | Iterable[str] = (),
        time: float | None = None,
        *,
        text: str = "",
        confidence: float | None = None,
        source: str = "",
        key: str = "",
        **details: Any,
    ) -> str:
        """Write an event; returns the name of its node, which does not exist if it would be forgotten at once.

        Args:
            kind: what happened.
            participants: names, the first is what it is about.
            time: when, s; now if None.
            text: the same in a line for people.
            confidence: 0 to 1; absent counts as 1.
            source: what says so; the agent if empty.
            key: makes it one with events of the same kind and participants told under this key.
            details: further attributes.

        Raises:
            SchemaError: for attributes that the schema does not know or allow, or a confidence beyond 0 to 1.
        """
        values = {"time": time, "text": text, "confidence": confidence, "source": source or self._agent, **details}
        return self._write(EVENT, kind, participants, key, values)

    def begin(
        self,
        kind: str,
        participants: str | Iterable[str] = (),
        time: float | None = None,
        *,
        text: str = "",
        confidence: float | None = None,
        source: str = "",
        key: str = "",
        **details: Any,
    ) -> str:
        """Write a situation that lasts from `time` (s, now if None) until `end`; returns its name. See `happened`."""
        values = {"begin": time, "text": text, "confidence": confidence, "source": source or self._agent, **details}
        return self._write(SITUATION, kind, participants, key, values)

    def end(self, name: str, time: float | None = None, *, outcome: str = "") -> bool:
        """End a situation at `time` (s, now if None); false if it is not there, or over already."""
        node = self._memory.get_node(name)
        if node is None or node.type != SITUATION or "end" in node:
            return False
        values = {"end": self._memory.clock.now() if time is None else time}
        self._memory.update_node(name, **values, **({"outcome": outcome} if outcome else {}))
        return True

    def resume(self, name: str) -> bool:
        """Take the end of a situation back: it goes on; false if it is not there, or lasts."""
        node = self._memory.get_node(name)
        if node is None or node.type != SITUATION or "end" not in node:
            return False
        with self._memory.batch():
            for attribute in ("end", "outcome"):
                self._memory.remove_attribute(name, attribute)
        return True

    def left_open(self, kind: str | Iterable[str] | None = None) -> list[Entry]:
        """Situations of this agent that last: after a restart those of its earlier runs, to go on with or to end."""
        return [entry for entry in self.query(type=SITUATION, kind=kind, open=True) if self._writer in entry.writers]

    def query(
        self,
        *,
        type: str | None = None,
        kind: str | Iterable[str] | None = None,
        participants: str | Iterable[str] | None = None,
        during: Time | None = None,
        since: float | None = None,
        until: float | None = None,
        source: str | None = None,
        open: bool | None = None,
        relation: AllenRelation | Iterable[AllenRelation] | None = None,
        of: Time | None = None,
    ) -> list[Entry]:
        """Find entries of all agents, see `dsr.timeline.query`."""
        return query(
            self._memory, type=type, kind=kind, participants=participants, during=during, since=since, until=until,
            source=source, open=open, relation=relation, of=of,
        )  # fmt: skip

    def entry(self, name: str) -> Entry | None:
        """The entry of a node; None if there is none."""
        node = self._memory.get_node(name)
        return None if node is None else read_entry(node)

    def claim(self) -> None:
        """Say that this agent writes what follows from the state of the graph, see `kept_by`."""
        self._prepare()
        node = self._memory.node(TIMELINE)
        if node.get("source") not in {agent_of(rid) for rid in (self._memory.rid, *self._memory.peers)}:
            self._memory.update_node(TIMELINE, source=self._writer)

    def forget(self) -> int:
        """Remove what is too old or too many, of this agent and of those that are gone; returns how many.

        Called by every write, now and then; an agent that writes seldom calls it in its ticks (it looks every 5 s).
        """
        return self._forget(0)

    def _forget(self, room: int) -> int:
        """Forget, so that `room` more can be written."""
        monotonic = self._memory.clock.monotonic()
        if self._room > 0 and monotonic - self._looked < _LOOK:
            return 0
        self._looked = monotonic
        now, everything = self._memory.clock.now(), read_all(self._memory)
        own = written_by(self._writer, everything)
        outlived = (*self._keep.outlived(own, now, room), *self._orphans.outlived(everything, now))
        old = {entry.name: entry for entry in outlived}
        with self._memory.batch():
            for name in old:
                self._memory.remove_node(name)
            for entry, since in self._orphans.abandoned(everything, now):
                self.end(entry.name, max(since, entry.begin), outcome="its writer is gone")
        left = [entry for entry in own if entry.name not in old]
        if len(own) + room > self._keep.count:
            over = [entry for entry in own if entry.last < math.inf]
            forgotten = max((entry.last for entry in over if entry.name in old), default=-math.inf)
            oldest = min((entry.last for entry in over if entry.name not in old), default=forgotten)
            self._complete_from = max(self._complete_from, oldest)
        self._room = max(1, self._keep.count - len(left), self._keep.count // 20)
        return len(old)

    def _write(self, type: str, kind: str, participants: str | Iterable[str], key: str, values: dict[str, Any]) -> str:
        _check_confidence(values["confidence"])
        memory, names = self._memory, joined_names(participants)
        began = "time" if type == EVENT else "begin"
        time = memory.clock.now() if values[began] is None else float(values[began])
        name = _keyed_name(type, kind, names, key) if key else self._free_name(type)
        if key and name in memory:
            return name
        if key and type == EVENT:
            self._forget(1)
            if self._is_past(time):
                return name
        given = {attribute: value for attribute, value in values.items() if value is not None and value != ""}
        self._room -= 1
        self._forget(1)
        with memory.batch():
            self._prepare()
            memory.add_node(name, type, kind=kind, participants=names, **{**given, began: time})
            memory.add_edge(TIMELINE, name, "has")
        return name

    def _free_name(self, type: str) -> str:
        """A name that no other replica gives, and that is not taken by another `Chronicle` of this one."""
        stem = f"{type}_{self._memory.rid}_"
        return next(name for number in self._numbers if (name := f"{stem}{number}") not in self._memory)

    def _is_past(self, time: float) -> bool:
        """Whether an event of that time would be forgotten at once: it was known, and has been forgotten."""
        return time < max(self._memory.clock.now() - self._keep.age, self._complete_from)

    def _prepare(self) -> None:
        """Make the node from which all entries hang."""
        memory = self._memory
        if TIMELINE not in memory:
            memory.add_node(TIMELINE, TIMELINE)
        if MIND in memory and memory.get_edge(MIND, TIMELINE, "has") is None:
            memory.add_edge(MIND, TIMELINE, "has")


def kept_by(memory: Memory) -> str | None:
    """The agent, one that is there, that writes what follows from the state of the graph; None if nobody does."""
    node = memory.get_node(TIMELINE)
    there = {agent_of(rid) for rid in (memory.rid, *memory.peers)}
    return source if node is not None and (source := node.get("source")) in there else None


def is_keyed(name: str) -> bool:
    """Whether the name of an entry follows from a key."""
    return _KEYED.fullmatch(name) is not None


def _check_confidence(value: object) -> None:
    """Refuse numbers beyond 0 to 1; what is no number at all the schema refuses."""
    if isinstance(value, Real) and not 0.0 <= float(value) <= 1.0:
        raise SchemaError(f"attribute 'confidence': expected 0 to 1, got {value!r}")


def _keyed_name(type: str, kind: str, participants: str, key: str) -> str:
    digest = hashlib.blake2s("\n".join((kind, participants, key)).encode(), digest_size=10).hexdigest()
    return f"{type}_{digest}"
