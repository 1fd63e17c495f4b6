"""Allen's relations between intervals of time, for instants and open ends too; pure.

J. F. Allen, "Maintaining knowledge about temporal intervals", CACM 26(11), 1983. An instant is an interval of length
zero. Of instants only the relations of M. Vilain, "A system for reasoning about time", AAAI 1982, are possible: one at
the beginning of an interval `starts` it, one at its end `finishes` it, and none meets or overlaps anything. So exactly
one of the thirteen holds of any two intervals whose ends are known.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from itertools import pairwise
from typing import Literal, NamedTuple, get_args

AllenRelation = Literal[
    "before", "meets", "overlaps", "starts", "during", "finishes", "equals",
    "after", "met_by", "overlapped_by", "started_by", "contains", "finished_by",
]  # fmt: skip
ALLEN: tuple[AllenRelation, ...] = get_args(AllenRelation)
"""The thirteen: seven, and the inverses of the first six."""
INVERSE: dict[AllenRelation, AllenRelation] = {
    **dict(zip(ALLEN[:6], ALLEN[7:], strict=True)),
    **dict(zip(ALLEN[7:], ALLEN[:6], strict=True)),
    "equals": "equals",
}
"""The relation that holds of (b, a) if the key holds of (a, b)."""
WITHIN: frozenset[AllenRelation] = frozenset({"during", "starts", "finishes", "equals"})
"""The relations that hold of (a, b) if a lies within b, bounds included."""


class Interval(NamedTuple):
    """A stretch of time, bounds included."""

    begin: float
    """s"""
    end: float | None
    """s, not before `begin`; None if it is not known yet: open"""


def relation(a: Interval, b: Interval) -> AllenRelation:
    """The one relation of `a` to `b`, both closed. Raises `ValueError` for an open or reversed interval."""
    if a.end is None or b.end is None or not (a.begin <= a.end and b.begin <= b.end):
        raise ValueError(f"{a}, {b}: expected intervals with an end that is not before their begin")
    return _relation(a.begin, a.end, b.begin, b.end)


def relations(a: Interval, b: Interval, now: float = -math.inf) -> frozenset[AllenRelation]:
    """The relations that are still possible of `a` to `b`: one if both are closed.

    An open end lies anywhere from `now` (s) on: what is known to hold until now does not end before.
    Raises `ValueError` for a reversed interval.
    """
    ends_a, ends_b = _ends(a, b, now), _ends(b, a, now)
    return frozenset(relation(Interval(a.begin, x), Interval(b.begin, y)) for x in ends_a for y in ends_b)


def holds(wanted: AllenRelation | Collection[AllenRelation], a: Interval, b: Interval, now: float = -math.inf) -> bool:
    """Whether `a` is certain to be in one of the `wanted` relations to `b`, wherever open ends turn out to be."""
    names = {wanted} if isinstance(wanted, str) else set(wanted)
    return relations(a, b, now) <= names


def _relation(begin_a: float, end_a: float, begin_b: float, end_b: float) -> AllenRelation:
    if begin_a == begin_b:
        return "equals" if end_a == end_b else "starts" if end_a < end_b else "started_by"
    if end_a == end_b:
        return "finishes" if begin_a > begin_b else "finished_by"
    if end_a <= begin_b:
        return "meets" if end_a == begin_b else "before"
    if end_b <= begin_a:
        return "met_by" if end_b == begin_a else "after"
    if begin_a < begin_b:
        return "contains" if end_a > end_b else "overlaps"
    return "during" if end_a < end_b else "overlapped_by"


def _ends(interval: Interval, other: Interval, now: float) -> list[float]:
    """Where the end may be: one place for each order among the times at hand, two beyond the last of them."""
    if interval.end is not None:
        return [interval.end]
    earliest = max(interval.begin, now)
    known = sorted({earliest, other.begin, other.begin if other.end is None else other.end})
    later = [time for time in known if time >= earliest]
    between = [0.5 * (a + b) for a, b in pairwise(later)]
    return [*later, *between, later[-1] + 1.0, later[-1] + 2.0]
