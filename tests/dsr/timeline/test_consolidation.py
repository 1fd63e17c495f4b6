"""The timeline over days: bounded, the same after restarts and partitions, and right whatever clocks do."""

from __future__ import annotations

import logging
from collections import Counter

import pytest

from dsr.timeline import SUMMARY, Chronicle, Consolidator, Retention, recall, stored_summaries
from dsr.timeline.consolidation import PERIOD, bucket_of
from dsr.timeline.remembered import MOST_BYTES, PeriodSummary, encoded_summary
from dsr.timeline.summaries import DAY, EARLIER, HOUR, MOST_SUMMARIES, WEEK
from tests.dsr.conftest import Net

HOURS, DAYS = 3600.0, 86400.0
START = 20_000 * DAYS
"""s, a midnight in UTC"""


class Kitchen:
    """A memory with a timeline, in a network of its own or one that is shared."""

    def __init__(self, name: str = "keeper", net: Net | None = None, start: float = START) -> None:
        self.net = net or Net()
        self.clock = self.net.clock
        self.clock.advance_to(max(self.clock.now(), start))
        self.memory = self.net.join(name)
        self.net.pump(1.0 if net else 0.0)
        self.chronicle = Chronicle(self.memory, name, keep=Retention(1000, HOURS))
        self.consolidator = Consolidator(self.memory)

    def move(self, thing: str, old: str, new: str, hand: str = "anne") -> None:
        """Move a thing now."""
        for open_one in self.chronicle.query(kind="on", participants=(thing, old), open=True):
            self.chronicle.end(open_one.name)
        self.chronicle.happened("Pick", (thing, hand), confidence=0.9)
        self.chronicle.happened("Place", (thing, hand))
        self.chronicle.begin("on", (thing, new), source="contact")

    def until(self, day: float, step: float = HOURS) -> None:
        """Let time pass until so many days after the start."""
        while self.clock.now() < START + day * DAYS - 1e-6:
            self.clock.advance(min(step, START + day * DAYS - self.clock.now()))
            self.consolidator.update()
            self.chronicle.forget()
            self.net.pump()

    def place(self, thing: str, day: float) -> list[str]:
        """What a thing was on so many days after the start."""
        time = START + day * DAYS
        found = recall(self.memory, kind="on", participants=thing, since=time, until=time)
        return [entry.participants[1] for entry in found if entry.begin <= time < entry.last]

    def levels(self) -> Counter[str]:
        return Counter(stored.level.name for stored in stored_summaries(self.memory))


def routine(kitchen: Kitchen, days: int) -> None:
    """The cup goes to the shelf at 10 and back to the table at 15 h, carried by anne and, on each seventh day, ben."""
    kitchen.move("cup", "nowhere", "table")
    for day in range(days):
        hand = "ben" if day % 7 == 3 else "anne"
        kitchen.until(day + 10 / 24)
        kitchen.move("cup", "table", "shelf", hand)
        kitchen.until(day + 15 / 24)
        kitchen.move("cup", "shelf", "table", hand)
        if day == 4:
            kitchen.chronicle.happened("explained", "cup", explanation="moved(cup)", text="moved(cup)")
    kitchen.until(days)


def test_thirty_days_are_answered_long_after_the_timeline_forgot_them() -> None:
    kitchen = Kitchen()
    routine(kitchen, 30)
    assert len(kitchen.chronicle.query()) < 10
    for day in range(30):
        assert kitchen.place("cup", day + 12 / 24) == ["shelf"], day
        assert kitchen.place("cup", day + 20 / 24) == ["table"], day
    moved = recall(kitchen.memory, kind="Pick", participants="cup", since=START + 3 * DAYS, until=START + 4 * DAYS)
    assert {entry.participants[1] for entry in moved} == {"ben"} and moved[0].confidence == 0.9
    [surprise] = recall(kitchen.memory, kind="explained")
    assert surprise.begin == START + 4 * DAYS + 15 * HOURS
    assert kitchen.levels() == {"hour": 2, "day": 29}  # yesterday's two moves, and all days before


def test_more_than_a_year_is_bounded() -> None:
    kitchen = Kitchen()
    for day in range(400):
        for number in range(6):
            kitchen.move(f"thing_{number}", "table", "table", f"hand_{day % 3}")
        kitchen.chronicle.happened("explained", "thing_1", explanation="moved(thing_1)")
        kitchen.until(day + 1, step=DAYS)
    nodes = list(kitchen.memory.nodes(SUMMARY))
    assert len(nodes) <= MOST_SUMMARIES
    assert max(len(node["content"]) for node in nodes) <= MOST_BYTES + 200
    assert kitchen.levels()["week"] <= 53 and kitchen.levels()["earlier"] == 1
    assert len(recall(kitchen.memory, kind="explained", until=START + 100 * DAYS)) > 20


def test_periods_grow_coarser_with_age() -> None:
    now = START + 400.5 * DAYS
    ages = {0.0: HOUR, 1.0: HOUR, 2.0: DAY, 20.0: DAY, 40.0: WEEK, 360.0: WEEK, 390.0: EARLIER}
    for age, level in ages.items():
        hour = int((now - age * DAYS) // HOURS)
        assert bucket_of(HOUR, hour, now)[0] is level, age


def told(kitchen: Kitchen) -> set[tuple[str, tuple[str, ...], int]]:
    """What is recalled of places and of who moved things, and when (s)."""
    kinds = ("on", "Pick", "explained")
    return {(entry.kind, entry.participants, round(entry.begin)) for entry in recall(kitchen.memory, kind=kinds)}


def test_a_restart_goes_on_and_a_half_done_step_is_finished() -> None:
    kitchen = Kitchen()
    routine(kitchen, 3)
    before = told(kitchen)
    hours = [node for node in kitchen.memory.nodes(SUMMARY) if node["kind"] == "hour"]
    again = Kitchen("again", kitchen.net)
    again.until(4)  # the hours have become a day
    left = {node.name for node in again.memory.nodes(SUMMARY) if node["kind"] == "hour"}
    lost = [node for node in hours if node.name not in left]
    assert lost
    for node in lost:  # a process that was ended after it had written the day, and before it removed the hours
        again.memory.add_node(node.name, SUMMARY, **node.attributes)
    torn = told(again)
    third = Kitchen("third", kitchen.net)
    third.consolidator.consolidate()
    assert not {node.name for node in lost} & {node.name for node in third.memory.nodes(SUMMARY)}
    assert before <= torn and before <= told(third)


def test_keepers_that_were_cut_off_from_each_other_lose_nothing_and_agree() -> None:
    one = Kitchen("one")
    net = one.net
    two = Kitchen("two", net)
    one.move("cup", "nowhere", "table")
    net.pump(1.0)
    net.network.partition(["one"], ["two"])
    one.until(0.2)
    one.move("cup", "table", "shelf", "anne")
    two.chronicle.happened("Pick", ("ball", "ben"))
    one.until(0.3)
    two.consolidator.consolidate()
    assert not recall(one.memory, participants="ball")
    net.network.heal()
    net.pump(20.0)
    for kitchen in (one, two, one):
        kitchen.consolidator.consolidate()
        net.pump(1.0)
    both = [[(entry.kind, entry.participants, entry.begin) for entry in recall(k.memory)] for k in (one, two)]
    assert both[0] == both[1] and {("Pick", ("ball", "ben")), ("Pick", ("cup", "anne"))} <= {one[:2] for one in both[0]}
    one.until(3)
    summaries = Counter((stored.level.name, stored.number) for stored in stored_summaries(one.memory))
    assert set(summaries.values()) == {1}
    assert {entry.participants for entry in recall(one.memory, kind="Pick")} == {("ball", "ben"), ("cup", "anne")}


def test_damaged_summaries_are_left_alone_and_told(caplog: pytest.LogCaptureFixture) -> None:
    kitchen = Kitchen()
    routine(kitchen, 2)
    day = int(START // DAYS) + 1  # which is written once the third day begins
    empty = encoded_summary(PeriodSummary())
    for name, values in {
        "summary_a": {"content": "{", "kind": "day", "order": day}, "summary_b": {"kind": "day"},
        "summary_c": {"content": empty, "kind": "century", "order": 1}, "summary_d": {},
        "summary_e": {"content": empty, "kind": "hour", "order": -(2**62)},
    }.items():  # fmt: skip
        kitchen.memory.add_node(name, SUMMARY, **values)
    with caplog.at_level(logging.WARNING):
        kitchen.until(3)
    [warning] = [one.message for one in caplog.records if "cannot be read" in one.message]
    assert "summary_a" in warning and "summary_a" in kitchen.memory
    assert kitchen.place("cup", 12 / 24) == ["shelf"]


def test_a_clock_that_jumps_ahead_and_back_costs_no_question() -> None:
    kitchen = Kitchen()
    routine(kitchen, 1)
    ahead = Kitchen("ahead", start=START + 3 * DAYS)
    ahead.move("ball", "nowhere", "box")
    ahead.clock.advance(60.0)
    ahead.consolidator.consolidate()
    [stored] = stored_summaries(ahead.memory)
    node = ahead.memory.node(stored.name)
    kitchen.memory.add_node(stored.name, SUMMARY, **node.attributes)  # from a run whose clock was two days ahead
    kitchen.consolidator.consolidate()
    hours = [stored.number for stored in stored_summaries(kitchen.memory) if stored.level is HOUR]
    assert max(hours) <= kitchen.clock.now() // HOURS
    assert recall(kitchen.memory, kind="Pick", participants="ball")
    assert kitchen.place("cup", 12 / 24) == ["shelf"]


def test_what_is_told_late_is_kept_with_its_own_time() -> None:
    """As by an agent that finds at its start that something was over days ago."""
    kitchen = Kitchen()
    kitchen.until(10, step=DAYS)
    name = kitchen.chronicle.begin("on", ("cup", "table"), START + 1 * DAYS)
    kitchen.chronicle.end(name, START + 2 * DAYS)
    kitchen.consolidator.consolidate()
    kitchen.clock.advance(10.0)
    kitchen.chronicle.forget()
    assert name not in kitchen.memory and kitchen.place("cup", 1.5) == ["table"]
    kitchen.until(60, step=DAYS)
    assert kitchen.place("cup", 1.5) == ["table"]


def test_it_looks_now_and_then() -> None:
    kitchen = Kitchen()
    assert kitchen.consolidator.update() and not kitchen.consolidator.update()
    kitchen.clock.advance(PERIOD)
    assert kitchen.consolidator.update()


def test_what_both_hold_is_told_once() -> None:
    kitchen = Kitchen()
    kitchen.move("cup", "nowhere", "table")
    kitchen.clock.advance(1.0)
    kitchen.consolidator.consolidate()
    assert len(recall(kitchen.memory, kind="Pick")) == 1
    assert "summary" not in recall(kitchen.memory, kind="Pick")[0].details
