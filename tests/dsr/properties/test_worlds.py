"""Random histories of worlds on a network that loses, repeats, delays and cuts.

At the end all replicas of a world are equal; what was written into a deleted world shows in no other one, whoever wrote
it and however late; and nobody publishes, subscribes or answers under the keys of worlds that are gone.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from dsr import (
    CycleError,
    Faults,
    LocalNetwork,
    ManualClock,
    Memory,
    Pose,
    TransportError,
    WorldError,
    WorldNotFoundError,
)
from dsr.network.keys import Keys
from dsr.network.local_transport import LocalTransport
from dsr.worlds.registry import records
from tests.dsr.properties.soup import shown, state
from tests.dsr.properties.test_deltas import choices, numbers
from tests.dsr.properties.test_memories import faults
from tests.dsr.properties.world import CATCH_UP, Complaints

NAMES = ("w", "v")
THINGS = ("a", "b", "c")
HERE = (WorldError, WorldNotFoundError, TransportError)
"""What may be said of worlds of which one does not know what others have done."""
sites = st.integers(0, 3)
worlds = st.sampled_from(["base", *NAMES])
names = st.sampled_from(NAMES)
things = st.sampled_from(THINGS)


def declared(transport: LocalTransport) -> set[str]:
    """All keys under which a process takes part in anything."""
    patterns = [*transport._subscribers, *transport._servers, *transport._presence]
    return {*(key for key, _ in patterns), *transport.tokens}


class Network:
    """Processes, each with a memory and the worlds that it has opened."""

    def __init__(self, processes: int, seed: int, network: Faults) -> None:
        self.clock = ManualClock()
        self.network = LocalNetwork(self.clock, seed=seed, faults=network)
        self._boots = 0
        self.memories = [self._boot(index) for index in range(processes)]
        self.together: dict[str, str] = {}
        """Channels that were one world at some time, each with another one of it; itself for the first."""

    def _boot(self, index: int) -> Memory:
        self._boots += 1
        transport = self.network.connect(str(index))
        return Memory("g", f"r{index}", transport=transport, clock=self.clock, rid=f"r{index}-{self._boots}")

    def memory(self, index: int) -> Memory:
        return self.memories[index % len(self.memories)]

    def opened(self, index: int, world: str) -> Memory | None:
        """The world as this process has it open."""
        return next((memory for memory in self.memory(index).opened_worlds() if memory.world_name == world), None)

    def note(self) -> None:
        """Take down which channels are one world: those that one record has ever been made of."""
        for memory in self.memories:
            for record in records(memory.replica.graph):
                channels = [f"{dot[0]}:{dot[1]}" for dot in sorted(record.dots)]
                for channel in channels:
                    self.together[self.root(channel)] = self.root(channels[0])

    def root(self, channel: str) -> str:
        while self.together.setdefault(channel, channel) != channel:
            channel = self.together[channel]
        return channel

    def marks(self, memory: Memory) -> set[str]:
        """What things are marked with that are written into this world; see `together`."""
        record = next((r for r in records(self.memories[0].replica.graph) if r.info.name == memory.world_name), None)
        return {self.root(f"{dot[0]}:{dot[1]}") for dot in record.dots} if record else set()

    def advance(self, seconds: float) -> None:
        self.clock.advance(seconds)
        for memory in self.memories:
            memory.flush()
        self.network.deliver()
        for memory in self.memories:
            memory.poll()
            memory.flush()
        self.note()

    def crash(self, index: int) -> None:
        index %= len(self.memories)
        self.memories[index].transport.close()
        self.memories[index] = self._boot(index)

    def converge(self) -> None:
        self.network.heal()
        self.network.faults = Faults()
        for _ in range(round(CATCH_UP / 0.2)):
            self.advance(0.2)

    # ---- what must be so

    def check(self) -> None:
        """Nobody has a world open that is not in its list, nor takes part in anything under its keys."""
        for memory in self.memories:
            listed = memory.world_channels()
            roots = [Keys("g").root + "/world/"] + [
                Keys("g", name, channel).state + "/" for name, channel in listed.items()
            ]
            for opened in memory.opened_worlds()[1:]:
                assert opened.world_name in listed and not opened.closed
            assert isinstance(memory.transport, LocalTransport)
            for key in declared(memory.transport):
                assert not key.startswith(roots[0]) or any(key.startswith(root) for root in roots[1:]), f"{key} is left"

    def check_converged(self) -> None:
        """All replicas of each world are equal, and hold nothing of worlds that are gone."""
        first = self.memories[0]
        listed = {info.name: info for info in first.worlds()}
        assert all(memory.worlds() == list(listed.values()) for memory in self.memories)
        for name, info in listed.items():
            replicas = [found for index in range(len(self.memories)) if (found := self.opened(index, name))]
            for replica in replicas:
                if not info.follows:
                    assert state(replica._graph) == state(replicas[0]._graph), f"replicas of {name} differ"
                elif info.parent == "base":
                    assert shown(replica._graph) == shown(replicas[0]._graph), f"replicas of {name} differ"
                for node in replica.nodes():
                    where, _, channel = str(node.get("note", "")).partition("@")
                    assert where != name or name == "base" or self.root(channel) in self.marks(replica), "resurrected"


class Worlds(RuleBasedStateMachine):
    """Whatever happens: equal worlds, and nothing of those that are gone."""

    @initialize(processes=st.integers(2, 3), seed=st.integers(0, 2**16), network=faults)
    def begin(self, processes: int, seed: int, network: Faults) -> None:
        self.complaints = Complaints()
        logging.getLogger("dsr").addHandler(self.complaints)
        self.net = Network(processes, seed, network)

    @rule(site=sites, name=names, how=st.sampled_from(["create", "fork", "overlay"]), of=worlds, exist_ok=st.booleans())
    def make(self, site: int, name: str, how: str, of: str, exist_ok: bool) -> None:
        memory = self.net.memory(site)
        with contextlib.suppress(*HERE):
            if how == "create":
                memory.create_world(name, exist_ok=exist_ok)
            else:
                memory.fork(name, of=of, follow=how == "overlay")
        self.net.note()

    @rule(site=sites, name=names)
    def open(self, site: int, name: str) -> None:
        with contextlib.suppress(*HERE):
            self.net.memory(site).world(name)

    @rule(site=sites, name=names)
    def delete(self, site: int, name: str) -> None:
        with contextlib.suppress(*HERE):
            self.net.memory(site).delete_world(name)

    @rule(site=sites, world=worlds, thing=things, value=numbers)
    def add(self, site: int, world: str, thing: str, value: int) -> None:
        self._write(site, world, lambda memory: memory.add_node(thing, "cube", seen=value, note=self._mark(memory)))

    @rule(site=sites, world=worlds, thing=things, value=numbers)
    def update(self, site: int, world: str, thing: str, value: int) -> None:
        def write(memory: Memory) -> None:
            if thing in memory:
                memory.update_node(thing, mass=float(value))

        self._write(site, world, write)

    @rule(site=sites, world=worlds, ends=st.tuples(things, things), x=numbers)
    def hang(self, site: int, world: str, ends: tuple[str, str], x: int) -> None:
        def write(memory: Memory) -> None:
            if all(end in memory for end in ends):
                with contextlib.suppress(CycleError):
                    memory.add_edge(*ends, "RT", pose=Pose((x, 0, 0)))

        self._write(site, world, write)

    @rule(site=sites, world=worlds, thing=things)
    def remove(self, site: int, world: str, thing: str) -> None:
        self._write(site, world, lambda memory: memory.remove_node(thing))

    @rule(seconds=st.sampled_from([0.0, 0.05, 0.3, 1.1]), choice=choices)
    def advance(self, seconds: float, choice: int) -> None:
        for _ in range(1 + choice % 3):
            self.net.advance(seconds)

    @rule(mask=st.integers(0, 7))
    def partition(self, mask: int) -> None:
        everybody = [str(index) for index in range(len(self.net.memories))]
        here = [name for name in everybody if mask >> int(name) & 1]
        self.net.network.partition(here, [name for name in everybody if name not in here])

    @rule()
    def heal(self) -> None:
        self.net.network.heal()

    @rule(site=sites)
    def crash(self, site: int) -> None:
        self.net.crash(site)

    @invariant()
    def nothing_is_left_of_what_is_gone(self) -> None:
        if hasattr(self, "net"):
            for memory in self.net.memories:
                memory._worlds.sweep()
            self.net.check()

    def teardown(self) -> None:
        if hasattr(self, "net"):
            logging.getLogger("dsr").removeHandler(self.complaints)
            self.net.converge()
            self.net.check()
            self.net.check_converged()
            assert not self.complaints.said

    def _write(self, site: int, world: str, write: Callable[[Memory], object]) -> None:
        memory = self.net.opened(site, world)
        if memory is not None:
            write(memory)
            memory.flush()

    def _mark(self, memory: Memory) -> str:
        """Name of the world and one of the channels that it is, as it is known here."""
        if memory.world_handle is None:
            return "base@"
        rid, counter = min(memory.world_handle.record.dots)
        return f"{memory.world_name}@{rid}:{counter}"


Worlds.TestCase.settings = settings(
    max_examples=60, stateful_step_count=30, deadline=None, report_multiple_bugs=False
)  # fmt: skip
TestWorlds = Worlds.TestCase
