"""Which events are wanted: by kind, participants and time."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence

from dsr.errors import ConfigError, closest, suggest
from dsr.timeline import DERIVED, EVENT, EVENT_KINDS, RELATIONS, SURPRISING, Entry, Event, Interval
from dsr.timeline.queries import TimelineQuestion
from dsr.vocabulary.calibration import CALIBRATED
from dsr.vocabulary.observed_actions import KINDS as ACTIONS

KNOWN_KINDS = (*EVENT_KINDS, *ACTIONS, CALIBRATED, *sorted(DERIVED.difference(EVENT_KINDS)))
"""Kinds that this system has; agents may have their own."""
_OF = {"surprised": SURPRISING, "calmed": SURPRISING}


class Selection:
    """A selection of events by kind, participant and time.

    Args:
        kinds: of events (`began`, `Pick`) or of the situations that they belong to (`on`, `surprising`); all if none.
        participants: names that must all take part.
        since: s, on the scale of the events' times.
        until: s, likewise.

    Raises:
        ConfigError: for a kind that looks like a misspelt one, or times between which nothing can be.
    """

    def __init__(
        self,
        kinds: Iterable[str] = (),
        participants: Iterable[str] = (),
        since: float | None = None,
        until: float | None = None,
    ) -> None:
        self._kinds = frozenset(kinds)
        self._participants = frozenset(participants)
        self._since = -math.inf if since is None else since
        self._until = math.inf if until is None else until
        if not self._since <= self._until:  # also what is no number
            raise ConfigError(f"--since {self._since:g}, --until {self._until:g}: expected the earlier time first")
        for kind in sorted(self._kinds.difference(KNOWN_KINDS)):
            if closest(kind, KNOWN_KINDS):
                raise ConfigError(f"--kind {kind}: no such kind of event; {suggest(kind, KNOWN_KINDS)}")

    def of(self, events: Iterable[Event], origin: float) -> list[Event]:
        """The wanted ones among `events`; `since` and `until` count from `origin` (s)."""
        return [event for event in events if self._fits(event, event.time - origin)]

    def _fits(self, event: Event, time: float) -> bool:
        return (
            self._since <= time <= self._until
            and (not self._kinds or not self._kinds.isdisjoint(kinds_of(event)))
            and self._participants <= _participants(event)
        )

    def check_found(self, events: Collection[Event], names: Iterable[str]) -> None:
        """Raise `ConfigError` for a kind or participant neither known (`names` of nodes and agents) nor in `events`."""
        self.check_participants(events, names)
        there = {kind for event in events for kind in kinds_of(event)}.union(KNOWN_KINDS)
        for kind in sorted(self._kinds - there):
            raise ConfigError(f"--kind {kind}: no such kind of event; {suggest(kind, there, len(there))}")

    def check_participants(self, events: Iterable[Event], names: Iterable[str]) -> None:
        """Raise `ConfigError` for a participant that is neither among `names`, of nodes and agents, nor in `events`."""
        known, mentioned = set(names), set()
        for event in events:
            known.update(event.details.get("participants", ()))
            mentioned |= _participants(event)
        for name in sorted(self._participants - known - mentioned):
            raise ConfigError(f"--participant {name}: no such node or agent; {suggest(name, known)}")


def kinds_of(event: Event) -> set[str]:
    """The kind of an event, and that of the situation that it begins or ends."""
    kinds = {event.kind, str(event.details.get("kind", event.kind)), _OF.get(event.kind, event.kind)}
    words = event.subject.split()
    return kinds | ({words[1]} if len(words) == 3 and words[1] in RELATIONS else set())


def _participants(event: Event) -> set[str]:
    told = event.details.get("participants", ())
    about = (event.subject, event.details.get("target", ""), event.details.get("destination", ""))
    return {*told, *(name for text in about for name in str(text).replace(",", " ").split())}


TIMES = "BEGIN:END"


class Asking:
    """A query of entries; everything if nothing is given.

    Args:
        type: `event` or `situation`.
        is_open: only situations that last.
        relations: some of Allen's, one of which must be certain ...
        of: ... to the entry of this name, or to a time `BEGIN:END`, `BEGIN:` (which lasts) or `TIME`, in s.

    Raises:
        ConfigError: for what is unknown, cannot be, or does not go together.
    """

    def __init__(
        self, type: str | None = None, is_open: bool = False, relations: Sequence[str] = (), of: str | None = None
    ) -> None:
        if bool(relations) != (of is not None):
            raise ConfigError("--relation and --of go together: --relation during --of -60:0")
        if is_open and type == EVENT:
            raise ConfigError("--open: events do not last; ask for --type situation")
        self._type, self._open, self._relations, self._of = type, True if is_open else None, relations or None, of
        self._stretch = None if of is None else _stretch(of)
        self.is_given = type is not None or is_open or of is not None
        self._question(None if of is None else self._stretch or Interval(0.0, 0.0))

    def among(self, entries: Sequence[Entry], origin: float, now: float) -> list[Entry]:
        """The wanted ones.

        Args:
            entries: all that there are.
            origin: s, from which the times in `of` count.
            now: s; what lasts ends after it.

        Raises:
            ConfigError: if no entry has the name in `of`.
        """
        question = self._question(None if self._of is None else self._time(self._of, entries, origin))
        return [entry for entry in entries if question.fits(entry, now)]

    def _time(self, name: str, entries: Sequence[Entry], origin: float) -> Interval:
        if self._stretch is not None:
            begin, end = self._stretch
            return Interval(origin + begin, None if end is None else origin + end)
        times = {entry.name: entry.interval for entry in entries}
        if name not in times:
            raise ConfigError(f"--of {name}: neither an entry nor a time {TIMES}; {suggest(name, times)}")
        return times[name]

    def _question(self, of: Interval | None) -> TimelineQuestion:
        return TimelineQuestion(type=self._type, open=self._open, relation=self._relations, of=of)


def _stretch(text: str) -> Interval | None:
    """The time that a text tells; None if it is none, but may be a name."""
    first, colon, second = text.partition(":")
    try:
        begin = float(first)
        end = begin if not colon else float(second) if second else None
    except ValueError:
        return None
    if not math.isfinite(begin) or not (end is None or begin <= end < math.inf):
        raise ConfigError(f"--of {text}: expected {TIMES} in s, the earlier time first")
    return Interval(begin, end)
