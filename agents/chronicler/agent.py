"""The chronicler: watches the graph and the agents, and writes events and situations to the timeline."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from typing import ClassVar

import msgspec

from agents.chronicler.facts import ChronicledFact, describe_status, ending, participants_of, read_facts, task_of
from agents.inbox import Inbox
from dsr.agent import Access, Agent
from dsr.errors import WireError
from dsr.graph.elements import Node
from dsr.graph.shares import shared_out
from dsr.memory import Memory
from dsr.network.keys import agent_of
from dsr.runtime.status import SILENT_AFTER, State, Status, decode_status
from dsr.timeline import (
    ACTION,
    AGENT,
    EVENT,
    FORBIDDEN,
    INTENTION,
    OBJECTS,
    PRESENT,
    RELATIONS,
    SITUATION,
    SUMMARY_ATTRIBUTES,
    SUMMARY_NODES,
    SURPRISING,
    WRITTEN_ATTRIBUTES,
    WRITTEN_EDGES,
    WRITTEN_NODES,
    Chronicle,
    Consolidator,
    Entry,
    Retention,
    is_keyed,
    kept_by,
)
from dsr.vocabulary.halting import HALT_NODE

_LAG = 1.0
"""s; what this process never saw hold may be on its way: another writer told it, who heard of it earlier"""


class Keeper:
    """Begins situations that hold and are not open, and ends those that are open and do not hold.

    It goes by what it finds on the timeline, not by what it did: so it goes on after a restart, and several of them
    write the same. Situations that were begun twice with different keys are one: the earliest stays.

    Args:
        memory: the graph.
        chronicle: where to write.
        kinds: of the situations to keep; it looks at those only that have a key.
        ending: tells when (s) and how one ended.
    """

    def __init__(
        self,
        memory: Memory,
        chronicle: Chronicle,
        kinds: Collection[str],
        ending: Callable[[Entry, float], tuple[float, str]],
        lag: float = _LAG,
    ) -> None:
        self._memory = memory
        self._chronicle = chronicle
        self._kinds = frozenset(kinds)
        self._ending = ending
        self._lag = lag
        self._known: set[str] = set()
        self._missed: dict[str, float] = {}

    def update(self, facts: Iterable[ChronicledFact], now: float) -> None:
        """Make the open situations those of `facts` at time `now` (s)."""
        open_ones = self._open()
        known = set()
        for fact in facts:
            found = open_ones.pop((fact.kind, fact.participants), [])
            known.add(self._continued(fact, found))
        left = [entry for entries in open_ones.values() for entry in entries]
        self._end(left, known, now)
        self._known = known

    def _open(self) -> dict[tuple[str, tuple[str, ...]], list[Entry]]:
        found: dict[tuple[str, tuple[str, ...]], list[Entry]] = defaultdict(list)
        for entry in self._chronicle.query(type=SITUATION, kind=self._kinds, open=True):
            if is_keyed(entry.name):
                found[entry.kind, entry.participants].append(entry)
        return found

    def _continued(self, fact: ChronicledFact, found: list[Entry]) -> str:
        """The name of the situation that a fact is, begun if it is new; `found` are the open ones that it may be."""
        if fact.is_dated:
            same = [entry for entry in found if entry.begin == fact.begin]
            for entry in found:
                if entry not in same:
                    self._chronicle.end(entry.name, max(entry.begin, fact.begin))
        else:
            same = found
            for double in found[1:]:
                self._memory.remove_node(double.name)
        if same:
            return same[0].name
        name = self._chronicle.begin(
            fact.kind, fact.participants, fact.begin, text=fact.text, source=fact.source, key=fact.key
        )
        self._chronicle.resume(name)
        return name

    def _end(self, left: list[Entry], known: Collection[str], now: float) -> None:
        """End what does not hold: at once if it was known to, else if it still does not after a while."""
        missed: dict[str, float] = {}
        for entry in left:
            since = missed[entry.name] = self._missed.get(entry.name, now)
            if entry.name in self._known or now - since >= self._lag:
                time, outcome = self._ending(entry, since)
                self._chronicle.end(entry.name, max(time, entry.begin), outcome=outcome)
        self._missed = missed


def newest_status(entries: Iterable[Entry]) -> Mapping[str, str]:
    """The status that was told last of each intention or action, by name."""
    return {entry.participants[0]: str(entry.details.get("status", "")) for entry in entries if entry.participants}


LAG = SILENT_AFTER + 2.0
"""s in which every agent that is at work is heard"""
_MOST_GONE = 1000
_ENDED = (State.STOPPED, State.FAILED)
_Run = tuple[str, str]
"""(agent, replica id)"""


class Company:
    """The agents at work, and the end of those that are not any more."""

    def __init__(self) -> None:
        self._begins: dict[_Run, tuple[float, str]] = {}
        self._heard: dict[_Run, float] = {}
        self._gone: dict[_Run, tuple[float, str]] = {}

    def hear(self, status: Status, now: float) -> bool:
        """Take in a status that arrived at time `now` (s); returns whether somebody came or went."""
        run = (status.agent, status.rid)
        stamp = min(status.stamp, now) if status.stamp > 0.0 else now
        if status.state in _ENDED:
            how = "stopped" if status.state is State.STOPPED else f"failed: {status.last_error}"
            was_there = run in self._begins
            self._leave(run, stamp, f"{status.agent} {how}")
            return was_there
        for other in [other for other in self._begins if other[0] == status.agent and other != run]:
            self._leave(other, self._heard[other], f"{status.agent} was started again")
        started = "started" if status.state is State.STARTING else "is at work"
        is_new = run not in self._begins
        self._begins.setdefault(run, (stamp, f"{status.agent} {started}"))
        self._heard[run] = now
        return is_new

    def facts(self, now: float) -> Iterator[ChronicledFact]:
        """Yield a fact for each agent at work at time `now` (s); an agent that was silent for long is not any more."""
        for run, heard in list(self._heard.items()):
            if now - heard > SILENT_AFTER:
                self._leave(run, heard, f"{run[0]} silent for {SILENT_AFTER:g} s")
        for run, (begin, text) in self._begins.items():
            yield ChronicledFact(AGENT, run, begin, repr(begin), False, text)

    def ending(self, entry: Entry, now: float) -> tuple[float, str]:
        """Time (s) and manner of the end of an agent's run; `now` for an agent that was never heard."""
        agent, rid = (*entry.participants, "", "")[:2]
        return self._gone.get((agent, rid), (now, f"{agent} is not heard"))

    def _leave(self, run: _Run, time: float, outcome: str) -> None:
        self._begins.pop(run, None)
        self._heard.pop(run, None)
        self._gone.pop(run, None)
        self._gone[run] = (time, outcome)
        if len(self._gone) > _MOST_GONE:
            del self._gone[next(iter(self._gone))]


_MOST_WAITING = 1000
_PERIOD = 1.0
"""s between two looks at everything, also if nothing seems to have changed"""
_DETAILS = ("goal", "skill", "target", "destination")


class ChroniclerConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which facts are written, and how many of them stay."""

    relations: tuple[str, ...] = RELATIONS
    """Edge types whose coming and going is told."""
    count: int = 1000
    """Events and situations that are kept."""
    age: float = 3600.0
    """s for which what is over is kept"""

    def __post_init__(self) -> None:
        Retention(self.count, self.age)


class Chronicler(Agent):
    """Writes situations and events that follow from the state of the graph.

    Situations: relations, surprises, things in the scene, intentions that are pursued, actions that run, agents at
    work. Events: each new status of an intention or an action.

    What is over goes into summaries of hours, days and weeks, by the one that keeps the timeline (see `kept_by`).

    Times are those that the graph tells (`since`, or when a value was written), else when it was noticed. What comes
    and goes between two ticks is not noticed. A restarted or second chronicler finds on the timeline what was written.
    """

    name = "chronicler"
    rate_hz = 10.0
    shares_process = True
    reads = Access(nodes=("*",), edges=("*",), attributes=("*",))
    writes: ClassVar[Access] = Access(
        nodes=(*WRITTEN_NODES, *SUMMARY_NODES), edges=WRITTEN_EDGES,
        attributes=tuple(dict.fromkeys((*WRITTEN_ATTRIBUTES, *SUMMARY_ATTRIBUTES, "status", *_DETAILS))),
    )  # fmt: skip
    Config = ChroniclerConfig
    config: ChroniclerConfig
    _statuses: Inbox | None = None

    def setup(self) -> None:
        """Begin to watch and to listen. Raises `SchemaError` for relations that are none."""
        memory, config = self.memory, self.config
        self._chronicle = Chronicle(memory, self.name, keep=Retention(config.count, config.age))
        self._consolidator = Consolidator(memory)
        self._most = max(1, config.count // 2)
        self._company = Company()
        kinds = {*config.relations, PRESENT, SURPRISING, FORBIDDEN, INTENTION, ACTION}
        self._states = Keeper(memory, self._chronicle, kinds, lambda entry, now: ending(memory, entry, now))
        self._agents = Keeper(memory, self._chronicle, {AGENT}, self._company.ending, LAG)
        self._relations = memory.watch(edge_type=config.relations)
        self._values = memory.watch(
            node_type=(*OBJECTS, HALT_NODE, INTENTION, ACTION),
            attribute=("present", "status", "explanation", "halt_id"),
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
            facts = read_facts(self.memory, self.config.relations, self._surprising, now, self._most)
            self._states.update(facts, now)
            self._agents.update(self._company.facts(now), now)
            self._note_statuses(now)
            self._chronicle.claim()
            if self._is_keeper():
                self._consolidator.update()
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
            if self._is_keeper():
                self._consolidator.consolidate()

    def _is_keeper(self) -> bool:
        """Whether it is this agent, of all that could, that keeps the timeline: only one writes summaries."""
        return kept_by(self.memory) == agent_of(self.memory.rid)

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
        nodes = [node for kind in (INTENTION, ACTION) for node in self.memory.nodes(kind)]
        steps = {node.name: node for node in shared_out(nodes, self._most)}
        for name, node in steps.items():
            status = told[name] = str(node.get("status", ""))
            if self._told.get(name) != status:
                time = min(node.written_at("status") or now, now)
                text = f"{name} ({task_of(node)}) {describe_status(node)}"
                self._tell(node, time, text, status, f"{status} {time!r}")
        for name in sorted(name for name in self._steps.keys() - steps.keys() if name not in self.memory):
            node = self._steps[name]
            self._tell(node, now, f"{name} removed", "removed", f"removed {node.created}")
        self._told, self._steps = told, steps

    def _tell(self, node: Node, time: float, text: str, status: str, key: str) -> None:
        details = {name: node[name] for name in _DETAILS if node.get(name)}
        self._chronicle.happened(node.type, participants_of(node), time, text=text, key=key, status=status, **details)
