"""What random histories of memories on a faulty network have in common: what users do, and what passes."""

from __future__ import annotations

import logging
from typing import Generic, TypeVar

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from benchmarks.years.world import Complaints, World
from dsr import Faults
from tests.dsr.properties.test_deltas import choices, edge_types, names, numbers, sites

faults = st.builds(
    Faults,
    loss=st.sampled_from([0.0, 0.3]),
    duplication=st.sampled_from([0.0, 0.5]),
    delay=st.sampled_from([(0.0, 0.0), (0.0, 0.4)]),
)


Place = TypeVar("Place", bound=World)


class Histories(RuleBasedStateMachine, Generic[Place]):
    """Changes, faults and readers of a world; a machine of its own adds how the world begins, and what it has more."""

    world: Place

    def start(self, world: Place) -> None:
        """Begin with a world; from now on nobody may complain."""
        self.world = world
        self.complaints = Complaints()
        logging.getLogger("dsr").addHandler(self.complaints)

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

    @rule(mask=st.integers(0, 31))
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
