"""Random histories of replicas whose messages are lost, repeated, reordered and delayed at will."""

from __future__ import annotations

from typing import Any

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from dsr import Pose
from dsr.crdt.hlc import MAX_LEAD, MAX_STAMP, stamp_at
from tests.dsr.properties.soup import HOUR, START, Soup

sites = st.integers(0, 4)
names = st.sampled_from(["a", "a", "a", "b", "b", "c"])
types = st.sampled_from(["cube", "box"])
edge_types = st.sampled_from(["RT", "Virtual_RT", "on"])
choices = st.integers(0, 9)
numbers = st.integers(0, 99)
poses = st.builds(lambda x: {"pose": Pose((x, 0.0, 0.0))}, numbers)
edge_values = st.one_of(
    poses,
    st.builds(lambda x: {"since": float(x)}, numbers),
    st.builds(lambda x: {"pose": Pose((x, 1.0, 0.0)), "since": float(x), "note": "n"}, numbers),
)
skews = st.one_of(st.just(0.0), st.floats(-HOUR, HOUR))
bounds = [0, 1 << 62, MAX_STAMP - 1, *[MAX_STAMP] * 3, stamp_at(START + MAX_LEAD), stamp_at(START + 3 * MAX_LEAD)]
stamps = st.one_of(st.sampled_from(bounds), st.integers(0, MAX_STAMP))
"""Any that the format takes, those at its bound and at the bounds of clocks more often."""


class Deltas(RuleBasedStateMachine):
    """Anything may happen to a message; every replica shows exactly what reached it."""

    soup_class = Soup

    @initialize(offsets=st.lists(skews, min_size=2, max_size=5))
    def begin(self, offsets: list[float]) -> None:
        self.soup = self.soup_class(offsets)

    @rule(site=sites, name=names, type=types, value=numbers)
    def add_node(self, site: int, name: str, type: str, value: int) -> None:
        self.soup.add_node(site, name, type, value)

    @rule(site=sites, choice=choices, value=numbers)
    def update_node(self, site: int, choice: int, value: int) -> None:
        if name := self.soup.a_node(site, choice):
            self.soup.update_node(site, name, {"seen": value, "mass": float(value)})

    @rule(site=sites, choice=choices, attribute=st.sampled_from(["seen", "mass"]))
    def remove_node_attribute(self, site: int, choice: int, attribute: str) -> None:
        if name := self.soup.a_node(site, choice):
            self.soup.remove_attribute(site, name, attribute)

    @rule(site=sites, ends=st.tuples(choices, choices), type=edge_types, values=edge_values)
    def add_edge(self, site: int, ends: tuple[int, int], type: str, values: dict[str, Any]) -> None:
        src, dst = (self.soup.a_node(site, choice) for choice in ends)
        if src and dst:
            self.soup.add_edge(site, (src, dst, type), values)

    @rule(site=sites, choice=choices, values=edge_values)
    def update_edge(self, site: int, choice: int, values: dict[str, Any]) -> None:
        if key := self.soup.an_edge(site, choice):
            self.soup.update_edge(site, key, values)

    @rule(site=sites, choice=choices, attribute=st.sampled_from(["pose", "since"]))
    def remove_edge_attribute(self, site: int, choice: int, attribute: str) -> None:
        if key := self.soup.an_edge(site, choice):
            self.soup.remove_attribute(site, key, attribute)

    @rule(site=sites, choice=choices)
    def remove_node(self, site: int, choice: int) -> None:
        if name := self.soup.a_node(site, choice):
            self.soup.remove_node(site, name)

    @rule(site=sites, choice=choices)
    def remove_edge(self, site: int, choice: int) -> None:
        if key := self.soup.an_edge(site, choice):
            self.soup.remove_edge(site, key)

    @rule(site=sites, some=st.lists(names, min_size=1, max_size=3), value=numbers)
    def batch(self, site: int, some: list[str], value: int) -> None:
        self.soup.batch(site, some, value)

    @rule(
        site=sites, choice=choices, attribute=st.sampled_from(["seen", "seen", "mass", "pose", "since"]),
        stamp=st.one_of(st.none(), stamps), value=numbers, durable=st.booleans(), unknown=st.integers(0, 9),
    )  # fmt: skip
    def forge(
        self, site: int, choice: int, attribute: str, stamp: int | None, value: int, durable: bool, unknown: int
    ) -> None:
        target = self.soup.a_dot(site, choice) if unknown else None
        told = Pose((value, 0.0, 0.0)) if attribute == "pose" else value
        self.soup.forge(target, attribute, stamp, told, durable=durable, reaches=site)

    @rule(site=sites, choice=choices)
    def renew_node(self, site: int, choice: int) -> None:
        if name := self.soup.a_node(site, choice):
            self.soup.renew(site, name)

    @rule(site=sites, choice=choices)
    def renew_edge(self, site: int, choice: int) -> None:
        if key := self.soup.an_edge(site, choice):
            self.soup.renew(site, key)

    @rule(site=sites)
    def make_durable(self, site: int) -> None:
        self.soup.make_durable(site)

    @rule(choice=st.integers(0, 200), site=sites)
    def deliver(self, choice: int, site: int) -> None:
        self.soup.deliver(choice, site)

    @rule(choice=st.lists(st.integers(0, 200), max_size=8), site=sites)
    def deliver_many(self, choice: list[int], site: int) -> None:
        for number in choice:
            self.soup.deliver(number, site)

    @rule(asker=sites, asked=sites)
    def ask(self, asker: int, asked: int) -> None:
        self.soup.reply(asker, asked)

    @rule(asker=sites, asked=sites)
    def sync(self, asker: int, asked: int) -> None:
        self.soup.sync(asker, asked)

    @rule(site=sites)
    def snapshot(self, site: int) -> None:
        self.soup.snapshot(site)

    @rule(site=sites)
    def crash(self, site: int) -> None:
        self.soup.crash(site)

    @rule(site=sites, offset=skews)
    def set_the_clock(self, site: int, offset: float) -> None:
        self.soup._site(site)[0].skew = offset

    @rule(seconds=st.sampled_from([0.0, 1e-6, 0.5]))
    def wait(self, seconds: float) -> None:
        self.soup.time += seconds

    @rule(site=sites)
    def read(self, site: int) -> None:
        self.soup.check_readers(self.soup._site(site)[0])

    @invariant()
    def each_shows_exactly_what_reached_it(self) -> None:
        if hasattr(self, "soup"):
            self.soup.check()

    def teardown(self) -> None:
        if hasattr(self, "soup"):
            self.soup.converge()
            self.soup.check_converged()


Deltas.TestCase.settings = settings(max_examples=300, stateful_step_count=40, deadline=None, report_multiple_bugs=False)
TestDeltas = Deltas.TestCase


def test_an_edge_whose_other_incarnation_never_comes_is_dropped_everywhere() -> None:
    """Site 0 hears of the edge and of one of the incarnations it hangs on; of the other only that it was removed."""
    soup = Soup([0.0] * 4)
    soup.add_node(3, "b", "cube", 1)
    soup.add_node(1, "a", "cube", 1)
    soup.add_node(2, "a", "cube", 1)
    soup.deliver(1, 3)
    soup.deliver(2, 3)
    soup.add_edge(3, ("a", "b", "on"), {"since": 1.0})
    for message in (0, 1, 3):
        soup.deliver(message, 0)
    assert ("a", "b", "on") in soup.sites[0].graph.edges
    soup.remove_node(1, "a")
    soup.remove_node(2, "a")
    for site in (0, 3):
        soup.deliver(4, site)
        soup.deliver(5, site)
        assert [entry.key for entry in soup.sites[site].graph.store.entries.values()] == ["b"]


def test_of_writes_under_one_stamp_and_writer_the_same_is_shown_everywhere() -> None:
    """Honest writers never do that: to each of two incarnations of one node, which others made at once."""
    soup = Soup([0.0] * 2)
    for site in (0, 1):
        soup.add_node(site, "a", "cube", 1)
    for site in (0, 1):
        soup.forge(soup.a_dot(site, 0), "mass", 7, float(site), durable=True, reaches=site)
    soup.converge()
    soup.check_converged()


def test_a_stamp_that_lost_to_a_forged_one_before_it_was_handed_on_binds_no_clock() -> None:
    """A clock goes beyond the stamps that come, of whatever element; an answer holds those alone that have won."""
    soup = Soup([0.0] * 2)
    soup.add_node(0, "a", "cube", 1)
    soup.forge(soup.a_dot(0, 0), "seen", stamp_at(START + 3 * MAX_LEAD), 2, durable=True, reaches=0)
    soup.sync(1, 0)
    soup.add_node(1, "b", "cube", 3)
    soup.update_node(1, "a", {"seen": 4})
    soup.converge()
    soup.check_converged()
