"""Memories on a faulty network, each with a clock of its own, and what must be left of what they did."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable, Container
from dataclasses import dataclass, field

from benchmarks.years.knowledge import Knowledge, facts_of
from benchmarks.years.readers import Reader
from benchmarks.years.showing import shown, state
from dsr import ClockDriftError, CycleError, Faults, LocalNetwork, ManualClock, Memory, Pose
from dsr.crdt.context import CausalContext, Dot
from dsr.crdt.delta import Delta, EdgeKey, Write
from dsr.graph.schema import RECORDS
from dsr.network.keys import Keys
from dsr.network.transport import Qos
from dsr.replication.peers import FORGET
from dsr.replication.sync import MAX_DRIFT
from dsr.replication.wire import Digest, encode_delta, encode_digest

FORGER = "forger"
"""Agent of a raw peer that sends any stamp, and says that other clocks are wrong, under any number of replica ids."""
CATCH_UP = 12.0
"""s after which everybody must have everything."""


@dataclass
class SkewedClock:
    """A clock of which the physical time, but not the pace, is off by `skew` s."""

    true: ManualClock
    skew: float

    def now(self) -> float:
        """Seconds since the Unix epoch, as this clock has them."""
        return self.true.now() + self.skew

    def monotonic(self) -> float:
        """See `Clock.monotonic`."""
        return self.true.monotonic()

    def wait(self, event: threading.Event, timeout: float) -> bool:
        """See `Clock.wait`."""
        return self.true.wait(event, timeout)


@dataclass
class Participant:
    """A place in the network: the memory that runs there now, and what it was seen to know."""

    place: int
    memory: Memory
    clock: SkewedClock
    reader: Reader
    context: CausalContext = field(default_factory=CausalContext)
    newest: dict[tuple[Dot, str], tuple[int, str]] = field(default_factory=dict)
    """(stamp, writer) of each register."""

    def check(self) -> None:
        """No edge dangles; nothing that was known is forgotten, samples of streams included."""
        graph = self.memory._graph
        for edge in graph.edges.values():
            assert edge.src in graph.nodes and edge.dst in graph.nodes, f"{edge} dangles"
        assert graph.store.context.covers(self.context), "dots were forgotten"
        self.context = CausalContext(graph.store.context.ranges())
        entries = graph.store.entries.values()
        newest = {(e.dot, name): (w.stamp, w.writer) for e in entries for name, w in e.registers.items()}
        for register, known in self.newest.items():
            assert newest.get(register, known) >= known, "a value was taken back"
        self.newest = newest


class World:
    """Memories on one network, and everything that any of them ever committed."""

    def __init__(self, skews: list[float], seed: int = 0, faults: Faults | None = None) -> None:
        self.clock = ManualClock()
        self.network = LocalNetwork(self.clock, seed=seed, faults=faults)
        self.committed: list[Delta] = []
        self.dead: set[str] = {f"{FORGER}-1"}
        """Replicas of which something may be missing for good."""
        self.forger = self.network.connect(FORGER)
        self._forged = 0
        self._blamed = False
        """Whether there are made-up replicas, which are asked until they are forgotten."""
        self._skews = set(skews)
        self._boots = 0
        self.participants = [self._boot(index, skew) for index, skew in enumerate(skews)]

    def _boot(self, index: int, skew: float) -> Participant:
        self._boots += 1
        clock = SkewedClock(self.clock, skew)
        memory = self._connected(index, clock)
        commit = memory._replica.commit

        def noted(delta: Delta) -> None:
            self._note(delta)
            commit(delta)

        memory._replica.commit = noted  # type: ignore[method-assign]
        return Participant(index, memory, clock, Reader(memory.watch()))

    def _note(self, delta: Delta) -> None:
        """Take down what a memory commits."""
        self.committed.append(Delta(list(delta.adds), list(delta.writes), list(delta.removed), list(delta.context)))

    def _connected(self, index: int, clock: SkewedClock) -> Memory:
        """A new memory of a place on the network."""
        transport = self.network.connect(str(index))
        return Memory("g", f"r{index}", transport=transport, clock=clock, rid=self.new_rid(self._boots))

    def new_rid(self, boot: int) -> str:
        """The replica id of a start: never the same twice."""
        return f"r{boot}-1"

    def memory(self, index: int) -> Memory:
        """The memory of a place."""
        return self.participants[index % len(self.participants)].memory

    def a_node(self, index: int, choice: int) -> str | None:
        """One of the nodes that a memory shows; None if it shows none."""
        names = sorted(node.name for node in self.memory(index).nodes())
        return names[choice % len(names)] if names else None

    def an_edge(self, index: int, choice: int) -> EdgeKey | None:
        """One of the edges that a memory shows; None if it shows none."""
        keys = sorted(edge.key for edge in self.memory(index).edges())
        return keys[choice % len(keys)] if keys else None

    # ---- what users do

    def add_node(self, index: int, name: str, type: str, value: int) -> None:
        """Add a node, under the type that it has there if it is there."""
        self._write(index, lambda memory: memory.add_node(name, type_for(memory, name, type), seen=value))

    def update_node(self, index: int, name: str, value: int) -> None:
        """Write two attributes of a node."""
        self._write(index, lambda memory: memory.update_node(name, seen=value, mass=float(value)))

    def remove_attribute(self, index: int, name: str, attribute: str) -> None:
        """Take an attribute of a node away."""
        self._write(index, lambda memory: memory.remove_attribute(name, attribute))

    def add_edge(self, index: int, key: EdgeKey, x: int) -> None:
        """Edges that close a cycle come from replicas that do not know of each other's."""
        with contextlib.suppress(CycleError):
            self._write(index, lambda memory: memory.add_edge(*key, pose=Pose((x, 0, 0)), since=float(x)))

    def stream(self, index: int, key: EdgeKey, x: int) -> None:
        """Write a pose as a sample of a stream."""
        self._write(index, lambda memory: memory.update_edge(*key, pose=Pose((x, 1, 0))))

    def remove_node(self, index: int, name: str) -> None:
        """Remove a node with its edges."""
        self._write(index, lambda memory: memory.remove_node(name))

    def remove_edge(self, index: int, key: EdgeKey) -> None:
        """Remove an edge."""
        self._write(index, lambda memory: memory.remove_edge(*key))

    def batch(self, index: int, names: list[str], value: int) -> None:
        """Add and write several nodes in one message."""
        def write(memory: Memory) -> None:
            with memory.batch():
                for name in names:
                    memory.add_node(name, type_for(memory, name, "cube"), seen=value)
                    memory.update_node(name, mass=float(value))

        self._write(index, write)

    def forge(self, index: int, name: str, stamp: int, value: int, *, durable: bool) -> None:
        """The raw peer stamps a value of a node that a memory shows as it likes."""
        owner = self.memory(index).node(name).created[0]
        self._forged += 1
        rid = f"{FORGER}-1"
        dot = (rid, self._forged) if durable else None
        write = Write(owner, "seen", stamp, f"{rid}.{self._forged}", dot, value)
        delta = Delta(writes=[write], context=[(*dot, dot[1])] if dot else [])
        self.committed.append(delta)
        key = Keys("g").delta(rid) if durable else Keys("g").stream(rid)
        self.forger.publish(key, encode_delta(delta))

    def blame(self, index: int, replicas: int) -> None:
        """The raw peer says, as several replicas, that it sees a memory's clock in its future."""
        self._blamed = True
        victim = self.memory(index).rid
        for number in range(replicas):
            digest = Digest(f"{FORGER}-{number}", self.clock.now(), CausalContext().summary(), 0, (victim,))
            self.forger.publish(Keys("g").digest(digest.replica), encode_digest(digest), Qos.STREAM)

    def clean(self, index: int) -> None:
        """Make anew what has a stamp of the far future; what is shown stays."""
        memory = self.memory(index)
        before = shown(memory._graph)

        def clean(memory: Memory) -> None:
            memory.clean_stamps()
            assert not memory.far_stamps() and shown(memory._graph) == before

        self._write(index, clean)

    def _write(self, index: int, write: Callable[[Memory], object]) -> None:
        """A memory whose clock is ahead refuses, and nothing changes."""
        memory = self.memory(index)
        before, counter, committed = state(memory._graph), memory._graph.counter, len(self.committed)
        try:
            write(memory)
        except ClockDriftError:
            assert max(self._skews) - min(self._skews) > MAX_DRIFT, "nobody's clock was off, and one agent said so"
            assert state(memory._graph) == before and memory._graph.counter == counter
            assert len(self.committed) == committed
        memory.flush()

    # ---- what happens to them

    def advance(self, seconds: float) -> None:
        """Let time pass, and everybody do what is due then."""
        self.clock.advance(seconds)
        self.deliver()

    def deliver(self) -> None:
        """Let everybody send, and merge what arrives."""
        for participant in self.participants:
            participant.memory.flush()
        self.network.deliver()
        for participant in self.participants:
            participant.memory.poll()
            participant.memory.flush()

    def partition(self, mask: int) -> None:
        """Divide the network by the bits of `mask`."""
        names = [str(index) for index in range(len(self.participants))]
        self.network.partition([n for n in names if mask >> int(n) & 1], [n for n in names if not mask >> int(n) & 1])

    def heal(self) -> None:
        """Let everybody reach everybody again."""
        self.network.heal()

    def set_clock(self, index: int, skew: float) -> None:
        """Set the clock of a place, s from the true time."""
        self.participants[index % len(self.participants)].clock.skew = skew
        self._skews.add(skew)

    def crash(self, index: int, *, restore: bool = False) -> None:
        """Kill a memory without a goodbye; another one starts in its place, from a snapshot if wanted."""
        index %= len(self.participants)
        old = self.participants[index]
        self.dead.add(old.memory.rid)
        snapshot = old.memory.snapshot()
        old.memory.transport.close()
        self.participants[index] = self._boot(index, old.clock.skew)
        if restore:
            self.participants[index].memory.restore(snapshot)

    # ---- what must be so

    def check(self) -> None:
        """What must hold at every moment."""
        for participant in self.participants:
            participant.check()

    def converge(self) -> None:
        """Heal the network and give everybody the time to catch up."""
        self.network.heal()
        self.network.faults = Faults()
        for _ in range(round(FORGET / 0.5) if self._blamed else 0):
            self.advance(0.5)
        self.catch_up()
        self.check()

    def catch_up(self) -> None:
        """Give everybody the time to catch up."""
        for _ in range(round(CATCH_UP / 0.1)):
            self.advance(0.1)

    def check_converged(self) -> None:
        """All are equal to what the model makes of what reached the survivors; no hole is left but of the dead."""
        first = self.participants[0].memory._graph
        expected = self._expected(first.store.context, first.store.entries).shown()
        for participant in self.participants:
            graph = participant.memory._graph
            assert state(graph) == state(first), "replicas differ"
            assert shown(graph) == expected, "the replicas agree on something wrong"
            told = {key: element for key, element in expected.items() if element[0] not in RECORDS}
            assert participant.reader.read(graph) == told, "a reader knows something else"
            assert set(graph.store.context.cloud) <= self.dead, "a hole that is never closed"
            assert graph.store.context.vector.get(graph.rid, 0) == graph.counter
            assert all(r.dot for e in graph.store.entries.values() for r in e.registers.values()), "not durable"
            assert not participant.memory.dropped
        self._check_drift()

    def _expected(self, seen: CausalContext, held: Container[Dot]) -> Knowledge:
        """What those know who have seen these dots; all samples of streams have dots by now.

        A removal of a dead replica may have reached newcomers alone, who do as it says and leave it unaccounted for.
        Then it holds if they do not hold any more what it removed. Of several incarnations of a node some may be left,
        though an edge went with all of them.
        """
        known, by_the_dead = Knowledge(), set[Dot]()
        for delta in self.committed:
            facts = facts_of(delta)
            durable = {(w.owner, w.attribute, w.stamp, w.writer) for w in delta.writes if w.dot and w.dot in seen}
            known.added |= {dot: add for dot, add in facts.added.items() if dot in seen}
            known.written |= {fact: value for fact, value in facts.written.items() if fact in durable}
            if all(last in seen for last in _lasts(delta)):  # it is accounted for
                known.removed |= facts.removed
            elif all(rid in self.dead for rid, _ in _lasts(delta)) and not all(map(held.__contains__, facts.removed)):
                by_the_dead |= facts.removed
        over = known.added.keys() - Knowledge(known.added, known.removed | by_the_dead).held()
        known.removed |= {dot for dot in over if dot not in held}
        return known

    def _check_drift(self) -> None:
        """Who most others see in their future, and nobody else, refuses to write."""
        skews = [participant.clock.skew for participant in self.participants]
        for index, skew in enumerate(skews):
            leads = [skew - other for place, other in enumerate(skews) if place != index]
            if not any(MAX_DRIFT < abs(lead) < MAX_DRIFT + 0.2 for lead in leads):  # a digest is up to 0.1 s under way
                slower, faster = (sum(sign * lead > MAX_DRIFT for lead in leads) for sign in (1, -1))
                clocks = self.memory(index)._replica.synchroniser.clocks
                assert clocks.is_ahead == (slower > 1 and 2 * slower > len(leads)), f"clocks {skews}, replica {index}"
                assert clocks.is_behind == (faster > 1 and 2 * faster > len(leads)), f"clocks {skews}, replica {index}"
                assert (clocks.kind == "") == (slower == faster == 0), f"clocks {skews}, replica {index}"


def _lasts(delta: Delta) -> list[Dot]:
    return [(rid, last) for rid, _, last in delta.context]


class Complaints(logging.Handler):
    """Collects what the memories call an error."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.said: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """See `logging.Handler`."""
        self.said.append(record.getMessage())


def type_for(memory: Memory, name: str, wanted: str) -> str:
    """The type under which a node can be added: the present one if it is there."""
    there = memory.get_node(name)
    return wanted if there is None else there.type
