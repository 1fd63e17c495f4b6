"""What the timeline and its summaries tell of a time: the relations that held then, and what was done."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable

from dsr.narration.calendar import TimeSpan, moment_words, span_words
from dsr.narration.happenings import entry_evidence, entry_statements
from dsr.narration.statements import Basis, Moment, Statement, Subject, ago, length_of_time, sentence_begin
from dsr.timeline import EXPLAINED, Entry, recall, stored_summaries
from dsr.vocabulary.calibration import CALIBRATED
from dsr.vocabulary.explained import (
    APPEARED,
    CAMERA_MOVED,
    FALSE_PERCEPT,
    HELD_TOO,
    KINDS,
    NOTHING_CHANGED,
    REMOVED,
    TAKEN_ALONG,
    changes_of,
)
from dsr.vocabulary.observed_actions import PICK, PLACE, RELEASE
from dsr.vocabulary.sentences import RELATION_WORDS

_HELD = ("on", "in", "grasping")
_DOINGS: dict[str, tuple[str, ...]] = {
    "pick": (PICK,), "put": (PLACE,), "drop": (RELEASE,), "remove": (EXPLAINED, PICK),
    "move": (PICK, EXPLAINED, CALIBRATED), "fall": (EXPLAINED, RELEASE), "appear": ("present",), "vanish": ("present",),
}  # fmt: skip
"""Kinds of entries that tell of what was done, by the word of a question."""
_MOVING = {
    "move": frozenset(KINDS) - {CAMERA_MOVED, FALSE_PERCEPT, NOTHING_CHANGED, APPEARED},
    "remove": frozenset({REMOVED, TAKEN_ALONG}),
}  # fmt: skip
"""Kinds of explained changes that tell that a thing was moved or taken away."""
_MOST_PERIODS = 3
"""Periods that a sentence tells one by one"""


def relations_during(moment: Moment, name: str, span: TimeSpan) -> list[Entry]:
    """The relations of a thing to what it was on, in or held by in a time, as far as they are remembered.

    That a thing rested on what it was in goes without saying.
    """
    found = _during(recall(moment.memory, kind=_HELD, participants=name, since=span.begin, until=span.end), span)
    inside = {entry.participants for entry in found if entry.kind == "in"}
    mine = [entry for entry in found if _is_of(entry, name)]
    return [entry for entry in mine if not (entry.kind == "on" and entry.participants in inside)]


def contents_during(moment: Moment, name: str, kinds: Collection[str], span: TimeSpan) -> list[Entry]:
    """The relations of these kinds that things had to `name` in a time."""
    found = recall(moment.memory, kind=kinds, participants=name, since=span.begin, until=span.end)
    return [entry for entry in _during(found, span) if entry.participants[1:] == (name,)]


def told_during(moment: Moment, entries: Iterable[Entry], span: TimeSpan) -> list[Statement]:
    """Relations of the past as sentences, one for all times of each. The longest comes first.

    Nobody can tell of each whether it was seen: they are beliefs of then.
    """
    alike: dict[tuple[str, tuple[str, ...]], list[Entry]] = defaultdict(list)
    for entry in entries:
        alike[entry.kind, entry.participants].append(entry)
    rated = sorted(alike.values(), key=lambda same: -sum(_length(entry, span, moment.now) for entry in same))
    return [_told(moment, same, span) for same in rated]


def doings(moment: Moment, name: str, word: str, span: TimeSpan | None = None) -> list[Statement]:
    """What was done with a thing, the newest last: events of the kinds that the word of a question means."""
    entries = recall(
        moment.memory, kind=_DOINGS[word], participants=name, since=None if span is None else span.begin,
        until=None if span is None else span.end,
    )  # fmt: skip
    wanted = [entry for entry in entries if _tells_of(entry, name, word)]
    told = within(entry_statements(moment, wanted), span)
    if word in ("appear", "vanish"):
        return [one for one in told if one.claims[0].relation == ("appeared" if word == "appear" else "disappeared")]
    if word == "fall":
        return [one for one in told if one.evidence["kind"] != EXPLAINED or "fell" in one.text]
    return told


def _tells_of(entry: Entry, name: str, word: str) -> bool:
    """Whether an entry of a fitting kind tells that this was done with a thing; summaries hold no typed changes."""
    if word == "vanish":
        return entry.end is not None
    if entry.kind == CALIBRATED:
        return entry.participants[:1] == (name,)
    if entry.kind != EXPLAINED or word not in _MOVING:
        return True
    changes = changes_of(entry.details, str(entry.details.get("explanation", "")))
    return not changes or any(
        change.kind.removeprefix(HELD_TOO) in _MOVING[word] and any(name in group for group in change.groups)
        for change in changes
    )


def within(told: Iterable[Statement], span: TimeSpan | None) -> list[Statement]:
    """Those statements whose events were in a time; all if there is none."""
    return [one for one in told if span is None or span.begin <= (one.time or 0.0) <= span.end]


def limits_of_memory(moment: Moment, span: TimeSpan, evidence: Iterable[Statement] = ()) -> str:
    """A sentence on how finely a time is remembered, or that some of it is forgotten; empty if all is there."""
    stored = list(stored_summaries(moment.memory, span.begin, span.end))
    used = {str(one.evidence.get("summary", "")) for one in evidence}
    coarse = max((one.summary.resolution for one in stored if one.name in used), default=0.0)
    parts = [f"This is remembered to within {length_of_time(coarse)}."] if coarse > 0.0 else []
    lost = max((one.summary.complete_from for one in stored), default=0.0)
    if lost > span.begin:
        when = moment_words(min(lost, span.end), moment.now, moment.zone)
        parts.append(f"Some of what was over before then, {when}, is forgotten.")
    return " ".join(parts)


def _told(moment: Moment, same: list[Entry], span: TimeSpan) -> Statement:
    """All times of one relation in one sentence."""
    first = same[0]
    words = RELATION_WORDS[first.kind]
    source, destination = first.participants
    verb = words.holds.replace("is ", "was ").replace("rests", "rested").replace("holds", "held")
    text = f"{_when(moment, same, span)}, by the robot's belief of then, {source} {verb} {destination}."
    return Statement(
        text=sentence_begin(text), subject=Subject.HAPPENED, basis=Basis.BELIEVED, names=first.participants,
        time=max(first.begin, span.begin), confidence=min(entry.confidence for entry in same),
        evidence=entry_evidence(first) | ({"times": len(same)} if len(same) > 1 else {}),
    )  # fmt: skip


def _when(moment: Moment, same: list[Entry], span: TimeSpan) -> str:
    if span.is_instant:
        return moment.when(span.begin)
    now, zone = moment.now, moment.zone
    periods = [(max(entry.begin, span.begin), min(entry.last, span.end, now)) for entry in same]
    if now - span.begin < 3600.0:
        told = [f"from {ago(now - begin)} until {ago(now - end) if end < now else 'now'}" for begin, end in periods]
    else:
        told = [span_words(begin, end, now, zone) for begin, end in periods]
    if len(told) > _MOST_PERIODS:
        return f"{len(told)} times {span_words(periods[0][0], max(end for _, end in periods), now, zone)}"
    return " and ".join(told)


def _during(entries: Iterable[Entry], span: TimeSpan) -> list[Entry]:
    """Of entries those that lasted at an instant, or for some part of a stretch of time."""
    if span.is_instant:
        return [entry for entry in entries if entry.begin <= span.begin < entry.last]
    return [entry for entry in entries if entry.begin < span.end and entry.last > span.begin]


def _length(entry: Entry, span: TimeSpan, now: float) -> float:
    """For how long (s) of a time an entry lasted."""
    return min(entry.last, span.end, now) - max(entry.begin, span.begin)


def _is_of(entry: Entry, name: str) -> bool:
    """Whether a relation tells where the thing is, rather than what is in or on it."""
    return entry.participants[1 if entry.kind == "grasping" else 0] == name
