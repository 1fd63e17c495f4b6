"""Random histories of memories that hold parts of a graph, and change their minds, on a network that fails."""

from __future__ import annotations

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import initialize, rule

from benchmarks.interest.world import PARTS, PartsWorld
from dsr import Faults
from tests.dsr.properties.machine import Histories, faults
from tests.dsr.properties.test_deltas import names, numbers, sites, types

parts = st.sampled_from(PARTS)
somewhere = st.sampled_from(("", *PARTS))


class Parts(Histories[PartsWorld]):
    """Whatever happens, each shows of what it holds what a plain model of all holders shows there."""

    @initialize(places=st.integers(2, 4), seed=st.integers(0, 2**16), network=faults)
    def begin(self, places: int, seed: int, network: Faults) -> None:
        self.start(PartsWorld(places, seed))
        self.world.network.faults = network

    @rule(site=sites, part=parts)
    def hold(self, site: int, part: str) -> None:
        self.world.hold(site, part)

    @rule(site=sites, part=parts)
    def leave(self, site: int, part: str) -> None:
        self.world.leave(site, part)

    @rule(site=sites, part=somewhere, name=names, type=types, value=numbers)
    def add_node(self, site: int, part: str, name: str, type: str, value: int) -> None:
        self.world.add_in(site, part, name, type, value)


Parts.TestCase.settings = settings(
    max_examples=60, stateful_step_count=40, deadline=None, report_multiple_bugs=False
)
TestParts = Parts.TestCase
