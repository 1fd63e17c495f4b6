"""Questions to the timeline: by kind, participants, source, time, and Allen's relations."""

from __future__ import annotations

import math
from collections.abc import Iterable
from numbers import Real

from dsr.errors import ConfigError, suggest
from dsr.graph.elements import Node
from dsr.memory import Memory
from dsr.timeline.allen import ALLEN, WITHIN, AllenRelation, Interval, holds
from dsr.timeline.entries import EVENT, SITUATION, Entry, kind_of, read_entry, split_names

Time = Entry | Interval | tuple[float, float | None]
"""A stretch of time: that of an entry, or (begin, end) in s, the end None for open."""

_TYPES = (EVENT, SITUATION)


def query(
    memory: Memory,
    *,
    type: str | None = None,
    kind: str | Iterable[str] | None = None,
    participants: str | Iterable[str] | None = None,
    during: Time | None = None,
    since: float | None = None,
    until: float | None = None,
    source: str | None = None,
    open: bool | None = None,
    relation: AllenRelation | Iterable[AllenRelation] | None = None,
    of: Time | None = None,
) -> list[Entry]:
    """Find entries of the timeline in `memory`, in the order of their begin.

    An entry must meet all conditions that are given.

    Args:
        memory: where to look.
        type: `event` or `situation`.
        kind: one of these kinds.
        participants: all of these take part.
        during: lies within this time, bounds included (an open situation only within an open one).
        since: was not over before this time, s.
        until: had begun by this time, s.
        source: says so.
        open: whether it still lasts.
        relation: is certain to be in (one of) these of Allen's relations ...
        of: ... to this. An open end lies somewhere after now.

    Raises:
        ConfigError: for an unknown type or relation, a relation without `of`, and what is no name or no time.
    """
    question = TimelineQuestion(
        type=type, kind=kind, participants=participants, during=during, since=since, until=until, source=source,
        open=open, relation=relation, of=of,
    )  # fmt: skip
    now = memory.clock.now()
    nodes = [node for name in (_TYPES if type is None else (type,)) for node in memory.nodes(name)]
    found = [
        entry
        for node in nodes
        if question.may_fit(node) and (entry := read_entry(node)) is not None and question.fits(entry, now)
    ]
    return sorted(found, key=lambda entry: (entry.begin, entry.name))


class TimelineQuestion:
    """A query of a timeline that can be asked again; arguments as those of `query`, with the same errors."""

    def __init__(
        self,
        *,
        type: str | None = None,
        kind: str | Iterable[str] | None = None,
        participants: str | Iterable[str] | None = None,
        during: Time | None = None,
        since: float | None = None,
        until: float | None = None,
        source: str | None = None,
        open: bool | None = None,
        relation: str | Iterable[str] | None = None,
        of: Time | None = None,
    ) -> None:
        if type is not None and type not in _TYPES:
            raise ConfigError(f"no type {type!r} of entries; {suggest(str(type), _TYPES)}")
        listed = split_names(participants) if isinstance(participants, str) else participants
        _check_bounds(since, until)
        if not (source is None or isinstance(source, str)):
            raise ConfigError(f"source: expected a name, got {source!r}")
        if not (open is None or isinstance(open, bool)):
            raise ConfigError(f"open: expected true, false or None, got {open!r}")
        self._type, self._source, self._open = type, source, open
        self._kinds = None if kind is None else _names("kind", kind)
        self._participants = _names("participants", () if listed is None else listed)
        self._related = _related(relation, of)
        self._during = None if during is None else _interval("during", during)
        self._since = -math.inf if since is None else since
        self._until = math.inf if until is None else until

    def may_fit(self, node: Node) -> bool:
        """Whether the entry of a node may be wanted, at a glance."""
        if (self._kinds is not None and kind_of(node) not in self._kinds) or (self._open and "end" in node):
            return False
        needed = self._participants
        return not needed or needed.issubset(split_names(str(node.get("participants", ""))))

    def fits(self, entry: Entry, now: float) -> bool:
        """Whether an entry is wanted, an open end being somewhere after `now` (s)."""
        return (
            self._type in (None, entry.type)
            and (self._kinds is None or entry.kind in self._kinds)
            and self._participants.issubset(entry.participants)
            and self._source in (None, entry.source)
            and (entry.last >= self._since and entry.begin <= self._until)
            and self._open in (None, entry.is_open)
            and (self._during is None or _within(entry, self._during, now))
            and (self._related is None or holds(self._related[0], entry.interval, self._related[1], now))
        )


def _related(
    relation: str | Iterable[str] | None, of: Time | None
) -> tuple[frozenset[AllenRelation], Interval] | None:
    if (relation is None) != (of is None):
        raise ConfigError("relation and of go together: relation='during', of=situation")
    if relation is None or of is None:
        return None
    names = _names("relation", relation)
    for name in sorted(names.difference(ALLEN)):
        raise ConfigError(f"no relation {name!r} between times; {suggest(name, ALLEN, len(ALLEN))}")
    return frozenset(name for name in ALLEN if name in names), _interval("of", of)


def _names(what: str, given: str | Iterable[str]) -> frozenset[str]:
    names = [given] if isinstance(given, str) else list(given) if isinstance(given, Iterable) else [given]
    for name in names:
        if not isinstance(name, str):
            raise ConfigError(f"{what}: expected a name or several, got {name!r}")
    return frozenset(names)


def _interval(what: str, time: Time) -> Interval:
    if isinstance(time, Entry):
        return time.interval
    if not isinstance(time, tuple | list) or len(time) != 2:
        raise ConfigError(f"{what}: expected an entry, or (begin, end) in s, got {time!r}")
    begin, end = time
    if not _is_time(begin) or not (end is None or _is_time(end)):
        raise ConfigError(f"{what}: expected numbers (begin, end) in s, the end None for open, got {time!r}")
    if end is not None and end < begin:
        raise ConfigError(f"a time from {begin:g} to {end:g} s: it ends before it begins")
    return Interval(begin, end)


def _check_bounds(since: float | None, until: float | None) -> None:
    for what, time in (("since", since), ("until", until)):
        if not (time is None or _is_time(time)):
            raise ConfigError(f"{what}: expected a number of s, got {time!r}")
    if since is not None and until is not None and until < since:
        raise ConfigError(f"since {since:g}, until {until:g} s: expected the earlier time first")


def _is_time(value: object) -> bool:
    return not isinstance(value, bool) and isinstance(value, Real) and not math.isnan(value)


def _within(entry: Entry, time: Interval, now: float) -> bool:
    if time.end is None:
        return entry.begin >= time.begin and (entry.is_open or entry.last <= now)
    return holds(WITHIN, entry.interval, time, now)
