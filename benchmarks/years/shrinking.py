"""Makes a failing history shorter: steps are left out as long as it still fails in the same way."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from benchmarks.years.steps import Step

MOST_RUNS = 400
"""Histories that are tried; a few minutes. More make it no shorter where a failure takes many things together."""


def shrunk(steps: Sequence[Step], fails: Callable[[list[Step]], bool], runs: int = MOST_RUNS) -> list[Step]:
    """The fewest steps that were found to fail still: none of them can be left out alone, if `runs` were enough."""
    left = list(steps)
    size = max(1, len(left) // 2)
    while runs > 0:
        begin, before = 0, len(left)
        while begin < len(left) and runs > 0:
            without = left[:begin] + left[begin + size :]
            runs -= 1
            if fails(without):
                left = without
            else:
                begin += size
        if size == 1 and len(left) == before:
            break
        size = max(1, size // 2)
    return left
