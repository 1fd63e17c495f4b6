"""Questions to the timeline: by kind, participants, source, time, and Allen's relations."""

from __future__ import annotations

import math
from collections.abc import Iterable
from numbers import Real

from dsr.errors import ConfigError, suggest
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
    """What the timeline in `memory` holds, in the order of beginning. All that is given must hold.

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
    if type is not None and type not in _TYPES:
        raise ConfigError(f"no type {type!r} of entries; {suggest(str(type), _TYPES)}")
    kinds = None if kind is None else _names("kind", kind)
    listed = split_names(participants) if isinstance(participants, str) else participants
    needed = _names("participants", () if listed is None else listed)
    related = _related(relation, of)
    stretch = None if during is None else _interval("during", during)
    _check_bounds(since, until)
    if not (source is None or isinstance(source, str)):
        raise ConfigError(f"source: expected a name, got {source!r}")
    if not (open is None or isinstance(open, bool)):
        raise ConfigError(f"open: expected true, false or None, got {open!r}")
    now = memory.clock.now()
    nodes = [node for name in (_TYPES if type is None else (type,)) for node in memory.nodes(name)]
    found = []
    for node in nodes:
        if (kinds is not None and kind_of(node) not in kinds) or (open and "end" in node):
            continue
        if needed and not needed.issubset(split_names(str(node.get("participants", "")))):
            continue
        entry = read_entry(node)
        if entry is None or source not in (None, entry.source):
            continue
        if (since is not None and entry.last < since) or (until is not None and entry.begin > until):
            continue
        if open not in (None, entry.is_open) or (stretch is not None and not _within(entry, stretch, now)):
            continue
        if related is None or holds(related[0], entry.interval, related[1], now):
            found.append(entry)
    return sorted(found, key=lambda entry: (entry.begin, entry.name))


def _related(
    relation: AllenRelation | Iterable[AllenRelation] | None, of: Time | None
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
