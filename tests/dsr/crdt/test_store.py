"""The join of stores: commutative, associative, idempotent; deltas amount to the full state."""

from __future__ import annotations

import copy
import random
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from dsr.crdt import store as store_module
from dsr.crdt.context import CausalContext
from dsr.crdt.delta import Add, Delta, Write
from dsr.crdt.pieces import reply_to
from dsr.crdt.store import Store
from dsr.graph.graph import Graph


def random_history(seed: int, length: int = 25) -> tuple[list[Graph], list[Delta]]:
    """Three replicas that now and then hear all that another one knows, and the deltas of what they wrote."""
    generator = random.Random(seed)
    graphs = [Graph(f"r{index}") for index in range(3)]
    deltas: list[Delta] = []
    for _ in range(length):
        graph, name = generator.choice(graphs), generator.choice("ab")
        now = generator.uniform(1e9, 1e9 + 1)
        action = generator.randrange(6)
        if action <= 1:
            deltas.append(graph.add_node(name, "cube", {"seen": generator.randrange(9)}, now))
        elif action == 2 and name in graph.nodes:
            deltas.append(graph.write(graph.node(name), {"seen": generator.randrange(9)}, now))
        elif action == 3:
            deltas.append(graph.remove_node(name))
        elif action == 4 and "a" in graph.nodes and "b" in graph.nodes:
            deltas.append(graph.add_edge("a", "b", "on", {"since": now}, now))
        elif action == 5:
            graph.join(reply_to(generator.choice(graphs).store, graph.store.context), now)
    return graphs, [delta for delta in deltas if delta]


def full(store: Store) -> Delta:
    return reply_to(store, CausalContext())


def state(store: Store) -> dict[str, Any]:
    """Everything that two equal stores have in common."""
    return {
        "context": store.context,
        "entries": {dot: (e.key, e.type, e.registers) for dot, e in store.entries.items()},
        "fingerprint": store.fingerprint,
    }


def joined(*deltas: Delta) -> Store:
    store = Store()
    for delta in deltas:
        store.join(delta)
    return store


seeds = st.integers(0, 10_000)


@settings(deadline=None)
@given(seeds, st.randoms())
def test_deltas_may_come_in_any_order_and_twice(seed: int, shuffle: random.Random) -> None:
    _, deltas = random_history(seed)
    shuffled = deltas + [d for d in deltas if shuffle.random() < 0.3]
    shuffle.shuffle(shuffled)
    assert state(joined(*deltas)) == state(joined(*shuffled))


@settings(deadline=None)
@given(seeds)
def test_full_state_join_is_commutative_and_idempotent(seed: int) -> None:
    graphs, _ = random_history(seed)
    left, right = graphs[0].store, graphs[1].store
    full_left, full_right = full(left), full(right)
    for target, other in ((left, full_right), (right, full_left)):
        target.join(other)
        once = copy.deepcopy(state(target))
        target.join(other)
        assert state(target) == once
    assert state(left) == state(right)


@settings(deadline=None)
@given(seeds)
def test_full_state_join_is_associative(seed: int) -> None:
    graphs, _ = random_history(seed)
    a, b, c = (full(graph.store) for graph in graphs)
    left, right = joined(full(joined(a, b)), c), joined(a, full(joined(b, c)))
    assert state(left) == state(right)


@settings(deadline=None)
@given(seeds)
def test_deltas_amount_to_the_full_state(seed: int) -> None:
    """As graphs, which also drop edges that lost an end: a reply may omit them, a delta may not."""
    graphs, deltas = random_history(seed)
    by_deltas, by_replies = Graph("x"), Graph("y")
    for delta in deltas:
        by_deltas.join(delta, 1e9)
    for graph in graphs:
        by_replies.join(full(graph.store), 1e9)
    assert state(by_deltas.store) == state(by_replies.store)


@settings(deadline=None)
@given(seeds)
def test_answer_to_a_version_vector_equals_a_full_join(seed: int) -> None:
    graphs, _ = random_history(seed)
    mine, theirs = graphs[0].store, graphs[1].store
    whole = copy.deepcopy(mine)
    whole.join(full(theirs))
    mine.join(reply_to(theirs, mine.context))
    assert state(mine) == state(whole)


def write(owner: tuple[str, int], counter: int, stamp: int, value: int) -> Delta:
    delta = Delta()
    delta.writes.append(Write(owner, "seen", stamp, "w", ("w", counter), value))
    delta.context.append(("w", counter, counter))
    return delta


def add(counter: int) -> Delta:
    delta = Delta()
    delta.adds.append(Add(("w", counter), "n", "cube"))
    delta.context.append(("w", counter, counter))
    return delta


def test_a_late_write_does_not_resurrect() -> None:
    removal = Delta()
    removal.removed.append(("w", 1))
    store = joined(add(1), removal, write(("w", 1), 2, 5, 7))
    assert not store.entries and ("w", 2) in store.context


def test_a_late_addition_does_not_resurrect() -> None:
    removal = Delta()
    removal.removed.append(("w", 1))
    assert not joined(removal, add(1)).entries


def test_a_write_before_its_entry_waits_and_counts_as_seen_only_then() -> None:
    store = joined(write(("w", 1), 2, 5, 7))
    assert ("w", 2) not in store.context
    store.join(add(1))
    assert ("w", 2) in store.context
    assert store.entries[("w", 1)].registers["seen"].value == 7


def test_the_waiting_room_is_bounded_and_an_overflow_stays_visible_as_missing(monkeypatch: Any) -> None:
    monkeypatch.setattr(store_module, "MAX_WAITING", 2)
    store = joined(*[write(("w", 1), counter, counter, counter) for counter in (2, 3, 4)])
    store.join(add(1))
    assert store.lost_waiting == 1
    assert ("w", 3) in store.context and ("w", 4) not in store.context


def test_state_does_not_grow_with_history() -> None:
    graph = Graph("r")

    def cycle() -> int:
        for index in range(50):
            graph.add_node(f"n{index}", "cube", {"seen": index}, 1e9)
        for index in range(49):
            graph.add_edge(f"n{index}", f"n{index + 1}", "on", {"since": 1.0}, 1e9)
        for index in range(50):
            graph.remove_node(f"n{index}")
        store = graph.store
        return len(store.entries) + len(store.by_key) + len(list(store.context.ranges())) + len(graph.incident)

    sizes = [cycle() for _ in range(5)]
    assert set(sizes) == {1}
