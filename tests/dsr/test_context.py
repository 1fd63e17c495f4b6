"""The causal context: the same as a plain set of dots, whatever the order in which they come."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from dsr.crdt.context import CausalContext

ranges = st.lists(st.tuples(st.sampled_from(["a", "b"]), st.integers(1, 30), st.integers(0, 8)), max_size=30)


@given(ranges)
def test_it_is_a_set_that_compacts(added: list[tuple[str, int, int]]) -> None:
    context = CausalContext()
    plain: set[tuple[str, int]] = set()
    for rid, first, length in added:
        context.add_range(rid, first, first + length - 1)
        plain.update((rid, counter) for counter in range(first, first + length))
    assert {(rid, n) for rid in "ab" for n in range(1, 50) if (rid, n) in context} == plain
    assert CausalContext(context.ranges()) == context
    for rid, beyond in context.cloud.items():
        assert beyond and beyond[0][0] > context.vector.get(rid, 0) + 1
        assert all(left[1] + 1 < right[0] for left, right in pairwise(beyond))
