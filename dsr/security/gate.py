"""Checks arriving changes against the grants of their writers; refused ones are counted, and leave no holes.

Zenoh's access control makes the key of a message prove who sent it (dsr/security/configuration.py), and the key
names the sender's replica. This gate looks inside:

1. A delta may hold only dots of its sender, and only what its sender's grant allows, by node and edge type and
   attribute. Whoever may remove a node may remove the edges at it.
2. What is refused counts as seen, so that digests do not ask for it for ever, and changes nothing: an addition that
   was refused is like one that was removed.
3. What cannot be judged yet, because it is about a node or edge that has not arrived, stays a hole: the repair
   brings it again. So the outcome does not depend on the order of arrival, and all replicas decide alike.
4. A synchronisation reply of a trusted replica may hold everybody's writes, each within its writer's grant. Anybody
   else's is cut down to what it could have said in deltas of its own.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Set

from dsr.crdt.context import Dot, without
from dsr.crdt.delta import Add, Delta, Key, Write
from dsr.crdt.store import Incarnation, Store
from dsr.errors import AgentError
from dsr.graph.rights import Incarnations
from dsr.network.keys import agent_of
from dsr.replication.claims import accounted_for
from dsr.security.policy import AccessPolicy

_log = logging.getLogger("dsr.security")


class Gate:
    """The door of one replica; implements `dsr.replication.sync.Gate`."""

    def __init__(self, policy: AccessPolicy) -> None:
        self.refused: Counter[str] = Counter()
        """Changes that were refused, by agent of the sender: of those there are as many as have a certificate."""
        self._guards = policy.guards()
        self._trusted = {name for name, grant in policy.agents.items() if grant.trusted}

    def trusts(self, rid: str) -> bool:
        """Whether replica `rid` may speak for others."""
        return agent_of(rid) in self._trusted

    def delta(self, sender: str, delta: Delta, store: Store) -> Delta:
        """Select the part of a delta from `sender` that may be joined."""
        return _Screening(self, sender, delta, store).own_changes()

    def reply(self, sender: str, delta: Delta, store: Store) -> Delta:
        """Select the part of a synchronisation reply from `sender` that may be joined."""
        screening = _Screening(self, sender, delta, store)
        return screening.everybodys_changes() if self.trusts(sender) else screening.own_part(store)

    def may_write(self, rid: str, entry: Incarnation, attributes: Iterable[str]) -> bool:
        """See `dsr.graph.rights.Rights`."""
        return self.objection(rid, entry.key, entry.type, attributes) is None

    def removable(self, rid: str, dots: list[Dot], elements: Incarnations) -> list[Dot]:
        """See `dsr.graph.rights.Rights`."""
        screening = _Screening(self, rid, Delta(), elements)
        return list(screening.removable(dots, screening.could_have, alone=False))

    def may_describe(self, rid: str, what: str, name: str) -> bool:
        """See `dsr.graph.rights.Rights`."""
        guard = self._guards.get(agent_of(rid))
        return guard is not None and guard.includes(what, name)

    def objection(self, rid: str, key: Key, type: str, attributes: Iterable[str] = ()) -> str | None:
        """Why the agent of replica `rid` may not write these attributes of an element of `type`; None if it may."""
        guard = self._guards.get(agent_of(rid))
        if guard is None:
            return f"agent {agent_of(rid)!r} may write nothing"
        try:
            guard("node" if isinstance(key, str) else "edge", type, attributes)
        except AgentError as error:
            return str(error)
        return None

    def refuse(self, sender: str, reason: str) -> None:
        """Count a refused change; the first of an agent is logged."""
        agent = agent_of(sender)
        self.refused[agent] += 1
        if self.refused[agent] == 1:
            _log.warning("refused a change from %s: %s (further ones are only counted)", sender, reason)


class _Screening:
    """The examination of one message."""

    def __init__(self, gate: Gate, sender: str, delta: Delta, elements: Incarnations) -> None:
        self._gate = gate
        self._sender = sender
        self._delta = delta
        self._elements = elements
        self._arriving: dict[Dot, Add] = {}
        self._void: set[Dot] = set()
        self._undecided: list[Dot] = []

    def own_changes(self) -> Delta:
        """Of a delta: what is about the sender's own dots and allowed to it."""
        passed = Delta()
        if self._delta.live is not None:
            self._refuse("a synchronisation reply that nobody asked for")
            return passed
        passed.adds = self._take_adds(add for add in self._delta.adds if self._is_own_dot(add.dot))
        passed.writes = [write for write in self._delta.writes if self._is_own(write) and self._may_write(write)]
        passed.removed = list(self.removable(self._delta.removed, self._allowed))
        own = [dots for dots in self._delta.context if dots[0] == self._sender]
        judged = all(self._is_known(dot) for dot in self._delta.removed)
        if judged:
            passed.context = list(without(own, self._undecided))
        else:
            passed.context = accounted_for(self._sender, self._delta, self._undecided)
        return passed

    def everybodys_changes(self) -> Delta:
        """Of the reply of a trusted replica: all that its writers were allowed to write."""
        passed = Delta()
        passed.adds = self._take_adds(self._delta.adds)
        passed.writes = [write for write in self._delta.writes if self._may_write(write)]
        passed.removed, passed.live, passed.examined = self._delta.removed, self._delta.live, self._delta.examined
        passed.context = list(without(self._delta.context, self._undecided))
        return passed

    def own_part(self, store: Store) -> Delta:
        """Of the reply of any other replica: what its agent wrote, and removals that it could have made itself."""
        agent = agent_of(self._sender)
        passed = Delta()
        passed.adds = self._take_adds(add for add in self._delta.adds if agent_of(add.dot[0]) == agent)
        passed.writes = [
            write
            for write in self._delta.writes
            if agent_of(write.writer) == agent
            and (write.dot is None or agent_of(write.dot[0]) == agent)
            and self._may_write(write)
        ]
        passed.removed = list(self.removable(self._absent(store), self.could_have))
        own = [dots for dots in self._delta.context if agent_of(dots[0]) == agent]
        passed.context = list(without(own, self._undecided))
        return passed

    def _is_own_dot(self, dot: Dot) -> bool:
        if dot[0] == self._sender:
            return True
        self._refuse(f"dot {dot} belongs to another replica")
        return False

    def _is_own(self, write: Write) -> bool:
        """Whether the sender made the write, or is trusted and makes the last sample of a dead writer durable."""
        if write.dot is not None and not self._is_own_dot(write.dot):
            return False
        if write.writer == self._sender or (write.dot is not None and self._gate.trusts(self._sender)):
            return True
        self._refuse(f"a write of {write.attribute!r} in the name of {write.writer}")
        return False

    def _take_adds(self, adds: Iterable[Add]) -> list[Add]:
        """Those of `adds` that their makers may make; the others are void, and what is written to them with them."""
        for add in adds:
            if self._allowed(add.dot[0], add.key, add.type):
                self._arriving[add.dot] = add
            else:
                self._void.add(add.dot)
        return list(self._arriving.values())

    def _may_write(self, write: Write) -> bool:
        """Whether the write is allowed; one about an element that has not arrived is put off."""
        owner = self._type_of(write.owner)
        if owner is not None:
            return self._allowed(write.writer, *owner, (write.attribute,))
        if not self._is_known(write.owner) and write.dot is not None:
            self._undecided.append(write.dot)
        return False

    def removable(
        self, dots: Iterable[Dot], may: Callable[[str, Key, str], bool], *, alone: bool = True
    ) -> Iterator[Dot]:
        """Those of `dots` that the sender may remove: what it may write, and edges that lose an end with that.

        An edge keeps its end while one of the nodes is left that others have made under the same name. Edges that the
        sender may write count only if they may go `alone`.
        """
        found = [(dot, *owner) for dot in dots if (owner := self._type_of(dot))]
        nodes = dict.fromkeys(dot for dot, key, type in found if isinstance(key, str) and may(self._sender, key, type))
        yield from nodes
        for dot, key, type in found:
            if isinstance(key, str):
                continue
            if self._loses_an_end(dot, nodes.keys()) or (alone and may(self._sender, key, type)):
                yield dot

    def _absent(self, store: Store) -> list[Dot]:
        """What we hold, and the replier has seen and does not hold."""
        live = self._delta.live
        if live is None:
            return []
        examined = self._delta.context if self._delta.examined is None else self._delta.examined
        return [dot for dots in examined for dot in store.order.between(*dots) if dot not in live]

    def _type_of(self, dot: Dot) -> tuple[Key, str] | None:
        """Key and type of the element created under `dot`, if it lives here or comes with the message."""
        element = self._elements.element(dot) or self._arriving.get(dot)
        return (element.key, element.type) if element else None

    def _is_known(self, dot: Dot) -> bool:
        """Whether it is clear what became of the element created under `dot`."""
        return dot in self._arriving or dot in self._void or self._elements.is_known(dot)

    def _loses_an_end(self, dot: Dot, nodes: Set[Dot]) -> bool:
        """Whether nothing is left at one end of an edge when these nodes are gone; the edge is dead then."""
        edge = self._elements.element(dot) or self._arriving.get(dot)
        return edge is not None and any(
            not nodes.isdisjoint(ends) and all(end in nodes or self._is_gone(end) for end in ends)
            for ends in (edge.sources, edge.destinations)
        )

    def _is_gone(self, dot: Dot) -> bool:
        return self._is_known(dot) and self._type_of(dot) is None

    def _allowed(self, rid: str, key: Key, type: str, attributes: Iterable[str] = ()) -> bool:
        objection = self._gate.objection(rid, key, type, attributes)
        if objection is not None:
            self._refuse(objection)
        return objection is None

    def could_have(self, rid: str, key: Key, type: str) -> bool:
        """Whether the agent of `rid` may write it; if not, another one has removed it, and that is no offence."""
        return self._gate.objection(rid, key, type) is None

    def _refuse(self, reason: str) -> None:
        self._gate.refuse(self._sender, reason)
