"""Random histories over several replicas, run against a plain model of what must come out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from dsr import Faults, LocalNetwork, ManualClock, Memory, Pose
from dsr.crdt.context import Dot
from dsr.crdt.delta import Delta

NAMES = ("a", "b", "c")
Operation = tuple[Any, ...]


@dataclass
class Model:
    """All that ever happened, whoever has heard of it: what a replica that knows everything must show."""

    created: dict[Dot, Any] = field(default_factory=dict)
    """Key by creation dot."""
    ends: dict[Dot, tuple[tuple[Dot, ...], tuple[Dot, ...]]] = field(default_factory=dict)
    removed: set[Dot] = field(default_factory=set)
    values: dict[tuple[Dot, str], tuple[int, str, Any]] = field(default_factory=dict)

    def note(self, delta: Delta) -> None:
        """Take note of what a replica did."""
        for add in delta.adds:
            self.created[add.dot] = add.key
            self.ends[add.dot] = (add.sources, add.destinations)
        self.removed.update(delta.removed)
        for write in delta.writes:
            register = (write.stamp, write.writer, write.value)
            owner = (write.owner, write.attribute)
            self.values[owner] = max(self.values.get(owner, (0, "", None)), register, key=lambda r: r[:2])

    def visible(self) -> dict[Any, dict[str, Any]]:
        """Attributes of every key that must be visible."""
        live = {dot for dot in self.created if dot not in self.removed}
        shown = [
            dot for dot in live
            if isinstance(self.created[dot], str) or all(any(d in live for d in side) for side in self.ends[dot])
        ]  # fmt: skip
        result: dict[Any, dict[str, tuple[int, str, Any]]] = {}
        for dot in shown:
            attributes = result.setdefault(self.created[dot], {})
            for (owner, name), register in self.values.items():
                if owner == dot:
                    attributes[name] = max(attributes.get(name, register), register, key=lambda r: r[:2])
        return {key: {name: r[2] for name, r in attributes.items()} for key, attributes in result.items()}


class World:
    """Replicas on a faulty network, and the model."""

    def __init__(self, replicas: int, seed: int = 0, faults: Faults | None = None) -> None:
        self.clock = ManualClock()
        self.network = LocalNetwork(self.clock, seed=seed, faults=faults)
        self.model = Model()
        self.crashed = False
        self._boots = 0
        self.memories = [self._boot(index) for index in range(replicas)]

    def _boot(self, index: int) -> Memory:
        self._boots += 1
        transport = self.network.connect(str(index))
        return Memory("g", f"r{index}", transport=transport, clock=self.clock, rid=f"r{index}-{self._boots}")

    def run(self, operations: Sequence[Operation]) -> None:
        """Perform operations; those that make no sense at that moment do nothing."""
        for name, *arguments in operations:
            getattr(self, f"do_{name}")(*arguments)
            self.check_invariants()

    def check_invariants(self) -> None:
        """What must hold in every replica at every moment."""
        for memory in self.memories:
            for edge in memory.edges():
                assert edge.src in memory and edge.dst in memory, f"{edge} dangles"

    def quiesce(self) -> None:
        """Heal the network and give everybody the time to catch up."""
        self.network.heal()
        self.network.faults = Faults()
        for _ in range(120):
            self.do_advance(0.1)
        self.check_invariants()

    def do_add(self, replica: int, name: str, value: int) -> None:
        memory = self._memory(replica)
        self._apply(memory, memory._graph.add_node(name, "cube", {"seen": value}, self.clock.now()))

    def do_write(self, replica: int, name: str, value: int) -> None:
        memory = self._memory(replica)
        node = memory.get_node(name)
        if node is not None:
            self._apply(memory, memory._graph.write(node, {"seen": value}, self.clock.now()))

    def do_clear(self, replica: int, name: str) -> None:
        memory = self._memory(replica)
        node = memory.get_node(name)
        if node is not None:
            self._apply(memory, memory._graph.remove_attribute(node, "seen", self.clock.now()))

    def do_link(self, replica: int, src: str, dst: str, x: int) -> None:
        memory = self._memory(replica)
        if src in memory and dst in memory:
            values = {"pose": Pose((x, 0, 0))}
            self._apply(memory, memory._graph.add_edge(src, dst, "RT", values, self.clock.now()))

    def do_stream(self, replica: int, src: str, dst: str, x: int) -> None:
        memory = self._memory(replica)
        edge = memory.get_edge(src, dst, "RT")
        if edge is not None:
            self._apply(memory, memory._graph.write(edge, {"pose": Pose((x, 1, 0))}, self.clock.now()))

    def do_unlink(self, replica: int, src: str, dst: str) -> None:
        memory = self._memory(replica)
        self._apply(memory, memory._graph.remove_edge((src, dst, "RT")))

    def do_remove(self, replica: int, name: str) -> None:
        memory = self._memory(replica)
        self._apply(memory, memory._graph.remove_node(name))

    def do_advance(self, seconds: float) -> None:
        self.clock.advance(seconds)
        self.do_deliver()

    def do_deliver(self) -> None:
        for memory in self.memories:
            memory.flush()
        self.network.deliver()
        for memory in self.memories:
            memory.poll()
            memory.flush()

    def do_partition(self, mask: int) -> None:
        names = [str(index) for index in range(len(self.memories))]
        self.network.partition([n for n in names if mask >> int(n) & 1], [n for n in names if not mask >> int(n) & 1])

    def do_heal(self) -> None:
        self.network.heal()

    def do_crash(self, replica: int) -> None:
        """Kill a replica without a goodbye; another one starts in its place."""
        index = replica % len(self.memories)
        self.memories[index].transport.close()
        self.memories[index] = self._boot(index)
        self.crashed = True

    def _memory(self, replica: int) -> Memory:
        return self.memories[replica % len(self.memories)]

    def _apply(self, memory: Memory, delta: Delta) -> None:
        self.model.note(delta)
        memory._replica.commit(delta)
        memory.flush()


def shown(memory: Memory) -> dict[Any, dict[str, Any]]:
    """Everything that a replica shows."""
    elements: dict[Any, dict[str, Any]] = {node.name: dict(node) for node in memory.nodes()}
    elements.update({edge.key: dict(edge) for edge in memory.edges()})
    return elements


def expected(model: Model) -> dict[Any, dict[str, Any]]:
    """What the model shows, without attributes that were taken away."""
    from dsr.crdt.delta import TOMBSTONE

    visible = model.visible()
    return {key: {n: v for n, v in values.items() if v is not TOMBSTONE} for key, values in visible.items()}


def check_history(
    operations: Sequence[Operation], *, replicas: int, seed: int = 0, faults: Faults | None = None
) -> World:
    """Run a history, let everybody catch up, and compare all replicas with each other and with the model."""
    world = World(replicas, seed, faults)
    world.run(operations)
    world.quiesce()
    first = shown(world.memories[0])
    for memory in world.memories[1:]:
        assert shown(memory) == first, "the replicas differ"
        assert memory._graph.store.context == world.memories[0]._graph.store.context
        assert memory._graph.store.fingerprint == world.memories[0]._graph.store.fingerprint
        assert set(memory._graph.store.entries) == set(world.memories[0]._graph.store.entries)
    if not world.crashed:
        assert first == expected(world.model), "the replicas agree on something wrong"
        assert not world.memories[0]._graph.store.context.cloud, "the context did not compact"
    return world
