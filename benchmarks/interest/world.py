"""Memories that each hold some parts of a graph, and change their minds, on a faulty network."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.interest.claimant import Claimant, Kind
from benchmarks.years.showing import shown
from benchmarks.years.world import Participant, SkewedClock, World, type_for
from dsr import Faults, Memory
from dsr.crdt.context import CausalContext
from dsr.crdt.delta import Delta
from dsr.crdt.store import Store
from dsr.graph.schema import RECORDS
from dsr.network.keys import WHOLE
from dsr.parts.graph import PartedGraph
from dsr.replication.pace import DIGEST_PERIOD
from dsr.replication.peers import FORGET
from dsr.replication.portions import parts_in, portion
from dsr.replication.replica import Replica

PARTS = ("kitchen", "hall", "lab")
LIAR = "liar"
SETTLED = FORGET + 15.0
"""s after which each part must be complete whoever lies: all were asked, and none is waited for any more"""


class PartsWorld(World):
    """A `World` whose memories hold parts: what each holds must be what all that reached its holders comes to.

    Args:
        places: how many memories there are.
        seed: of the faults.
        faults: of the network.
        lie: what an agent does that claims to hold all parts; None if there is none.
    """

    def __init__(self, places: int, seed: int = 0, faults: Faults | None = None, lie: Kind | None = None) -> None:
        self._writing = False
        self._liar: Claimant | None = None
        self._spoke_at = 0.0
        super().__init__([0.0] * places, seed, faults)
        if lie is not None:
            self._liar = Claimant(lie, self.network.connect(LIAR), self.clock, "g", f"{LIAR}-1", PARTS)
        for part in PARTS:
            self.memory(0).create_part(part)
        for _ in range(20):
            self.advance(0.1)

    def _connected(self, index: int, clock: SkewedClock) -> Memory:
        transport = self.network.connect(str(index))
        memory = Memory(
            "g", f"r{index}", transport=transport, clock=clock, rid=self.new_rid(self._boots), interest=()
        )
        held = memory._held
        assert held is not None
        take = held.take

        def taken(part: str) -> Replica:
            known = part in held.replicas
            replica = take(part)
            if not known:
                commit = replica.commit

                def noted(delta: Delta) -> None:
                    self._note(delta)
                    commit(delta)

                replica.commit = noted  # type: ignore[method-assign]
            return replica

        held.take = taken  # type: ignore[method-assign]
        return memory

    def _note(self, delta: Delta) -> None:
        """What is of one part may arrive without the rest. What no user removed must be over anyway."""
        for part in parts_in(delta):
            super()._note(portion(delta, part))
        if not self._writing:
            removed = {dot for each in self.committed for dot in each.removed}
            for add in [add for each in self.committed for add in each.adds if add.dot in delta.removed]:
                ends = (add.sources, add.destinations)
                assert any(end and removed.issuperset(end) for end in ends), f"{add.key} is buried alive"

    def _write(self, index: int, write: Callable[[Memory], object]) -> None:
        self._writing = True
        try:
            super()._write(index, write)
        finally:
            self._writing = False

    # ---- what users do

    def hold(self, index: int, part: str) -> None:
        """Ask for a part, if the list of parts has reached the place."""
        memory = self.memory(index)
        if part in {info.name for info in memory.parts()}:
            assert memory._held is not None
            memory._held.take(part)

    def leave(self, index: int, part: str) -> None:
        """Hold a part no more; what had not arrived anywhere is gone with it."""
        memory = self.memory(index)
        if part in memory.interest:
            assert memory._held is not None
            self.dead.add(memory._held.replicas[part].graph.rid)
            memory.leave_part(part)

    def add_in(self, index: int, part: str, name: str, type: str, value: int) -> None:
        """Add a node in a part that is held, or write to it where it is."""
        memory = self.memory(index)
        where = None if name in memory or part not in ("", *memory.interest) else part
        self._write(index, lambda memory: memory.add_node(name, type_for(memory, name, type), where, seen=value))

    def crash(self, index: int, *, restore: bool = False) -> None:
        """See `World.crash`; a process asks again for what it had asked for."""
        old = self.participants[index % len(self.participants)].memory
        assert old._held is not None
        self.dead |= {replica.graph.rid for replica in old._held.replicas.values()}
        interest, snapshot = old.interest, old.snapshot()
        super().crash(index)
        memory = self.memory(index)
        assert memory._held is not None
        for part in interest:
            memory._held.take(part)
        if restore:
            memory.restore(snapshot)

    def advance(self, seconds: float) -> None:
        """Let time pass; who lies speaks, too."""
        if self._liar is not None and self.clock.monotonic() - self._spoke_at >= DIGEST_PERIOD:
            self._spoke_at = self.clock.monotonic()
            self._liar.speak()
        super().advance(seconds)

    def converge(self) -> None:
        """See `World.converge`; whoever lies, each part is complete then at all who hold it, as far as one can know."""
        super().converge()
        if self._liar is None:
            return  # who is dead is still waited for: it was not stopped or cut off for long
        for _ in range(round(SETTLED / 0.1)):
            self.advance(0.1)
        for participant in self.participants:
            assert participant.memory.joined, "a part is waited for that nobody has more of"

    def waiting(self) -> int:
        """Edges that are kept, and not shown, because a part is not held."""
        return sum(len(edges) for each in self.participants for edges in _graph(each)._beyond.values())

    # ---- what must be so

    def check_converged(self) -> None:
        """Each part is equal at all who hold it; each shows what the plain model makes of all that it holds."""
        for part in (WHOLE, *PARTS):
            stores = [store for each in self.participants if (store := _store(each, part)) is not None]
            for store in stores:
                assert _state(store) == _state(stores[0]), f"replicas of part {part!r} differ"
                assert set(store.context.cloud) <= self.dead, "a hole that is never closed"
        for participant in self.participants:
            self._check_shown(participant)

    def _check_shown(self, participant: Participant) -> None:
        graph = _graph(participant)
        entries = {dot for member in graph.members() for dot in member.store.entries}
        expected = self._expected(CausalContext(graph.contexts()), entries).shown()
        assert shown(graph) == expected, "it shows something else than the whole shows there"
        told = {key: element for key, element in expected.items() if element[0] not in RECORDS}
        assert participant.reader.read(graph) == told, "a reader knows something else"
        for member in graph.members():
            assert member.store.context.vector.get(member.rid, 0) == member.counter
            assert all(w.dot for e in member.store.entries.values() for w in e.registers.values()), "not durable"
        assert not participant.memory.dropped and not graph._condemned
        self._check_buried(graph)

    def _check_buried(self, graph: PartedGraph) -> None:
        """No edge is kept of which this process knows that an end is gone for good."""
        for member in graph.members():
            for entry in member.store.entries.values():
                assert isinstance(entry.key, str) or not graph._is_dead(entry), f"{entry.key} is kept"


def _graph(participant: Participant) -> PartedGraph:
    graph = participant.memory._graph
    assert isinstance(graph, PartedGraph)
    return graph


def _store(participant: Participant, part: str) -> Store | None:
    graph = _graph(participant)
    if part == WHOLE:
        return graph.store
    return graph.parts[part].store if part in graph.parts else None


def _state(store: Store) -> object:
    entries = {dot: (e.key, e.type, e.sources, e.destinations, e.registers) for dot, e in store.entries.items()}
    return store.context, entries, store.fingerprint
