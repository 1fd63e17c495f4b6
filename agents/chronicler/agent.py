"""The chronicler: watches the graph and the agents, and writes what happens to the timeline."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import msgspec

from agents.chronicler.company import LAG, Company
from agents.chronicler.facts import describe_status, ending, participants_of, read_facts, task_of
from agents.chronicler.keeping import Keeper, newest_status
from agents.inbox import Inbox
from dsr.agent import Access, Agent
from dsr.errors import WireError
from dsr.graph.elements import Node
from dsr.runtime.status import State, Status, decode_status
from dsr.timeline import (
    ACTION,
    AGENT,
    EVENT,
    INTENTION,
    OBJECTS,
    PRESENT,
    RELATIONS,
    SURPRISING,
    WRITTEN_ATTRIBUTES,
    WRITTEN_EDGES,
    WRITTEN_NODES,
    Chronicle,
    Retention,
)

_MOST_WAITING = 1000
_PERIOD = 1.0
"""s between two looks at everything, also if nothing seems to have changed"""
_DETAILS = ("goal", "skill", "target", "destination")


class ChroniclerConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is written, and how much of it stays."""

    relations: tuple[str, ...] = RELATIONS
    """Edge types whose coming and going is told."""
    count: int = 1000
    """Events and situations that are kept."""
    age: float = 3600.0
    """s for which what is over is kept"""

    def __post_init__(self) -> None:
        Retention(self.count, self.age)


class Chronicler(Agent):
    """Writes what follows from the state of the graph.

    Situations: relations, surprises, things in the scene, intentions that are pursued, actions that run, agents at
    work. Events: each new status of an intention or an action.

    Times are those that the graph tells (`since`, or when a value was written), else when it was noticed. What comes
    and goes between two ticks is not noticed. A restarted or second chronicler finds on the timeline what was written.
    """

    name = "chronicler"
    rate_hz = 10.0
    reads = Access(nodes=("*",), edges=("*",), attributes=("*",))
    writes: ClassVar[Access] = Access(
        nodes=WRITTEN_NODES, edges=WRITTEN_EDGES, attributes=(*WRITTEN_ATTRIBUTES, "status", *_DETAILS)
    )
    Config = ChroniclerConfig
    config: ChroniclerConfig
    _statuses: Inbox | None = None

    def setup(self) -> None:
        """Begin to watch and to listen. Raises `SchemaError` for relations that are none."""
        memory, config = self.memory, self.config
        self._chronicle = Chronicle(memory, self.name, keep=Retention(config.count, config.age))
        self._company = Company()
        kinds = {*config.relations, PRESENT, SURPRISING, INTENTION, ACTION}
        self._states = Keeper(memory, self._chronicle, kinds, lambda entry, now: ending(memory, entry, now))
        self._agents = Keeper(memory, self._chronicle, {AGENT}, self._company.ending, LAG)
        self._relations = memory.watch(edge_type=config.relations)
        self._values = memory.watch(
            node_type=(*OBJECTS, INTENTION, ACTION), attribute=("present", "status", "explanation")
        )
        self._surprises = memory.watch(attribute="surprising")
        self._surprising: set[str] = set()
        self._told: Mapping[str, str] | None = None
        self._steps: dict[str, Node] = {}
        self._looked = float("-inf")
        self._statuses = Inbox(self.bus, self.keys.status(), self.clock, _MOST_WAITING)
        self._malformed = 0

    def tick(self, now: float) -> None:
        """Write what is new."""
        if not self.memory.joined:
            return
        changes = [*self._relations.poll(), *self._values.poll()]
        surprises = self._surprises.poll()
        self._surprising.update(change.name for change in surprises)
        is_news = self._listen(now)
        if not (changes or surprises or is_news or now - self._looked >= _PERIOD):
            return
        self._looked = now
        with self.memory.batch():
            self._states.update(read_facts(self.memory, self.config.relations, self._surprising, now), now)
            self._agents.update(self._company.facts(now), now)
            self._note_statuses(now)
            self._chronicle.claim()
            self._chronicle.forget()
        self._surprising = {name for name in self._surprising if self._is_surprising(name)}

    def teardown(self) -> None:
        """Say that this agent is at work no more."""
        if self._statuses is None:
            return
        self._statuses.close()
        now = self.clock.now()
        if self.memory.joined:
            self._company.hear(self._own_status(State.STOPPED, now), now)
            self._agents.update(self._company.facts(now), now)

    def _listen(self, now: float) -> bool:
        """Take in statuses, the own one too; returns whether somebody came or went."""
        assert self._statuses is not None
        is_news = False
        for message in self._statuses.take():
            try:
                is_news |= self._company.hear(decode_status(message.payload), message.stamp)
            except WireError as error:
                self._malformed += 1
                if self._malformed == 1:
                    self.log.warning("dropped a message on %s: %s (logged once)", message.key, error)
        self._company.hear(self._own_status(State.READY, now), now)
        return is_news

    def _own_status(self, state: State, now: float) -> Status:
        return Status(agent=self.name, rid=self.memory.rid, pid=0, state=state, stamp=now)

    def _is_surprising(self, name: str) -> bool:
        node = self.memory.get_node(name)
        return node is not None and node.get("surprising") is True

    def _note_statuses(self, now: float) -> None:
        """Tell each new status of an intention or an action, and that one was removed."""
        if self._told is None:
            self._told = newest_status(self._chronicle.query(type=EVENT, kind=(INTENTION, ACTION)))
        told: dict[str, str] = {}
        steps = {node.name: node for kind in (INTENTION, ACTION) for node in self.memory.nodes(kind)}
        for name, node in steps.items():
            status = told[name] = str(node.get("status", ""))
            if self._told.get(name) != status:
                time = min(node.written_at("status") or now, now)
                text = f"{name} ({task_of(node)}) {describe_status(node)}"
                self._tell(node, time, text, status, f"{status} {time!r}")
        for name in sorted(self._steps.keys() - steps.keys()):
            node = self._steps[name]
            self._tell(node, now, f"{name} removed", "removed", f"removed {node.created}")
        self._told, self._steps = told, steps

    def _tell(self, node: Node, time: float, text: str, status: str, key: str) -> None:
        details = {name: node[name] for name in _DETAILS if node.get(name)}
        self._chronicle.happened(node.type, participants_of(node), time, text=text, key=key, status=status, **details)
