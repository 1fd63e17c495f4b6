"""Summaries of the timeline: what was over, by hour, day and week, within a bound of bytes; pure.

All is a set of things remembered, and a summary is what remains of the set under one rule. So summaries of one period
are merged in any order, and as often as one likes, with the same result: replicas and restarts need no agreement.
Periods are counted in UTC, and what is remembered has its own times: no time zone and no change of the clocks matters.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import msgspec

from dsr.timeline.entries import EVENT, EXPLAINED, Entry
from dsr.timeline.kinds import ACTION, AGENT, FORBIDDEN, INTENTION, PRESENT, RELATIONS, SURPRISING
from dsr.timeline.remembered import MOST_BYTES, PeriodSummary, Remembered, written_size
from dsr.vocabulary.calibration import CALIBRATED
from dsr.vocabulary.explained import changes_of
from dsr.vocabulary.intentions import FULFILLED, GIVEN_UP
from dsr.vocabulary.observed_actions import KINDS, PICK, PLACE, RELEASE
from dsr.vocabulary.sentences import sentence_of

SURPRISES = frozenset({SURPRISING, EXPLAINED, FORBIDDEN, CALIBRATED})
"""Kinds that tell of what was surprising: these go last."""
_SURPRISING_SHARE = 0.5
"""Of `MOST_BYTES`, the most that surprises take: else a bad day would leave no room for where things were"""
_ENDED = (*FULFILLED, *GIVEN_UP)
_TOLD_BY_KIND = (*RELATIONS, PRESENT, *KINDS)
"""Kinds whose sentence follows from kind and participants"""
_UNEVEN = 64
"""Bytes by which a compressed text may become shorter as something is added: a block of it is written anew"""
_MOMENT = 5.0
"""s for which contact is lost while a thing rests: what is jolted, or seen through noise"""
_HELD = "grasping"
_DEEDS = {kind: rank for rank, kind in enumerate((_HELD, RELEASE, PLACE, PICK), 1)}
"""Kinds that tell that a hand had to do with a thing, the one that tells most of it last"""
_LONGEST_TEXT = 160
"""Characters of a text: a sentence"""
_MOST_NAMES = 8
"""Participants of one thing remembered: more are no sentence any more"""
_DECIMALS = 1
"""Of times, s: a chronicler looks ten times a second"""


class Level(NamedTuple):
    """How finely a stretch of the past is remembered."""

    name: str
    """A word: `hour`, `day`, `week` or `earlier`."""
    span: float
    """s, how long a period is; infinite for all that is left"""
    resolution: float
    """s; of what is alike and shorter, the last within it is remembered"""
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
        begin=round(entry.begin, _DECIMALS), kind=entry.kind, participants=entry.participants[:_MOST_NAMES],
        end=None if entry.type == EVENT else round(entry.end, _DECIMALS), text=text[:_LONGEST_TEXT],
        source=entry.source if entry.kind in RELATIONS else "", confidence=round(entry.confidence, 2),
    )  # fmt: skip


def merged(
    level: Level, summaries: Iterable[tuple[Level, PeriodSummary]], more: Iterable[Remembered] = ()
) -> PeriodSummary:
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
    items = {_rounded(item, level) for item in (*more, *(item for summary in given for item in summary.items))}
    resolution = max([level.resolution, *(summary.resolution for of, summary in merging if of is level)])
    kept, lost = _newest([item for item in items if item.kind in SURPRISES], MOST_BYTES * _SURPRISING_SHARE)
    ordinary = list(thinned((item for item in items if item.kind not in SURPRISES), resolution))
    while _size([*kept, *ordinary]) > MOST_BYTES and resolution < min(level.span, WEEK.span):
        resolution = min(max(1.0, 2.0 * resolution), level.span)
        ordinary = list(thinned(ordinary, resolution))
    ordinary, left_out = _newest(ordinary, MOST_BYTES, kept)
    return PeriodSummary(
        resolution=resolution, complete_from=max([left_out, *(summary.complete_from for summary in given)]),
        surprises_from=max([lost, *(summary.surprises_from for summary in given)]),
        items=tuple(sorted([*kept, *ordinary], key=lambda item: item.order)),
    )  # fmt: skip


def thinned(items: Iterable[Remembered], resolution: float) -> Iterator[Remembered]:
    """Keep all that lasted for a `resolution` (s) or longer, and of what is alike and shorter the last within each.

    Alike are situations of one kind and participants, and all that one hand did with a thing: that it picked the thing
    up stands for all. What is remembered is true: no gap is bridged but those in which contact was lost for a moment.
    With 0, all stays as it is.
    """
    if resolution == 0.0:
        yield from items
        return
    alike: dict[object, list[Remembered]] = defaultdict(list)
    for item in items:
        deed = item.kind in KINDS or item.kind == _HELD
        alike[frozenset(item.participants) if deed else (item.kind, item.participants, item.is_event)].append(item)
    for same in alike.values():
        slots: dict[object, Remembered] = {}
        for item in sorted(_joined(same), key=lambda item: (_DEEDS.get(item.kind, 0), *item.order)):
            is_short = item.last - item.begin < resolution
            slots[math.floor(item.begin / resolution) if is_short else item] = item
        yield from slots.values()


def _joined(alike: Iterable[Remembered]) -> Iterator[Remembered]:
    """What is alike, situations that follow one another within a moment as one."""
    before: dict[tuple[str, tuple[str, ...]], Remembered] = {}
    for item in sorted(alike, key=lambda item: (item.begin, *item.order)):
        key = item.kind, item.participants
        last = before.get(key)
        if item.is_event:
            yield item
        elif last is None or item.begin - last.last > _MOMENT:
            if last is not None:
                yield last
            before[key] = item
        else:
            confidence = min(last.confidence, item.confidence)
            end = max(last.last, item.last)
            before[key] = msgspec.structs.replace(item, begin=last.begin, end=end, confidence=confidence)
    yield from before.values()


def _rounded(item: Remembered, level: Level) -> Remembered:
    """With times in whole seconds, unless the level is the finest."""
    if level.resolution == 0.0:
        return item
    end = None if item.end is None else float(round(item.end))
    return msgspec.structs.replace(item, begin=float(round(item.begin)), end=end)


def _newest(
    items: Iterable[Remembered], room: float, beside: Iterable[Remembered] = ()
) -> tuple[list[Remembered], float]:
    """The newest that have room (bytes) beside others, and until when (s) some are lost; 0 if all stay."""
    ordered, others = sorted(items, key=lambda item: item.order, reverse=True), list(beside)

    def size(number: int) -> int:
        return _size([*others, *ordered[:number]])

    if size(len(ordered)) <= room:
        return ordered, 0.0
    count = max(0, bisect_right(range(len(ordered) + 1), room - _UNEVEN, key=size) - 1)
    while count < len(ordered) and size(count + 1) <= room:  # one by one, for the same end however many there are
        count += 1
    return ordered[:count], ordered[count].last if count < len(ordered) else 0.0


def _size(items: Iterable[Remembered]) -> int:
    """Bytes as they are written."""
    return written_size(sorted(items, key=lambda item: item.order))
