"""Allen's relations: thirteen, exactly one of any two intervals, instants and open ends included."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dsr.timeline import ALLEN, INVERSE, AllenRelation, Interval, holds, relation, relations

TIMES = st.integers(0, 6).map(float)


@st.composite
def intervals(draw: st.DrawFn) -> Interval:
    begin = draw(TIMES)
    return Interval(begin, begin + draw(TIMES))


@st.composite
def perhaps_open(draw: st.DrawFn) -> Interval:
    interval = draw(intervals())
    return draw(st.sampled_from([interval, Interval(interval.begin, None)]))


@pytest.mark.parametrize(
    ("a", "expected"),
    [
        ((0, 2), "before"), ((0, 4), "meets"), ((0, 6), "overlaps"), ((4, 6), "starts"), ((5, 6), "during"),
        ((6, 8), "finishes"), ((4, 8), "equals"), ((9, 10), "after"), ((8, 9), "met_by"), ((5, 9), "overlapped_by"),
        ((4, 9), "started_by"), ((3, 9), "contains"), ((3, 8), "finished_by"),
        ((3, 3), "before"), ((4, 4), "starts"), ((5, 5), "during"), ((8, 8), "finishes"), ((9, 9), "after"),
    ],
)  # fmt: skip
def test_each_relation_to_the_same_interval(a: tuple[int, int], expected: AllenRelation) -> None:
    assert relation(Interval(*map(float, a)), Interval(4.0, 8.0)) == expected


def test_two_instants_are_before_after_or_equal() -> None:
    at_4, at_5 = Interval(4.0, 4.0), Interval(5.0, 5.0)
    assert [relation(at_4, at_5), relation(at_5, at_4), relation(at_4, at_4)] == ["before", "after", "equals"]


def definitions(a: Interval, b: Interval) -> dict[AllenRelation, bool]:
    """Allen's own, for intervals of positive length."""
    assert a.end is not None and b.end is not None
    seven: dict[AllenRelation, bool] = {
        "before": a.end < b.begin,
        "meets": a.end == b.begin,
        "overlaps": a.begin < b.begin < a.end < b.end,
        "starts": a.begin == b.begin and a.end < b.end,
        "during": b.begin < a.begin and a.end < b.end,
        "finishes": b.begin < a.begin and a.end == b.end,
        "equals": a == b,
    }
    return seven


@given(intervals(), intervals())
def test_it_is_allens_relation_where_both_last(a: Interval, b: Interval) -> None:
    if a.end == a.begin or b.end == b.begin:
        return
    found = relation(a, b)
    forward, backward = definitions(a, b), definitions(b, a)
    for name in ALLEN[:7]:
        assert forward[name] is (found == name)
        assert backward[name] is (found == INVERSE[name])


@given(intervals(), intervals())
def test_the_inverse_holds_the_other_way_round(a: Interval, b: Interval) -> None:
    assert relation(b, a) == INVERSE[relation(a, b)]
    assert relations(a, b) == {relation(a, b)}


@given(perhaps_open(), perhaps_open(), st.integers(0, 14).map(float), st.data())
def test_open_ends_leave_possible_exactly_what_some_end_brings_about(
    a: Interval, b: Interval, now: float, data: st.DataObject
) -> None:
    possible = relations(a, b, now)
    assert {INVERSE[name] for name in possible} == relations(b, a, now)

    def closed(interval: Interval) -> Interval:
        if interval.end is not None:
            return interval
        earliest = max(interval.begin, now)
        return Interval(interval.begin, earliest + data.draw(st.integers(0, 20)) / 4)

    assert relation(closed(a), closed(b)) in possible


def test_what_lasts_is_certain_only_where_its_end_does_not_matter() -> None:
    lasting, past = Interval(5.0, None), Interval(1.0, 3.0)
    assert relations(lasting, past) == {"after"} and holds("after", lasting, past)
    assert relations(Interval(1.0, None), Interval(2.0, 3.0), now=4.0) == {"contains"}
    assert relations(Interval(1.0, None), Interval(2.0, 3.0), now=2.5) == {"overlaps", "finished_by", "contains"}
    assert relations(Interval(1.0, None), Interval(1.0, None), now=9.0) == {"starts", "equals", "started_by"}
    assert holds(("overlaps", "finished_by", "contains"), Interval(1.0, None), Interval(2.0, 3.0), now=2.5)
    assert not holds("contains", Interval(1.0, None), Interval(2.0, 3.0), now=2.5)


@pytest.mark.parametrize("wrong", [Interval(2.0, None), Interval(2.0, 1.0), Interval(2.0, math.nan)])
def test_one_relation_needs_closed_intervals(wrong: Interval) -> None:
    with pytest.raises(ValueError, match="expected intervals"):
        relation(wrong, Interval(0.0, 1.0))
