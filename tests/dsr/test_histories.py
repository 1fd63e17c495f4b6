"""Random histories: whatever happens on the way, all replicas end equal to a plain model."""

from __future__ import annotations

import random
from unittest import mock

from hypothesis import given, settings
from hypothesis import strategies as st

from dsr import Faults
from dsr.crdt.context import CausalContext, Dot
from dsr.crdt.store import Store
from tests.dsr.histories import NAMES, Operation, check_history

replicas = st.integers(0, 4)
names = st.sampled_from(NAMES)
values = st.integers(0, 99)
operations = st.lists(
    st.one_of(
        st.tuples(st.just("add"), replicas, names, values),
        st.tuples(st.just("write"), replicas, names, values),
        st.tuples(st.just("clear"), replicas, names),
        st.tuples(st.just("link"), replicas, names, names, values),
        st.tuples(st.just("stream"), replicas, names, names, values),
        st.tuples(st.just("unlink"), replicas, names, names),
        st.tuples(st.just("remove"), replicas, names),
        st.tuples(st.just("deliver")),
        st.tuples(st.just("advance"), st.sampled_from([0.01, 0.3, 1.1])),
        st.tuples(st.just("partition"), st.integers(0, 31)),
        st.tuples(st.just("heal")),
        st.tuples(st.just("crash"), replicas),
    ),
    max_size=40,
)
faults = st.builds(
    Faults,
    loss=st.sampled_from([0.0, 0.3]),
    duplication=st.sampled_from([0.0, 0.5]),
    delay=st.sampled_from([(0.0, 0.0), (0.0, 0.4)]),
)


@settings(max_examples=120, deadline=None)
@given(operations, st.integers(2, 5), st.integers(0, 2**16), faults)
def test_all_replicas_end_equal_to_the_model(
    history: list[Operation], count: int, seed: int, network: Faults
) -> None:
    check_history(history, replicas=count, seed=seed, faults=network)


def test_stream_sample_of_a_dead_writer_reaches_everybody() -> None:
    """The writer dies before it could make its last sample durable; only one replica received it."""
    world = check_history(
        [("add", 0, "a", 1), ("add", 0, "b", 1), ("link", 0, "a", "b", 1), ("advance", 1.1), ("partition", 0b011),
         ("stream", 0, "a", "b", 7), ("deliver",), ("crash", 0)],
        replicas=3,
    )  # fmt: skip
    assert world.memories[2].edge("a", "b", "RT").pose.t[0] == 7


def test_write_to_a_doubly_created_node_survives_the_removal_of_one_incarnation() -> None:
    """Replicas 0 and 1 create "a" at once; 2 has seen only one of the two when it removes it."""
    world = check_history(
        [("partition", 0b101), ("add", 0, "a", 1), ("deliver",), ("add", 1, "a", 2), ("remove", 2, "a"), ("heal",),
         ("advance", 1.1), ("advance", 1.1)],
        replicas=3,
    )  # fmt: skip
    assert world.memories[0].node("a")["seen"] == 2


def random_history(generator: random.Random) -> list[Operation]:
    def operation() -> Operation:
        replica, name, other, value = generator.randrange(5), *generator.choices(NAMES[:2], k=2), generator.randrange(9)
        return generator.choice([
            ("add", replica, name, value), ("add", replica, name, value), ("write", replica, name, value),
            ("link", replica, name, other, value), ("remove", replica, name), ("deliver",), ("advance", 1.1),
            ("partition", generator.randrange(31)), ("heal",),
        ])  # fmt: skip

    return [operation() for _ in range(25)]


def fails_somewhere() -> bool:
    for seed in range(150):
        try:
            check_history(random_history(random.Random(seed)), replicas=3, seed=seed)
        except AssertionError:
            return True
    return False


def test_histories_pass_without_a_mutation() -> None:
    assert not fails_somewhere()


def prune_losers(self: Store, dot: Dot) -> None:
    """Known-bad variant 1: incarnations that lose to a greater one are dropped locally, outside the context."""
    entry = self.entries.get(dot)
    siblings = self.by_key.get(entry.key, {}) if entry else {}
    for loser in [d for d in siblings if d < dot]:
        siblings.pop(loser)
        self.entries.pop(loser)


def test_pruning_losers_is_caught() -> None:
    original = Store._add

    def add(self: Store, item: object) -> None:
        original(self, item)  # type: ignore[arg-type]
        prune_losers(self, item.dot)  # type: ignore[attr-defined]

    with mock.patch.object(Store, "_add", add):
        assert fails_somewhere()


def test_ignoring_whose_counter_it_is_is_caught() -> None:
    """Known-bad variant 2: a counter below the highest in the cloud counts as seen, whoever's it is."""

    def contains(self: CausalContext, dot: Dot) -> bool:
        known = [*self.vector.values(), *(counter for beyond in self.cloud.values() for counter in beyond)]
        return dot[1] <= max(known, default=0)

    with mock.patch.object(CausalContext, "__contains__", contains):
        assert fails_somewhere()


def test_not_removing_what_a_peer_removed_is_caught() -> None:
    with mock.patch.object(Store, "_remove_absent", lambda *_: None):
        assert fails_somewhere()
