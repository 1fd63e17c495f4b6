"""Random histories of memories on a network that loses, repeats, delays and cuts, with clocks that are off."""

from __future__ import annotations

from typing import Any
from unittest import mock

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import initialize, rule

from benchmarks.years.world import World
from dsr import Faults, Pose
from dsr.crdt import pieces
from tests.dsr.properties.machine import Histories, faults
from tests.dsr.properties.soup import HOUR
from tests.dsr.properties.test_deltas import choices, names, numbers, sites, stamps, types

skews = st.one_of(st.just(0.0), st.just(0.0), st.sampled_from([-0.4, 0.4]), st.floats(-HOUR, HOUR))


class Memories(Histories[World]):
    """Whatever happens, all end equal to a plain model of what reached the survivors."""

    @initialize(
        offsets=st.lists(skews, min_size=2, max_size=5),
        seed=st.integers(0, 2**16),
        network=faults,
        examined=st.sampled_from([1, 2, 2000]),
    )
    def begin(self, offsets: list[float], seed: int, network: Faults, examined: int) -> None:
        self.limit = mock.patch.object(pieces, "MAX_EXAMINED", examined)  # answers of many pieces
        self.limit.start()
        self.start(World(offsets, seed, network))

    @rule(site=sites, name=names, type=types, value=numbers)
    def add_node(self, site: int, name: str, type: str, value: int) -> None:
        self.world.add_node(site, name, type, value)

    @rule(site=sites, choice=choices, attribute=st.sampled_from(["seen", "mass"]))
    def remove_attribute(self, site: int, choice: int, attribute: str) -> None:
        if name := self.world.a_node(site, choice):
            self.world.remove_attribute(site, name, attribute)

    @rule(site=sites, choice=choices, stamp=stamps, value=numbers, durable=st.booleans())
    def forge(self, site: int, choice: int, stamp: int, value: int, durable: bool) -> None:
        if name := self.world.a_node(site, choice):
            self.world.forge(site, name, stamp, value, durable=durable)

    @rule(site=sites, replicas=st.integers(1, 5))
    def blame(self, site: int, replicas: int) -> None:
        self.world.blame(site, replicas)

    @rule(site=sites)
    def clean(self, site: int) -> None:
        self.world.clean(site)

    @rule(site=sites, offset=skews)
    def set_clock(self, site: int, offset: float) -> None:
        self.world.set_clock(site, offset)

    def teardown(self) -> None:
        try:
            super().teardown()
        finally:
            if hasattr(self, "limit"):
                self.limit.stop()


Memories.TestCase.settings = settings(
    max_examples=200, stateful_step_count=40, deadline=None, report_multiple_bugs=False
)
TestMemories = Memories.TestCase


def converged(world: World) -> dict[Any, Any]:
    world.converge()
    world.check_converged()
    return {key: values for key, (_, values) in world.participants[0].reader.seen.items()}


def test_stream_sample_of_a_dead_writer_reaches_everybody() -> None:
    """The writer dies before it could make its last sample durable; only one replica received it."""
    world = World([0.0] * 3)
    world.batch(0, ["a", "b"], 1)
    world.add_edge(0, ("a", "b", "RT"), 1)
    world.advance(1.1)
    world.partition(0b011)
    world.stream(0, ("a", "b", "RT"), 7)
    world.deliver()
    world.crash(0)
    assert converged(world)["a", "b", "RT"]["pose"] == Pose((7, 1, 0))


def test_a_write_that_was_lost_on_the_way_is_asked_for() -> None:
    """Nothing was added or removed meanwhile: the elements of both are the same, and only what was seen differs."""
    world = World([0.0] * 2)
    world.add_node(0, "a", "cube", 1)
    for _ in range(3):
        world.advance(1.1)
    world.partition(0b01)
    world.update_node(0, "a", 2)
    world.deliver()
    assert converged(world) == {"a": {"seen": 2, "mass": 2.0}}


def test_write_to_a_doubly_created_node_survives_the_removal_of_one_incarnation() -> None:
    """Replicas 0 and 1 create "a" at once; 2 has seen only one of the two when it removes it."""
    world = World([0.0] * 3)
    world.partition(0b101)
    world.add_node(0, "a", "cube", 1)
    world.deliver()
    world.add_node(1, "a", "cube", 2)
    world.remove_node(2, "a")
    assert converged(world)["a"]["seen"] == 2


def test_what_one_survivor_has_seen_survives_and_what_only_the_dead_one_knew_goes() -> None:
    world = World([0.0] * 3)
    world.partition(0b011)
    world.add_node(0, "a", "cube", 1)
    world.deliver()
    world.partition(0b110)
    world.add_node(0, "b", "cube", 2)
    world.crash(0)
    assert converged(world) == {"a": {"seen": 1}}


def test_a_clock_that_is_an_hour_fast_writes_nothing_and_its_owner_still_learns_everything() -> None:
    world = World([HOUR, 0.0, 0.0])
    world.advance(1.1)
    world.advance(1.1)
    world.advance(1.1)
    world.add_node(0, "a", "cube", 1)
    world.add_node(1, "b", "cube", 2)
    assert converged(world) == {"b": {"seen": 2}}
