"""Random histories of memories that hold parts of a graph, and change their minds, on a network that fails."""

from __future__ import annotations

import logging

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from benchmarks.interest.world import PARTS, PartsWorld
from benchmarks.years.world import Complaints
from tests.dsr.properties.test_deltas import choices, edge_types, names, numbers, sites, types
from tests.dsr.properties.test_memories import faults

parts = st.sampled_from(PARTS)
somewhere = st.sampled_from(("", *PARTS))


class Parts(RuleBasedStateMachine):
    """Whatever happens, each shows of what it holds what a plain model of all holders shows there."""

    @initialize(places=st.integers(2, 4), seed=st.integers(0, 2**16), network=faults)
    def begin(self, places: int, seed: int, network: object) -> None:
        self.complaints = Complaints()
        logging.getLogger("dsr").addHandler(self.complaints)
        self.world = PartsWorld(places, seed)
        self.world.network.faults = network  # type: ignore[assignment]

    @rule(site=sites, part=parts)
    def hold(self, site: int, part: str) -> None:
        self.world.hold(site, part)

    @rule(site=sites, part=parts)
    def leave(self, site: int, part: str) -> None:
        self.world.leave(site, part)

    @rule(site=sites, part=somewhere, name=names, type=types, value=numbers)
    def add_node(self, site: int, part: str, name: str, type: str, value: int) -> None:
        self.world.add_in(site, part, name, type, value)

    @rule(site=sites, choice=choices, value=numbers)
    def update_node(self, site: int, choice: int, value: int) -> None:
        if name := self.world.a_node(site, choice):
            self.world.update_node(site, name, value)

    @rule(site=sites, ends=st.tuples(choices, choices), type=edge_types, x=numbers)
    def add_edge(self, site: int, ends: tuple[int, int], type: str, x: int) -> None:
        src, dst = (self.world.a_node(site, choice) for choice in ends)
        if src and dst:
            self.world.add_edge(site, (src, dst, type), x)

    @rule(site=sites, choice=choices, x=numbers)
    def stream(self, site: int, choice: int, x: int) -> None:
        if key := self.world.an_edge(site, choice):
            self.world.stream(site, key, x)

    @rule(site=sites, choice=choices)
    def remove_node(self, site: int, choice: int) -> None:
        if name := self.world.a_node(site, choice):
            self.world.remove_node(site, name)

    @rule(site=sites, choice=choices)
    def remove_edge(self, site: int, choice: int) -> None:
        if key := self.world.an_edge(site, choice):
            self.world.remove_edge(site, key)

    @rule(site=sites, some=st.lists(names, min_size=1, max_size=3), value=numbers)
    def batch(self, site: int, some: list[str], value: int) -> None:
        self.world.batch(site, some, value)

    @rule(seconds=st.sampled_from([0.0, 0.01, 0.3, 1.1]))
    def advance(self, seconds: float) -> None:
        self.world.advance(seconds)

    @rule(mask=st.integers(0, 15))
    def partition(self, mask: int) -> None:
        self.world.partition(mask)

    @rule()
    def heal(self) -> None:
        self.world.heal()

    @rule(site=sites, restore=st.booleans())
    def crash(self, site: int, restore: bool) -> None:
        self.world.crash(site, restore=restore)

    @rule(site=sites)
    def read(self, site: int) -> None:
        participant = self.world.participants[site % len(self.world.participants)]
        participant.reader.read(participant.memory._graph)

    @invariant()
    def nothing_dangles_and_nothing_is_forgotten(self) -> None:
        if hasattr(self, "world"):
            self.world.check()

    def teardown(self) -> None:
        if hasattr(self, "world"):
            logging.getLogger("dsr").removeHandler(self.complaints)
            self.world.converge()
            self.world.check_converged()
            assert not self.complaints.said


Parts.TestCase.settings = settings(
    max_examples=60, stateful_step_count=40, deadline=None, report_multiple_bugs=False
)
TestParts = Parts.TestCase
