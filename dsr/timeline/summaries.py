"""Summaries of the timeline: what was over, by hour, day and week, within a bound of bytes; pure.

All is a set of things remembered, and a summary is what remains of the set under one rule. So summaries of one period
are merged in any order, and as often as one likes, with the same result: replicas and restarts need no agreement.
Periods are counted in UTC, and what is remembered has its own times: no time zone and no change of the clocks matters.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Annotated, NamedTuple

import msgspec

from dsr.errors import WireError
from dsr.network.decoding import decoded
from dsr.timeline.entries import EVENT, EXPLAINED, SITUATION, Entry
from dsr.timeline.kinds import ACTION, AGENT, FORBIDDEN, INTENTION, PRESENT, RELATIONS, SURPRISING
from dsr.vocabulary.calibration import CALIBRATED
from dsr.vocabulary.explained import changes_of
from dsr.vocabulary.intentions import FULFILLED, GIVEN_UP
from dsr.vocabulary.observed_actions import KINDS
from dsr.vocabulary.sentences import sentence_of

MOST_BYTES = 8192
"""Bytes of what a summary holds: about a hundred things remembered, a page that a person reads in some minutes"""
SURPRISES = frozenset({SURPRISING, EXPLAINED, FORBIDDEN, CALIBRATED})
"""Kinds that tell of what was surprising: these go last."""
_SURPRISING_SHARE = 0.5
"""Of `MOST_BYTES`, the most that surprises take: else a bad day would leave no room for where things were"""
_ENDED = (*FULFILLED, *GIVEN_UP)
_TOLD_BY_KIND = (*RELATIONS, PRESENT, *KINDS)
"""Kinds whose sentence follows from kind and participants"""
_LONGEST_TEXT = 160
"""Characters of a text: a sentence"""
_MOST_NAMES = 8
"""Participants of one thing remembered: more are no sentence any more"""
_ROUNDING = 1
"""Decimals of times, s: a chronicler looks ten times a second"""


class Level(NamedTuple):
    """How finely a stretch of the past is remembered."""

    name: str
    """A word: `hour`, `day`, `week` or `earlier`."""
    span: float
    """s, how long a period is; infinite for all that is left"""
    resolution: float
    """s; of what is alike and shorter, the last within it is remembered, and gaps as short are bridged"""
    kept: int
    """Periods of the next level before the current one whose parts are still told apart; of the last but one, weeks"""


HOUR = Level("hour", 3600.0, 0.0, 1)
DAY = Level("day", 86400.0, 60.0, 4)
WEEK = Level("week", 604800.0, 900.0, 52)
EARLIER = Level("earlier", math.inf, 3600.0, 0)
LEVELS = (HOUR, DAY, WEEK, EARLIER)
"""From fine to coarse. The hours of today and yesterday, the days of this week and four before, the weeks of a year."""
MOST_SUMMARIES = 48 + 35 + 53 + 1
"""Summaries of one writer: hours of two days, days of five weeks, weeks of a year and one, and one of all before"""


class Remembered(msgspec.Struct, frozen=True, array_like=True):
    """An event or a situation that was over, as it is remembered."""

    begin: float
    """s, to a tenth; of an event, when it happened"""
    kind: str
    """As of the entry: `on`, `Pick`, `explained`."""
    participants: tuple[str, ...]
    """As of the entry, the first eight."""
    end: float | None = None
    """s, to a tenth; None for an event"""
    text: str = ""
    """A sentence, of what cannot be told from kind and participants."""
    source: str = ""
    confidence: float = 1.0
    """Probability (0 to 1) that it is true."""

    @property
    def is_event(self) -> bool:
        """Whether it happened at an instant."""
        return self.end is None

    @property
    def last(self) -> float:
        """Time (s) when it was over."""
        return self.begin if self.end is None else self.end

    def entry(self, name: str) -> Entry:
        """The entry that it was, by the name of the summary that holds it."""
        details = {"summary": name}
        if self.kind == INTENTION:
            details["status"], _, details["goal"] = self.text.partition(": ")
        return Entry(
            name=name, type=EVENT if self.is_event else SITUATION, kind=self.kind, participants=self.participants,
            begin=self.begin, end=self.last, text=self.text, confidence=self.confidence, source=self.source,
            details=details,
        )  # fmt: skip

    @property
    def order(self) -> tuple[float, float, str, tuple[str, ...], str, str, float]:
        """By which things remembered are sorted: the times of being over first."""
        return self.last, self.begin, self.kind, self.participants, self.text, self.source, self.confidence


class Summary(msgspec.Struct, frozen=True):
    """What is remembered of a period."""

    resolution: Annotated[float, msgspec.Meta(ge=0.0)] = 0.0
    """s; of what is alike within it, the last is remembered: no finer than that of the level"""
    complete_from: float = 0.0
    """s; of what was over before and not surprising, some is lost"""
    surprises_from: float = 0.0
    """s; of the surprises that were over before, some are lost"""
    items: tuple[Remembered, ...] = ()
    """In the order in which they were over."""


_decoder = msgspec.json.Decoder(Summary)


def encoded_summary(summary: Summary) -> str:
    """A summary as text."""
    return msgspec.json.encode(summary).decode()


def decoded_summary(text: str) -> Summary:
    """The summary of a text. Raises `WireError`, also for one that is far too long."""
    if len(text) > 2 * MOST_BYTES:
        raise WireError(f"malformed summary: {len(text)} characters, expected at most {2 * MOST_BYTES}")
    return decoded(text, "summary", _decoder.decode)


def remembered(entry: Entry) -> Remembered | None:
    """What is to be remembered of an entry that is over; None for what days later nobody asks for.

    Runs of agents and steps of plans go; of intentions, only how they ended stays.
    """
    if entry.end is None or entry.kind in (AGENT, ACTION):
        return None
    text = entry.text
    if entry.kind == INTENTION:
        status = str(entry.details.get("status", ""))
        if entry.type != EVENT or status not in _ENDED:
            return None
        text = f"{status}: {entry.details.get('goal', '')}"
    elif entry.kind == EXPLAINED:
        told = str(entry.details.get("explanation", entry.text))
        text = sentence_of(changes_of(entry.details, told)) or told
    elif entry.kind in _TOLD_BY_KIND:
        text = ""
    return Remembered(
        begin=round(entry.begin, _ROUNDING), kind=entry.kind, participants=entry.participants[:_MOST_NAMES],
        end=None if entry.type == EVENT else round(entry.end, _ROUNDING), text=text[:_LONGEST_TEXT],
        source=entry.source if entry.kind in RELATIONS else "", confidence=round(entry.confidence, 2),
    )  # fmt: skip


def merged(level: Level, summaries: Iterable[tuple[Level, Summary]], more: Iterable[Remembered] = ()) -> Summary:
    """Merge summaries of a period, and what else is to be remembered of it, within the bound of bytes.

    What is ordinary loses detail first: the resolution is doubled until what remains has room, up to the length of the
    period, and then the oldest is lost. Of surprises only the oldest are lost, once they fill their share.

    Args:
        level: of the result.
        summaries: of that time, each with its level: this one or a finer one.
        more: what else was over then.
    """
    merging = list(summaries)
    given = [summary for _, summary in merging]
    items = {*more, *(item for summary in given for item in summary.items)}
    resolution = max([level.resolution, *(summary.resolution for of, summary in merging if of is level)])
    kept, lost = _newest([item for item in items if item.kind in SURPRISES], MOST_BYTES * _SURPRISING_SHARE)
    room = MOST_BYTES - sum(map(_size, kept))
    ordinary = list(thinned((item for item in items if item.kind not in SURPRISES), resolution))
    while sum(map(_size, ordinary)) > room and resolution < min(level.span, WEEK.span):
        resolution = min(max(1.0, 2.0 * resolution), level.span)
        ordinary = list(thinned(ordinary, resolution))
    ordinary, left_out = _newest(ordinary, room)
    return Summary(
        resolution=resolution, complete_from=max([left_out, *(summary.complete_from for summary in given)]),
        surprises_from=max([lost, *(summary.surprises_from for summary in given)]),
        items=tuple(sorted([*kept, *ordinary], key=lambda item: item.order)),
    )  # fmt: skip


def thinned(items: Iterable[Remembered], resolution: float) -> Iterator[Remembered]:
    """Keep of what is alike (kind and participants) the last within each `resolution` (s), and all that lasted longer.

    Situations with shorter gaps between them are joined before. With 0, all stay, and only what touches is joined.
    """
    alike: dict[tuple[str, tuple[str, ...], bool], list[Remembered]] = defaultdict(list)
    for item in items:
        alike[item.kind, item.participants, item.is_event].append(item)
    for (_, _, is_event), same in alike.items():
        slots: dict[object, Remembered] = {}
        for item in sorted(same if is_event else _joined(same, resolution), key=lambda item: item.order):
            is_short = resolution > 0.0 and item.last - item.begin < resolution
            slots[math.floor(item.begin / resolution) if is_short else item] = item
        yield from slots.values()


def _joined(same: Iterable[Remembered], gap: float) -> list[Remembered]:
    """Situations of one kind and participants, those apart by less than `gap` (s) as one."""
    found: list[Remembered] = []
    for item in sorted(same, key=lambda item: (item.begin, *item.order)):
        before = found[-1] if found else None
        if before is None or not (item.begin <= before.last or item.begin - before.last < gap):
            found.append(item)
        else:
            found[-1] = msgspec.structs.replace(
                item, begin=before.begin, end=max(before.last, item.last),
                confidence=min(before.confidence, item.confidence),
            )  # fmt: skip
    return found


def _newest(items: Iterable[Remembered], room: float) -> tuple[list[Remembered], float]:
    """The newest that have room (bytes), and until when (s) some are lost; 0 if all stay."""
    used, kept = 0, list[Remembered]()
    for item in sorted(items, key=lambda item: item.order, reverse=True):
        used += _size(item)
        if used > room:
            return kept, item.last
        kept.append(item)
    return kept, 0.0


def _size(item: Remembered) -> int:
    """Bytes as JSON, with the comma."""
    return len(msgspec.json.encode(item)) + 1
