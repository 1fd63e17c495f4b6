"""Replicas without a network: the test decides which message, new or old, reaches whom, and when, and how often.

After each step the replica concerned must show exactly what the plain model makes of the facts that reached it.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import pytest

from benchmarks.years.knowledge import Fact, Knowledge, facts_of
from benchmarks.years.readers import Reader
from benchmarks.years.showing import shown, state
from dsr.crdt.context import CausalContext, Dot
from dsr.crdt.delta import TOMBSTONE, Delta, EdgeKey, Key, Write
from dsr.crdt.hlc import MAX_LEAD, stamp_at
from dsr.crdt.pieces import reply_to
from dsr.errors import NodeTypeError, NoRoomError
from dsr.graph.elements import Edge, Node, types_of
from dsr.graph.far_stamps import FAR
from dsr.graph.graph import Graph
from dsr.graph.watch import ChangeFilter, Watch
from dsr.graph.watches import Watches
from dsr.replication.outbox import Outbox
from dsr.replication.values import fitted
from dsr.replication.wire import decode_delta, encode_delta

START = 1_000_000_000.0
HOUR = 3600.0
"""s by which a clock may be off."""
HONEST = stamp_at(START - HOUR + MAX_LEAD)
"""The greatest stamp that every clock follows, however it is set."""
FORGER = "forger-1"
"""Replica id under which forged stamps are sent, by nobody who keeps to the protocol."""
NOBODYS: Dot = ("nobody-1", 1)
"""A creation dot that nobody has ever issued: what is written to it waits."""


@dataclass
class Message:
    """Bytes under way, and what they say."""

    payload: bytes
    facts: Knowledge
    receiver: str | None = None
    """Replica id; None for anybody. A reply is for who asked."""


class _Readers(Watches):
    """Passes on what a graph reports, as `Memory` does."""

    def __init__(self) -> None:
        super().__init__()
        self.all, self.cubes = Reader(Watch(ChangeFilter())), Reader(
            Watch(ChangeFilter(node_types=frozenset({"cube"})))
        )
        for reader in (self.all, self.cubes):
            self.follow(reader.watch, [])


class Site:
    """A replica, what has reached it, and its readers. Its physical clock is off by `skew` s."""

    def __init__(self, rid: str, skew: float) -> None:
        self.readers = _Readers()
        self.graph = Graph(rid, watches=self.readers)
        self.known = Knowledge()
        self.skew = skew
        self.latest = 0
        """The greatest stamp, no greater than `HONEST`, of the writes that have come to it, or were made there."""

    def note_stamps(self, delta: Delta) -> None:
        """These writes have come. One that lost elsewhere before it was handed on never comes."""
        self.latest = max([self.latest, *(write.stamp for write in delta.writes if write.stamp <= HONEST)])

    def check(self) -> None:
        """Exactly what reached it is shown and held; no edge dangles; the indexes agree."""
        graph = self.graph
        assert shown(graph) == self.known.shown()
        assert graph.store.entries.keys() == self.known.held(), "something is held that nobody can see again"
        for edge in graph.edges.values():
            assert edge.src in graph.nodes and edge.dst in graph.nodes, f"{edge} dangles"
            assert graph.edges_out[edge.src][edge.key] is graph.edges_in[edge.dst][edge.key] is edge
            assert graph.edges_by_type[edge.type][edge.key] is edge
        for node in graph.nodes.values():
            assert graph.nodes_by_type[node.type][node.name] is node
        for index, size in (
            (graph.nodes_by_type, graph.nodes), (graph.edges_by_type, graph.edges), (graph.edges_out, graph.edges),
        ):  # fmt: skip
            assert sum(map(len, index.values())) == len(size)


class Soup:
    """Sites, and every message that any of them ever sent."""

    def __init__(self, skews: Sequence[float]) -> None:
        self.time = START
        self.messages: list[Message] = []
        self.dead: set[str] = set()
        self._issued: set[Dot] = set()
        self._dots: dict[Fact, set[Dot]] = {}
        self._overruled: dict[Fact, set[Fact]] = {}
        """What was shown when somebody wrote anew, and the writes that must win over it for good."""
        self._forged = 0
        self._boots = 0
        self.sites = [self._boot(skew) for skew in skews]

    def _boot(self, skew: float) -> Site:
        self._boots += 1
        return Site(self.new_rid(self._boots), skew)

    def new_rid(self, boot: int) -> str:
        """The replica id of a start: never the same twice."""
        return f"r-{boot}"

    def a_node(self, index: int, choice: int) -> str | None:
        """One of the nodes that a replica shows."""
        names = sorted(self._site(index)[0].graph.nodes)
        return names[choice % len(names)] if names else None

    def an_edge(self, index: int, choice: int) -> EdgeKey | None:
        """One of the edges that a replica shows."""
        keys = sorted(self._site(index)[0].graph.edges)
        return keys[choice % len(keys)] if keys else None

    # ---- writing

    def add_node(self, index: int, name: str, type: str, value: int) -> None:
        site, now = self._site(index)
        there = site.graph.nodes.get(name)
        if there is not None and type not in types_of(there):
            with pytest.raises(NodeTypeError):
                site.graph.add_node(name, type, {"seen": value}, now)
            type = there.type
        delta = self._written(index, lambda: site.graph.add_node(name, type, {"seen": value}, now))
        self._sent(site, delta, (name, type), site.known.incarnations(name), {"seen": value})

    def update_node(self, index: int, name: str, values: dict[str, Any]) -> None:
        site, now = self._site(index)
        if name in site.graph.nodes:
            delta = self._written(index, lambda: site.graph.write(site.graph.nodes[name], values, now))
            self._sent(site, delta, None, site.known.incarnations(name), values)

    def remove_attribute(self, index: int, key: Key, attribute: str) -> None:
        site, now = self._site(index)
        if key not in site.graph.nodes and key not in site.graph.edges:
            return
        is_set = attribute in element_of(site.graph, key)
        delta = self._written(
            index, lambda: site.graph.remove_attribute(element_of(site.graph, key), attribute, now)
        )
        self._sent(site, delta, None, self._written_by(site, key) if is_set else [], {attribute: TOMBSTONE})

    def add_edge(self, index: int, key: EdgeKey, values: dict[str, Any]) -> None:
        site, now = self._site(index)
        if key[0] in site.graph.nodes and key[1] in site.graph.nodes:
            is_new = key not in site.graph.edges
            delta = self._written(index, lambda: site.graph.add_edge(*key, values, now))
            if is_new:
                assert set(delta.adds[0].sources) == set(site.known.incarnations(key[0])), "bound to other dots"
            owners = [] if is_new else site.known.incarnations(key)
            self._sent(site, delta, (key, key[2]) if is_new else None, owners, values)

    def update_edge(self, index: int, key: EdgeKey, values: dict[str, Any]) -> None:
        site, now = self._site(index)
        if key in site.graph.edges:
            delta = self._written(index, lambda: site.graph.write(site.graph.edges[key], values, now))
            self._sent(site, delta, None, self._written_by(site, key), values)

    def remove_node(self, index: int, name: str) -> None:
        site, _ = self._site(index)
        gone = {*site.known.incarnations(name), *site.known.at(name)} if name in site.graph.nodes else set()
        self._sent(site, site.graph.remove_node(name), removed=gone)

    def remove_edge(self, index: int, key: EdgeKey) -> None:
        site, _ = self._site(index)
        gone = set(site.known.incarnations(key)) if key in site.graph.edges else set()
        self._sent(site, site.graph.remove_edge(key), removed=gone)

    def batch(self, index: int, names: Iterable[str], value: int) -> None:
        """Several changes in one message."""
        first = len(self.messages)
        for name in names:
            self.add_node(index, name, "cube", value)
            self.update_node(index, name, {"mass": float(value)})
        together = [message for message in self.messages[first:] if message.receiver is None]
        if together:
            outbox, facts = Outbox(), Knowledge()
            for message in together:
                outbox.add(decode_delta(message.payload), together=True)
                facts.learn(message.facts)
            self.messages[first:] = [Message(encode_delta(outbox.take()[0][0]), facts)]

    def renew(self, index: int, key: Key) -> None:
        """Make anew what a replica shows: all of it that is seen stays, and nothing else."""
        site, now = self._site(index)
        before = site.known.shown()
        if key not in before:
            return
        around = site.known.at(key) if isinstance(key, str) else []
        gone = {*site.known.incarnations(key), *around}
        delta = site.graph.renew(key, now)
        assert set(delta.removed) == gone and len(delta.removed) == len(gone)
        self._note_dots(delta)
        facts = facts_of(delta)
        site.known.learn(facts)
        self._send(delta, facts)
        assert site.known.shown() == before, "making anew changed what is shown"
        assert all(write.stamp <= stamp_at(now + FAR) for write in delta.writes), "a stamp of the far future was kept"

    def forge(
        self, target: Dot | None, attribute: str, stamp: int | None, value: Any, *, durable: bool, reaches: int
    ) -> None:
        """Somebody who speaks the protocol himself writes to an incarnation with any stamp that the format takes.

        None stands for that of what is there. It reaches one replica at once, and the others as any message does.
        """
        if stamp is None:
            written = self._site(reaches)[0].known.written
            stamp = max((fact[2] for fact in written if fact[:2] == (target, attribute)), default=0)
        fact = (target or NOBODYS, attribute, stamp, FORGER)
        if fact in self._dots:
            return  # two values under one stamp and writer: told to different replicas, these may differ
        self._forged += 1
        self.dead.add(FORGER)
        dot = (FORGER, self._forged) if durable else None
        delta = Delta(writes=[Write(fact[0], attribute, stamp, FORGER, dot, value)])
        delta.context = [(*dot, dot[1])] if dot else []
        self._note_dots(delta)
        read = Write(fact[0], attribute, stamp, FORGER, dot, fitted(attribute, value))
        self._send(delta, facts_of(Delta(writes=[read], context=delta.context)))
        self._receive(self._site(reaches)[0], self.messages[-1])

    def a_dot(self, index: int, choice: int) -> Dot | None:
        """A creation dot of what a replica holds."""
        dots = sorted(self._site(index)[0].known.held())
        return dots[choice % len(dots)] if dots else None

    def make_durable(self, index: int) -> None:
        """Make samples durable; those of others after three calls without news."""
        site, _ = self._site(index)
        delta = site.graph.make_durable()
        facts = facts_of(delta)
        assert facts.written.items() <= site.known.written.items(), "a sample that nobody wrote"
        self._note_dots(delta)
        self._send(delta, facts)

    # ---- the network

    def deliver(self, choice: int, index: int) -> None:
        """Any message ever sent reaches anybody whom it may reach, again if the test likes."""
        site, _ = self._site(index)
        waiting = [m for m in self.messages if m.receiver in (None, site.graph.rid)]
        if waiting:
            self._receive(site, waiting[choice % len(waiting)])

    def reply(self, asker: int, asked: int) -> None:
        """One replica asks another; the reply is under way from now on."""
        site, other = self._site(asker)[0], self._site(asked)[0]
        reply = reply_to(other.graph.store, site.graph.store.context)
        self.messages.append(Message(encode_delta(reply), other.known.passed_on(), site.graph.rid))

    def snapshot(self, index: int) -> None:
        """The whole state of a replica as a message for anybody, as a newcomer or a file gets it."""
        site, _ = self._site(index)
        self.messages.append(Message(encode_delta(full(site.graph)), site.known.passed_on()))

    def sync(self, asker: int, asked: int) -> None:
        """One replica gets from another what it lacks: the same as joining all that the other holds."""
        site, other = self._site(asker)[0], self._site(asked)[0]
        whole = copied(site.graph)
        whole.join(full(other.graph), self.time + site.skew)
        self.reply(asker, asked)
        self._receive(site, self.messages[-1])
        assert state(site.graph) == state(whole), "sync(version vector) differs from a full merge"

    def crash(self, index: int) -> None:
        """A replica dies with what only it knew; another one starts in its place."""
        index %= len(self.sites)
        self.dead.add(self.sites[index].graph.rid)
        self.sites[index] = self._boot(self.sites[index].skew)

    # ---- the end

    def converge(self) -> None:
        """Let everybody hear everything that anybody alive knows."""
        for _ in range(4):
            for index in range(len(self.sites)):
                self.make_durable(index)
        for _ in range(4):  # around twice, and again for a write that waited for what came with the first
            for index in range(len(self.sites)):
                self.sync(index, index + 1)
                self.sync(index + 1, index)

    def check(self) -> None:
        """What must hold at every moment."""
        for site in self.sites:
            site.check()
            self._check_overruled(site)
            for fact in site.known.waiting():
                assert not any(dot in site.graph.store.context for dot in self._dots[fact]), "seen, but not applied"

    def _check_overruled(self, site: Site) -> None:
        """Nobody who has got a write shows what its writer saw and replaced, whatever the stamps say."""
        elements: list[Node | Edge] = [*site.graph.nodes.values(), *site.graph.edges.values()]
        for element in elements:
            for name in element.written:
                later = self._overruled.get(fact_shown(element, name), set()) & site.known.written.keys()
                seen = [fact for fact in later if fact[0] in site.known.added and site.known.is_visible(fact[0])]
                assert not seen, "a write that was seen won over a later one"

    def check_converged(self) -> None:
        """All replicas are equal, in what they hold too; no hole is left but those that a dead one left."""
        self.check()
        first = self.sites[0]
        for site in self.sites:
            assert state(site.graph) == state(first.graph), "replicas differ"
            assert set(site.graph.store.context.cloud) <= self.dead, "a hole that is never closed"
            assert all(r.dot for e in site.graph.store.entries.values() for r in e.registers.values()), "not durable"
            self.check_readers(site)

    def check_readers(self, site: Site) -> None:
        """Who follows the changes ends with what is shown."""
        expected = shown(site.graph)
        seen = site.readers.all.read(site.graph)
        assert seen == expected, f"a reader knows something else: {seen}, shown {expected}"
        cubes = {key: value for key, value in expected.items() if isinstance(key, str) and value[0] == "cube"}
        assert site.readers.cubes.read(site.graph) == cubes

    # ---- within

    def _written(self, index: int, write: Callable[[], Delta]) -> Delta:
        """What a write gives, after what leaves no room for it was made anew; note what it replaces."""
        site, _ = self._site(index)
        try:
            shown_before = facts_shown(site.graph)
            delta = write()
        except NoRoomError as full:
            self.renew(index, full.key)
            shown_before = facts_shown(site.graph)
            delta = write()
        for fact in facts_of(delta).written:
            key = site.graph.store.entries[fact[0]].key
            replaced = shown_before.get((key, fact[1]))
            if replaced is not None:
                self._overruled.setdefault(replaced, set()).add(fact)
        return delta

    def _site(self, index: int) -> tuple[Site, float]:
        site = self.sites[index % len(self.sites)]
        return site, self.time + site.skew

    def _written_by(self, site: Site, key: Key) -> list[Dot]:
        """The incarnations of what is visible under `key`, to which a write goes."""
        return [d for d in site.known.incarnations(key) if site.known.is_visible(d)]

    def _sent(
        self,
        site: Site,
        delta: Delta,
        add: tuple[Key, str] | None = None,
        owners: Sequence[Dot] = (),
        values: dict[str, Any] | None = None,
        removed: set[Dot] = frozenset(),  # type: ignore[assignment]
    ) -> None:
        """Check that a delta says what the operation means, then put it under way."""
        if add is not None and not owners:
            assert [(a.key, a.type) for a in delta.adds] == [add]
            owners = [delta.adds[0].dot]
        else:
            assert not delta.adds, "an addition of what is there"
        told = {(w.owner, w.attribute, repr(w.value)) for w in delta.writes}
        assert told == {(o, name, repr(value)) for o in owners for name, value in (values or {}).items()}
        assert set(delta.removed) == removed
        self._check_stamps(site, delta)
        self._note_dots(delta)
        facts = facts_of(delta)
        site.known.learn(facts)
        self._send(delta, facts)

    def _check_stamps(self, site: Site, delta: Delta) -> None:
        """Each is after all that came of honest clocks, and no further ahead than what it overwrites forces it."""
        live = [fact for fact in site.known.written if site.known.is_live(fact[0])]
        for write in delta.writes:
            own = {other.owner for other in delta.writes if other.attribute == write.attribute}
            below = max((fact[2] for fact in live if fact[0] in own and fact[1] == write.attribute), default=0)
            assert write.stamp > site.latest, "a stamp that is not after what has come"
            assert write.stamp > below, "a stamp that is not after what it replaces"
            limit = stamp_at(self.time + HOUR + MAX_LEAD) + len(self._dots) + 9
            assert write.stamp <= max(limit, below + 1), "a clock that followed a forged stamp"
        site.note_stamps(delta)

    def _note_dots(self, delta: Delta) -> None:
        """No dot is ever issued twice; what a delta issues, its context covers."""
        dots = [*(add.dot for add in delta.adds), *(write.dot for write in delta.writes if write.dot)]
        covered = [(rid, n) for rid, first, last in delta.context for n in range(first, last + 1)]
        assert self._issued.isdisjoint(covered), "a dot was issued twice"
        assert set(dots) <= set(covered) and len(dots) == len(set(dots))
        self._issued.update(covered)
        for write in delta.writes:
            fact = (write.owner, write.attribute, write.stamp, write.writer)
            self._dots.setdefault(fact, set()).update([write.dot] if write.dot else [])

    def _send(self, delta: Delta, facts: Knowledge) -> None:
        """Stream samples travel apart: they may be lost without leaving a hole."""
        samples = Delta()
        samples.writes = [write for write in delta.writes if write.dot is None]
        delta.writes = [write for write in delta.writes if write.dot is not None]
        assert not samples.context
        streamed = facts_of(samples)
        lasting = {fact: value for fact, value in facts.written.items() if fact not in streamed.written}
        rest = Knowledge(facts.added, facts.removed, lasting)
        for part, says in ((delta, rest), (samples, streamed)):
            if part:
                self.messages.append(Message(encode_delta(part), says))

    def _receive(self, site: Site, message: Message) -> None:
        delta = decode_delta(message.payload)
        lasting = {(w.owner, w.attribute, w.stamp, w.writer) for w in delta.writes if w.dot is not None}
        site.graph.join(delta, self.time + site.skew)
        site.note_stamps(delta)
        site.known.learn(Knowledge(message.facts.added, message.facts.removed))
        site.known.written |= {
            fact: value
            for fact, value in message.facts.written.items()
            if message.receiver or fact in lasting or fact[0] in site.known.added
        }  # a sample for a node that was not heard of yet is lost


def element_of(graph: Graph, key: Key) -> Node | Edge:
    """What a replica shows under a key."""
    return graph.nodes[key] if isinstance(key, str) else graph.edges[key]


def fact_shown(element: Node | Edge, attribute: str) -> Fact:
    """The write that a value which is shown is from."""
    write = element.newest_write(attribute)
    assert write is not None
    return write.owner, attribute, write.stamp, write.writer


def facts_shown(graph: Graph) -> dict[tuple[Key, str], Fact]:
    """The writes that all values which are shown are from."""
    elements = {**graph.nodes, **graph.edges}
    return {(key, name): fact_shown(element, name) for key, element in elements.items() for name in element.written}


def full(graph: Graph) -> Delta:
    """All that a replica holds."""
    return reply_to(graph.store, CausalContext())


def copied(graph: Graph) -> Graph:
    """A replica with the same content and no readers."""
    twin: Graph = copy.deepcopy(graph, {id(graph.watches): _Readers(), id(TOMBSTONE): TOMBSTONE})
    return twin
