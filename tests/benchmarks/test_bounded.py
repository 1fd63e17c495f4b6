"""The memory is as small as its content, however long it lives: the benchmark of a week, shortened."""

from __future__ import annotations

import dataclasses

from benchmarks.bounded import is_flat, live, recreate


def test_ten_times_as_many_changes_leave_the_same_size() -> None:
    sizes = list(live(20, 1, restarts=False))
    assert is_flat(sizes[1], sizes[-1])
    assert sizes[-1].blocks < 1.05 * sizes[1].blocks


def test_each_restart_leaves_one_entry_in_the_context_and_nothing_else() -> None:
    sizes = list(live(10, 1, restarts=True))
    assert is_flat(sizes[1], sizes[-1], replicas=8) and not is_flat(sizes[1], sizes[-1])


def test_nodes_that_are_created_again_and_again_take_no_more_room() -> None:
    first, last = recreate(20, 50)
    assert is_flat(first, last)


def test_growth_would_be_seen() -> None:
    first, last = recreate(2, 2)
    assert not is_flat(first, dataclasses.replace(last, entries=last.entries + 1))
    assert not is_flat(first, dataclasses.replace(last, context_ranges=last.context_ranges + 1))
