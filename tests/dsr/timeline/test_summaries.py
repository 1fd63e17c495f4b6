"""Summaries of hours, days and weeks: what they keep, what they lose first, and that merging them is safe."""

from __future__ import annotations

import base64
import random
import zlib
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dsr.errors import WireError
from dsr.timeline.entries import EVENT, SITUATION, Entry
from dsr.timeline.remembered import MOST_BYTES, PeriodSummary, Remembered, decoded_summary, encoded_summary
from dsr.timeline.summaries import (
    DAY,
    EARLIER,
    HOUR,
    LEVELS,
    SURPRISES,
    WEEK,
    Level,
    merged,
    remembered,
)
from dsr.vocabulary.explained import MOVED, ExplainedChange, encoded, text_of

ITEMS = st.builds(
    Remembered,
    begin=st.floats(0.0, 5000.0).map(lambda time: round(time, 1)),
    kind=st.sampled_from(["on", "in", "Pick", "explained", "surprising"]),
    participants=st.sampled_from([("cup", "table"), ("ball", "box"), ("cup", "hand")]),
    end=st.none(),
) | st.builds(
    lambda begin, length, names: Remembered(begin, "on", names, round(begin + length, 1)),
    st.floats(0.0, 5000.0).map(lambda time: round(time, 1)),
    st.floats(0.0, 500.0),
    st.sampled_from([("cup", "table"), ("ball", "box")]),
)  # fmt: skip


def many(count: int, *, kind: str = "on", span: float = 3600.0, seed: int = 0) -> list[Remembered]:
    """Short situations or, for other kinds, events, all of different things."""
    rng = random.Random(seed)
    times = sorted(round(rng.uniform(0.0, span), 1) for _ in range(count))
    return [
        Remembered(time, kind, (f"thing_{number}", "table"), round(time + 5.0, 1) if kind == "on" else None)
        for number, time in enumerate(times)
    ]


@given(st.lists(ITEMS, max_size=30), st.lists(ITEMS, max_size=30), st.sampled_from(LEVELS))
def test_merging_again_changes_nothing_and_order_does_not_matter(
    first: list[Remembered], second: list[Remembered], level: Level
) -> None:
    whole = merged(level, (), [*first, *second])
    assert merged(level, (), [*second, *first]) == whole
    assert merged(level, [(level, whole)]) == whole
    assert merged(level, [(level, whole), (level, whole)], [*first, *second]) == whole
    assert decoded_summary(encoded_summary(whole)) == whole


def test_an_event_and_a_situation_of_the_same_instant_have_an_order() -> None:
    event = Remembered(60.0, "on", ("cup", "table"), None)
    moment = Remembered(60.0, "on", ("cup", "table"), 60.0)
    assert event.order != moment.order


@pytest.mark.parametrize("level", LEVELS)
def test_a_full_summary_is_bounded_and_merging_it_again_changes_nothing(level: Level) -> None:
    items = [*many(3000), *many(600, kind="explained"), *many(1500, kind="Pick")]
    whole = merged(level, (), items)
    assert len(encoded_summary(whole)) <= MOST_BYTES + 200
    assert merged(level, [(level, whole)], items) == whole


def test_an_hour_keeps_all_that_has_room() -> None:
    items = many(50)
    assert set(merged(HOUR, (), items).items) == set(items)


def test_a_day_bridges_a_moment_and_of_what_is_short_keeps_the_last() -> None:
    stays = [
        Remembered(0.0, "on", ("cup", "table"), 1000.0), Remembered(1002.0, "on", ("cup", "table"), 2000.0),
        Remembered(2030.0, "on", ("cup", "table"), 2900.0), Remembered(2000.0, "in", ("cup", "box"), 2029.0),
        Remembered(2901.0, "in", ("cup", "box"), 2910.0), Remembered(2920.0, "in", ("cup", "box"), 2935.0),
    ]  # fmt: skip
    kept = merged(DAY, (), stays).items
    assert [(item.kind, item.begin, item.end) for item in kept] == [
        ("on", 0.0, 2000.0), ("in", 2000.0, 2029.0), ("on", 2030.0, 2900.0), ("in", 2920.0, 2935.0),
    ]  # fmt: skip


def test_that_a_hand_picked_a_thing_up_stands_for_all_that_it_did_in_that_minute() -> None:
    hand = [
        Remembered(65.0, "Pick", ("cup", "hand")), Remembered(66.0, "grasping", ("hand", "cup"), 71.0),
        Remembered(72.0, "Place", ("cup", "hand")), Remembered(73.0, "Place", ("cup", "other")),
    ]  # fmt: skip
    assert {item.kind for item in merged(HOUR, (), hand).items} == {"Pick", "grasping", "Place"}
    kept = merged(DAY, (), hand).items
    assert [(item.kind, item.participants[1]) for item in kept] == [("Pick", "hand"), ("Place", "other")]


@given(st.lists(ITEMS, max_size=40), st.sampled_from(LEVELS))
def test_what_is_remembered_of_places_was_so(items: list[Remembered], level: Level) -> None:
    """But for moments without contact, and for the second to which times are rounded."""
    for kept in merged(level, (), items).items:
        if kept.is_event:
            continue
        same = [one for one in items if (one.kind, one.participants) == (kept.kind, kept.participants)]
        reached = kept.begin
        for one in sorted(same, key=lambda one: one.begin):
            if one.begin <= reached + 7.0 and one.last >= kept.begin - 1.0:
                reached = max(reached, one.last)
        assert reached >= kept.last - 1.0


def test_detail_goes_first() -> None:
    times = np.random.default_rng(0).uniform(0.0, 3600.0, 6000).round(1)
    picks = [Remembered(float(time), "Pick", ("cup", f"hand_{number % 3}")) for number, time in enumerate(times)]
    kept = merged(HOUR, (), picks)
    assert 1.0 <= kept.resolution <= 128.0 and kept.complete_from == 0.0
    assert {item.participants for item in kept.items} == {item.participants for item in picks}
    assert max(b.begin - a.begin for a, b in pairwise(kept.items)) <= 2.0 * kept.resolution


def test_then_goes_the_oldest_and_surprises_last() -> None:
    surprises, ordinary = many(30, kind="explained"), many(1500)
    kept = merged(HOUR, (), [*surprises, *ordinary])
    assert set(surprises) <= set(kept.items) and kept.surprises_from == 0.0
    left = [item for item in kept.items if item.kind == "on"]
    assert left == sorted(ordinary, key=lambda item: item.order)[-len(left) :] and len(left) > 50
    assert kept.complete_from == max(item.last for item in ordinary if item not in left)


def test_surprises_take_half_at_most_and_lose_the_oldest() -> None:
    surprises = many(1500, kind="explained")
    kept = merged(HOUR, (), [*surprises, *many(20)])
    told = [item for item in kept.items if item.kind in SURPRISES]
    assert told == sorted(surprises, key=lambda item: item.order)[-len(told) :] and 20 < len(told) < 1500
    assert kept.surprises_from == max(item.last for item in surprises if item not in told)


def test_a_busy_hour_does_not_coarsen_the_day() -> None:
    hour = merged(HOUR, (), [Remembered(float(time), "Pick", ("cup", "hand")) for time in range(3600)])
    hour = msgspec.structs.replace(hour, resolution=max(hour.resolution, 128.0))
    assert hour.resolution > DAY.resolution
    assert merged(DAY, [(HOUR, hour)], [Remembered(0.0, "on", ("cup", "table"), 80.0)]).resolution == DAY.resolution


def entry(kind: str, type: str = EVENT, **values: object) -> Entry:
    given = {"name": "e", "participants": ("cup", "hand"), "begin": 1.04, "end": 1.04 if type == EVENT else 9.0}
    return Entry(type=type, kind=kind, **{**given, **values})  # type: ignore[arg-type]


def test_what_is_remembered_of_entries() -> None:
    assert remembered(entry("Pick", confidence=0.951)) == Remembered(1.0, "Pick", ("cup", "hand"), confidence=0.95)
    stay = entry("on", SITUATION, source="contact", text="cup on table (contact)")
    assert remembered(stay) == Remembered(1.0, "on", ("cup", "hand"), 9.0, source="contact")
    assert remembered(msgspec.structs.replace(stay, end=None)) is None
    assert remembered(entry("agent", SITUATION)) is None and remembered(entry("action")) is None
    assert remembered(entry("intention", details={"status": "planning", "goal": "g"})) is None
    done = remembered(entry("intention", details={"status": "reached", "goal": "on(a,b)"}))
    assert done is not None and done.entry("s").details == {"summary": "s", "status": "reached", "goal": "on(a,b)"}
    changes = (ExplainedChange(MOVED, (("cup",),)),)
    told = remembered(entry("explained", details={"explanation": text_of(changes), "changes": encoded(changes)}))
    assert told is not None and "cup" in told.text and "(" not in told.text
    long = remembered(entry("Spill", text="x" * 5000, participants=tuple(f"c{number}" for number in range(50))))
    assert long is not None and len(long.text) == 160 and len(long.participants) == 8


ENDLESS = '{"since": 1e308, "items": [[1e308, 0]]}'
FAR = ('{"complete_from": 1e300}', '{"surprises_from": -1e300}', '{"since": 0, "items": [[1e300, 0]]}')
NONSENSE = ("{", '{"items": [[1]]}', '{"resolution": -1}', "[" * 9000, '{"items": 3}', "", ENDLESS, *FAR)


@pytest.mark.parametrize("text", NONSENSE)
def test_nonsense_is_an_error(text: str) -> None:
    assert decoded_summary(packed(b"{}")) == PeriodSummary()
    for malformed in (text, packed(text.encode()), packed(b"{}")[:-2]):
        with pytest.raises(WireError):
            decoded_summary(malformed)


def test_what_unpacks_to_far_more_than_it_is_long_is_not_read() -> None:
    bomb = packed(b" " * 10_000_000 + b"{}")
    assert len(bomb) < 2 * MOST_BYTES
    with pytest.raises(WireError, match="expected an end within 131072 bytes"):
        decoded_summary(bomb)


def test_what_is_written_can_be_read_however_well_it_is_compressed() -> None:
    alike = [Remembered(float(time), "explained", ("cup",), text="x" * 160) for time in range(3000)]
    whole = merged(WEEK, (), alike)
    assert len(whole.items) < 3000 and decoded_summary(encoded_summary(whole)) == whole


def packed(plain: bytes) -> str:
    return base64.b85encode(zlib.compress(plain, 9)).decode()


def test_a_text_that_is_far_too_long_is_not_read() -> None:
    with pytest.raises(WireError, match="expected at most"):
        decoded_summary(encoded_summary(PeriodSummary(items=tuple(many(4000)))))


def test_the_levels_grow_coarser() -> None:
    assert [level.name for level in LEVELS] == ["hour", "day", "week", "earlier"]
    assert all(a.span < b.span and a.resolution < b.resolution for a, b in pairwise(LEVELS))
    assert EARLIER.kept == 0
