"""Causal context: a set of dots, whatever the order in which they come."""

from hypothesis import given
from hypothesis import strategies as st

from dsr.crdt.context import CausalContext, Dot, to_ranges

dots = st.lists(st.tuples(st.sampled_from(["a", "b", "c"]), st.integers(1, 12)), max_size=40)


def context_of(items: list[Dot]) -> CausalContext:
    context = CausalContext()
    for dot in items:
        context.add(dot)
    return context


@given(dots)
def test_contains_exactly_what_was_added(items: list[Dot]) -> None:
    context = context_of(items)
    for rid in "abc":
        for counter in range(1, 14):
            assert ((rid, counter) in context) == ((rid, counter) in items)


@given(dots, st.randoms())
def test_order_does_not_matter(items: list[Dot], random: object) -> None:
    shuffled = sorted(items, key=lambda _: random.random())  # type: ignore[attr-defined]
    assert context_of(items) == context_of(shuffled)


@given(dots, dots)
def test_merge_is_union(left: list[Dot], right: list[Dot]) -> None:
    merged = context_of(left)
    merged.merge(context_of(right))
    assert merged == context_of(left + right)
    assert merged.covers(context_of(left)) and merged.covers(context_of(right))
    assert context_of(left).covers(context_of(right)) == (set(right) <= set(left))


@given(dots)
def test_ranges_rebuild_the_context(items: list[Dot]) -> None:
    assert CausalContext(context_of(items).ranges()) == context_of(items)
    assert CausalContext(to_ranges(set(items))) == context_of(items)


def test_a_closed_gap_leaves_no_cloud() -> None:
    context = context_of([("a", 3), ("a", 2), ("a", 5)])
    assert context.cloud == {"a": [(2, 3), (5, 5)]}
    context.add(("a", 1))
    assert (context.vector, context.cloud) == ({"a": 3}, {"a": [(5, 5)]})
    context.add(("a", 4))
    assert (context.vector, context.cloud) == ({"a": 5}, {})


def test_what_somebody_claims_to_have_seen_takes_no_memory() -> None:
    context = CausalContext([("a", 5, 1 << 53), ("a", 2, 3)])
    assert context.cloud == {"a": [(2, 3), (5, 1 << 53)]}
    assert context.covers(CausalContext([("a", 6, 1 << 52)])) and not context.covers(CausalContext([("a", 3, 9)]))
