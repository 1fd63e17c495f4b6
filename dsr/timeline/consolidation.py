"""Consolidates the timeline: what is over goes into summaries of hours, these into days, weeks, and all before.

Each process writes summaries of its own, and merges those of others as it writes. Merging is that of sets: nothing is
lost or told twice if two do it at once, or one ends in the midst of it.
"""

from __future__ import annotations

import logging
import math
from collections import defaultdict
from collections.abc import Iterable

from dsr.memory import Memory
from dsr.timeline.entries import TIMELINE, Entry
from dsr.timeline.recall import SUMMARY, StoredSummary, period_of, read_summary
from dsr.timeline.remembered import PeriodSummary, Remembered, encoded_summary
from dsr.timeline.retention import read_all
from dsr.timeline.summaries import DAY, HOUR, LEVELS, Level, merged, remembered

SUMMARY_NODES = (SUMMARY,)
"""Node types that an agent with a `Consolidator` declares to write, besides those of a `Chronicle`."""
SUMMARY_ATTRIBUTES = ("kind", "order", "begin", "end", "content")
"""Attributes that it writes."""
PERIOD = 30.0
"""s between two looks: half of what entries of writers that are gone are kept at least"""
_Bucket = tuple[Level, int]
"""A level and the number of a period."""

_log = logging.getLogger(__name__)


class Consolidator:
    """Writes the summaries of a timeline. Only the agent that keeps the timeline should have one that it updates.

    Args:
        memory: of which `clock` tells the time.
    """

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._looked = -math.inf
        self._unreadable: set[str] = set()

    def update(self) -> bool:
        """Consolidate if that was not done within `PERIOD`; whether it was done."""
        monotonic = self._memory.clock.monotonic()
        if monotonic - self._looked < PERIOD:
            return False
        self._looked = monotonic
        self.consolidate()
        return True

    def consolidate(self) -> None:
        """Take what is over into the summaries, and coarsen what is old."""
        now = self._memory.clock.now()
        found: dict[_Bucket, list[str]] = defaultdict(list)
        moved: set[_Bucket] = set()
        for node in self._memory.nodes(SUMMARY):
            if (period := period_of(node)) is not None:
                bucket = bucket_of(*period, now)
                found[bucket].append(node.name)
                moved |= {bucket} - {period}
        news = _by_hour(read_all(self._memory), now)
        with self._memory.batch():
            for bucket in {*moved, *news}:
                self._write(bucket, found[bucket], news.get(bucket, ()))

    def _write(self, bucket: _Bucket, names: Iterable[str], news: Iterable[Remembered]) -> None:
        """Make one summary, our own, of all that there are of a period."""
        level, index = bucket
        own = f"{SUMMARY}_{level.name}_{index}_{self._memory.rid}"
        stored = [one for name in names if (one := self._read(name)) is not None]
        summary = merged(level, ((one.level, one.summary) for one in stored), news)
        if [one.name for one in stored] != [own] or stored[0].summary != summary:
            self._put(own, level, index, summary)
        for one in stored:
            if one.name != own:
                self._memory.remove_node(one.name)

    def _read(self, name: str) -> StoredSummary | None:
        """A summary; None for one that cannot be read, which stays as it is: a newer version may know better."""
        stored = read_summary(self._memory.node(name))
        if stored is None and name not in self._unreadable:
            self._unreadable.add(name)
            _log.warning("summary %s cannot be read, and is left alone", name)
        return stored

    def _put(self, name: str, level: Level, index: int, summary: PeriodSummary) -> None:
        memory = self._memory
        values = {
            "kind": level.name, "order": index, "content": encoded_summary(summary),
            "begin": min((item.begin for item in summary.items), default=0.0),
            "end": max((item.last for item in summary.items), default=0.0),
        }  # fmt: skip
        if name in memory:
            memory.update_node(name, **values)
            return
        if TIMELINE not in memory:
            memory.add_node(TIMELINE, TIMELINE)
        memory.add_node(name, SUMMARY, **values)
        memory.add_edge(TIMELINE, name, "has")


def bucket_of(level: Level, index: int, now: float) -> _Bucket:
    """The period to which a summary of another one belongs at time `now` (s).

    It becomes coarser as it grows old. A period after now comes from a clock that ran ahead: that is the current one.
    """
    for coarser in LEVELS[LEVELS.index(level) + 1 :]:
        index = min(index, _period(level, now))
        begin = index * level.span
        counted = level if math.isinf(coarser.span) else coarser
        if _period(counted, now) - _period(counted, begin) <= level.kept:
            return level, index
        level, index = coarser, _period(coarser, begin)
    return level, 0


def _by_hour(entries: Iterable[Entry], now: float) -> dict[_Bucket, list[Remembered]]:
    """What is over at time `now` (s), by the hour in which it was over.

    What is told of a time whose hours are days by now goes into the first hour that there is.
    """
    first, last = (_period(DAY, now) - HOUR.kept) * DAY.span, now
    found: dict[_Bucket, list[Remembered]] = defaultdict(list)
    for entry in entries:
        if entry.end is not None and entry.end <= now and (item := remembered(entry)) is not None:
            found[HOUR, _period(HOUR, min(max(item.last, first), last))].append(item)
    return found


def _period(level: Level, time: float) -> int:
    """Number of the period in which a time (s) lies."""
    return 0 if math.isinf(level.span) else math.floor(time / level.span)
