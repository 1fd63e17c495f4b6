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

from benchmarks.years.world import CATCH_UP, Complaints
from benchmarks.years.worlds import HERE, WorldsInSeveral, mark
from dsr import (
    CycleError,
    Faults,
    LocalNetwork,
    ManualClock,
    Memory,
    Pose,
)
from tests.dsr.properties.machine import faults
from tests.dsr.properties.test_deltas import choices, numbers

NAMES = ("w", "v")
THINGS = ("a", "b", "c")
sites = st.integers(0, 3)
worlds = st.sampled_from(["base", *NAMES])
names = st.sampled_from(NAMES)
things = st.sampled_from(THINGS)


class Network:
    """Processes, each with a memory and the worlds that it has opened."""

    def __init__(self, processes: int, seed: int, network: Faults) -> None:
        self.clock = ManualClock()
        self.network = LocalNetwork(self.clock, seed=seed, faults=network)
        self._boots = 0
        self.memories = [self._boot(index) for index in range(processes)]
        self.worlds = WorldsInSeveral(lambda: self.memories)

    def _boot(self, index: int) -> Memory:
        self._boots += 1
        transport = self.network.connect(str(index))
        return Memory("g", f"r{index}", transport=transport, clock=self.clock, rid=f"r{index}-{self._boots}")

    def memory(self, index: int) -> Memory:
        return self.memories[index % len(self.memories)]

    def opened(self, index: int, world: str) -> Memory | None:
        """The world as this process has it open."""
        return next((memory for memory in self.memory(index).opened_worlds() if memory.world_name == world), None)

    def advance(self, seconds: float) -> None:
        self.clock.advance(seconds)
        for memory in self.memories:
            memory.flush()
        self.network.deliver()
        for memory in self.memories:
            memory.poll()
            memory.flush()
        self.worlds.note()

    def crash(self, index: int) -> None:
        index %= len(self.memories)
        self.memories[index].transport.close()
        self.memories[index] = self._boot(index)

    def converge(self) -> None:
        self.network.heal()
        self.network.faults = Faults()
        for _ in range(round(CATCH_UP / 0.2)):
            self.advance(0.2)


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
        self.net.worlds.note()

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
        self._write(site, world, lambda memory: memory.add_node(thing, "cube", seen=value, note=mark(memory)))

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
            self.net.worlds.check()

    def teardown(self) -> None:
        if hasattr(self, "net"):
            logging.getLogger("dsr").removeHandler(self.complaints)
            self.net.converge()
            self.net.worlds.check()
            self.net.worlds.check_converged()
            assert not self.complaints.said

    def _write(self, site: int, world: str, write: Callable[[Memory], object]) -> None:
        memory = self.net.opened(site, world)
        if memory is not None:
            write(memory)
            memory.flush()


Worlds.TestCase.settings = settings(
    max_examples=60, stateful_step_count=30, deadline=None, report_multiple_bugs=False
)  # fmt: skip
TestWorlds = Worlds.TestCase
