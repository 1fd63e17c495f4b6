"""Entries of the timeline as the events that a list shows: an event as it is, a situation as its begin and its end."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import msgspec

from dsr.timeline.entries import EVENT, EXPLAINED, Entry
from dsr.timeline.kinds import ACTION, AGENT, FORBIDDEN, INTENTION, PRESENT, RELATIONS, SURPRISING
from dsr.vocabulary.explained import changes_of
from dsr.vocabulary.sentences import sentence_of


class Event(msgspec.Struct, frozen=True):
    """An event as a list shows it."""

    time: float
    """s, when: as told by who noticed it, or else when the change was seen"""
    kind: str
    subject: str
    """The subject of the event: nodes (comma-separated), an edge as `source type destination`, or an agent."""
    text: str
    """One line for people about the event."""
    details: dict[str, Any] = {}
    """The same for programs, by attribute."""


_WORDS = {
    SURPRISING: ("surprised", "calmed"),
    PRESENT: ("appeared", "gone"),
    AGENT: ("agent", "agent"),
    FORBIDDEN: ("halted", "released"),
}
"""Kinds of the events at the begin and the end of a situation; of all others, `began` and `ended`."""
_TOLD_BY_EVENTS = (ACTION, INTENTION)
"""Kinds whose situations show as the events of their status only, unless they are told fully."""


def tell(entries: Iterable[Entry], *, fully: bool = False) -> list[Event]:
    """Turn entries into events, in the order of their times.

    Args:
        entries: events and situations.
        fully: also begin and end of the situations that show as the events of their status otherwise.
    """
    return sorted((event for entry in entries for event in _told(entry, fully)), key=lambda event: event.time)


def _told(entry: Entry, fully: bool) -> Iterator[Event]:
    subject, details = _subject(entry), _details(entry)
    if entry.type == EVENT:
        told = sentence_of(changes_of(entry.details, entry.text)) if entry.kind == EXPLAINED else ""
        text = told or entry.text or f"{entry.kind} {', '.join(entry.participants)}"
        yield Event(entry.begin, entry.kind, subject, text, details)
    elif fully or entry.kind not in _TOLD_BY_EVENTS:
        began, ended = _WORDS.get(entry.kind, ("began", "ended"))
        yield Event(entry.begin, began, subject, entry.text or subject, details)
        if entry.end is not None:
            yield Event(entry.end, ended, subject, entry.outcome or f"no more {subject}", details)


def _subject(entry: Entry) -> str:
    if entry.kind in RELATIONS and len(entry.participants) == 2:
        return f"{entry.participants[0]} {entry.kind} {entry.participants[1]}"
    if entry.type == EVENT or entry.kind in _WORDS:
        several = entry.kind == EXPLAINED
        return ", ".join(entry.participants) if several else "".join(entry.participants[:1])
    return f"{entry.kind} {', '.join(entry.participants)}"


def _details(entry: Entry) -> dict[str, Any]:
    known = {
        "kind": entry.kind, "name": entry.name, "type": entry.type, "begin": entry.begin, "end": entry.end,
        "participants": list(entry.participants), "source": entry.source,
    }  # fmt: skip
    sure = {} if entry.confidence == 1.0 else {"confidence": entry.confidence}
    return {**known, **sure, **entry.details}
