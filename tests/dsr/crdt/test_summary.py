"""The summary of a context: the same for the same dots however they came, small, and right about what is missing."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from dsr.crdt.context import CausalContext, DotRange
from dsr.crdt.summary import LISTED, LISTED_RANGES

ranges = st.lists(
    st.tuples(st.sampled_from("abcd"), st.integers(1, 30), st.integers(0, 6)).map(lambda r: (r[0], r[1], r[1] + r[2])),
    max_size=20,
)


@given(ranges, ranges)
def test_two_contexts_compare_by_their_summaries_as_they_are(ours: list[DotRange], theirs: list[DotRange]) -> None:
    a, b = CausalContext(ours), CausalContext(theirs)
    assert (a.summary().hash == b.summary().hash) == (a == b)
    listed, rest = a.compare(b.summary("a"))
    assert (listed and rest) <= a.covers(b) and (a == b) <= (listed and rest)
    assert listed == a.covers(CausalContext([(rid, *dots) for rid, all in b.summary("a").recent for dots in all]))


@given(st.permutations([("a", 1, 3), ("b", 2, 2), ("a", 7, 9), ("b", 1, 1), ("c", 5, 5), ("a", 4, 6)]))
def test_the_order_does_not_matter_nor_when_it_was_looked_at(order: list[DotRange]) -> None:
    context = CausalContext()
    for dots in order:
        context.add_range(*dots)
        context.summary()
    assert context.summary().hash == CausalContext(order).summary().hash


def test_those_that_changed_last_are_listed_and_the_first_always() -> None:
    context = CausalContext((f"r{number}", 1, number + 1) for number in range(1000))
    context.summary()
    context.add(("r7", 9))
    context.add_range("holes", 1, 1)
    for number in range(LISTED_RANGES + 1):
        context.add(("holes", 3 + 2 * number))
    listed = [rid for rid, _ in context.summary("r3").recent]
    assert listed[:2] == ["r3", "r7"] and len(listed) == LISTED and "holes" not in listed
    assert context.summary("r3").last("r7") == 9 and context.summary().last("r3") is None


def test_what_is_listed_is_compared_by_counters_and_the_rest_by_its_hash() -> None:
    old = [(f"r{number}", 1, 5) for number in range(100)]
    mine, theirs = CausalContext([*old, ("w", 1, 9)]), CausalContext([*old, ("w", 1, 7)])
    assert mine.compare(theirs.summary()) == (True, True)
    assert theirs.compare(mine.summary()) == (False, True)
    mine.add_range("r5", 6, 6)
    for number in range(2 * LISTED):
        for context in (mine, theirs):
            context.summary()
            context.add_range(f"r{number + 10}", 6, 6)
    assert theirs.compare(mine.summary()) == (True, False) and mine.compare(theirs.summary()) == (True, False)
