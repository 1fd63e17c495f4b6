"""Recalls the past: entries of the timeline, and beyond them what summaries of hours, days and weeks still hold."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from dsr.clock import is_time
from dsr.errors import WireError
from dsr.graph.elements import Node
from dsr.memory import Memory
from dsr.timeline.entries import Entry
from dsr.timeline.queries import TimelineQuestion, query
from dsr.timeline.remembered import PeriodSummary, decoded_summary
from dsr.timeline.summaries import LEVELS, Level

SUMMARY = "summary"
"""Node type of a summary; it hangs from `timeline`."""
_LEVELS = {level.name: level for level in LEVELS}


class StoredSummary(NamedTuple):
    """A summary as a node of the graph holds it."""

    name: str
    level: Level
    number: int
    """Number of the period since 1970, in UTC"""
    summary: PeriodSummary

    @property
    def begin(self) -> float:
        """Time (s) at which the period begins."""
        return 0.0 if math.isinf(self.level.span) else self.number * self.level.span

    @property
    def end(self) -> float:
        """Time (s) at which the period is over; of all that was earlier, when the last thing remembered was."""
        if math.isinf(self.level.span):
            return max((item.last for item in self.summary.items), default=0.0)
        return self.begin + self.level.span


def period_of(node: Node) -> tuple[Level, int] | None:
    """The period that a summary's node is about, by its level and number; None if it does not say so."""
    level, number = _LEVELS.get(str(node.get("kind", ""))), node.get("order")
    if level is None or not isinstance(number, int):
        return None
    return (level, number) if math.isinf(level.span) or is_time(number * level.span) else None


def read_summary(node: Node) -> StoredSummary | None:
    """The summary that a node holds; None if it is malformed."""
    period, text = period_of(node), node.get("content")
    if period is None or not isinstance(text, str):
        return None
    try:
        return StoredSummary(node.name, *period, decoded_summary(text))
    except WireError:
        return None


def stored_summaries(memory: Memory, since: float = -math.inf, until: float = math.inf) -> Iterator[StoredSummary]:
    """The summaries that hold something from between two times (s), those that are malformed left out."""
    for node in memory.nodes(SUMMARY):
        begin, end = node.get("begin", -math.inf), node.get("end", math.inf)
        if begin <= until and end >= since and (found := read_summary(node)) is not None:
            yield found


def recall(
    memory: Memory,
    *,
    kind: str | Iterable[str] | None = None,
    participants: str | Iterable[str] | None = None,
    since: float | None = None,
    until: float | None = None,
) -> list[Entry]:
    """Find what the timeline or its summaries hold, in the order of their begin.

    What summaries hold has times to a tenth of a second, or of a coarser resolution, and the name of the summary's node
    both as `name` and among the `details`. What both hold is told once, as the timeline has it.

    Args:
        memory: where to look.
        kind: one of these kinds.
        participants: all of these take part.
        since: was not over before this time, s.
        until: had begun by this time, s.

    Raises:
        ConfigError: for what is no name or no time.
    """
    listed_kinds = kind if kind is None or isinstance(kind, str) else tuple(kind)
    names = participants if participants is None or isinstance(participants, str) else tuple(participants)
    found = query(memory, kind=listed_kinds, participants=names, since=since, until=until)
    question = TimelineQuestion(kind=listed_kinds, participants=names, since=since, until=until)
    told = {_same(entry) for entry in found}
    now = memory.clock.now()
    for stored in stored_summaries(memory, *_bounds(since, until)):
        for item in stored.summary.items:
            entry = item.entry(stored.name)
            if question.fits(entry, now) and (mark := _same(entry)) not in told:
                told.add(mark)
                found.append(entry)
    return sorted(found, key=lambda entry: (entry.begin, entry.name))


def _bounds(since: float | None, until: float | None) -> tuple[float, float]:
    return -math.inf if since is None else since, math.inf if until is None else until


def _same(entry: Entry) -> tuple[str, str, tuple[str, ...], float]:
    """What two tellings of one thing have in common."""
    return entry.type, entry.kind, entry.participants, round(entry.begin, 1)
