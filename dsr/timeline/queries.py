"""Questions to the timeline: by kind, participants, source, time, and Allen's relations."""

from __future__ import annotations

from collections.abc import Collection

from dsr.errors import ConfigError, suggest
from dsr.memory import Memory
from dsr.timeline.allen import ALLEN, WITHIN, AllenRelation, Interval, holds
from dsr.timeline.entries import EVENT, SITUATION, Entry, kind_of, read_entry, split_names

Time = Entry | Interval | tuple[float, float | None]
"""A stretch of time: that of an entry, or (begin, end) in s, the end None for open."""


def query(
    memory: Memory,
    *,
    type: str | None = None,
    kind: str | Collection[str] | None = None,
    participants: str | Collection[str] | None = None,
    during: Time | None = None,
    since: float | None = None,
    until: float | None = None,
    source: str | None = None,
    open: bool | None = None,
    relation: AllenRelation | Collection[AllenRelation] | None = None,
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
        ConfigError: for an unknown relation, or one without `of`.
    """
    kinds = None if kind is None else {kind} if isinstance(kind, str) else set(kind)
    needed = set(split_names(participants) if isinstance(participants, str) else participants or ())
    related = _checked(relation, of)
    now = memory.clock.now()
    nodes = [node for name in ((type,) if type else (EVENT, SITUATION)) for node in memory.nodes(name)]
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
        if open not in (None, entry.is_open) or (during is not None and not _within(entry, _interval(during), now)):
            continue
        if related is None or holds(related[0], entry.interval, related[1], now):
            found.append(entry)
    return sorted(found, key=lambda entry: (entry.begin, entry.name))


def _checked(
    relation: AllenRelation | Collection[AllenRelation] | None, of: Time | None
) -> tuple[frozenset[AllenRelation], Interval] | None:
    if (relation is None) != (of is None):
        raise ConfigError("relation and of go together: relation='during', of=situation")
    if relation is None or of is None:
        return None
    names: frozenset[AllenRelation] = frozenset([relation] if isinstance(relation, str) else relation)
    for name in sorted(names.difference(ALLEN)):
        raise ConfigError(f"no relation {name!r} between times; {suggest(name, ALLEN, len(ALLEN))}")
    return names, _interval(of)


def _interval(time: Time) -> Interval:
    begin, end = time.interval if isinstance(time, Entry) else time
    if end is not None and end < begin:
        raise ConfigError(f"a time from {begin:g} to {end:g} s: it ends before it begins")
    return Interval(begin, end)


def _within(entry: Entry, time: Interval, now: float) -> bool:
    if time.end is None:
        return entry.begin >= time.begin and (entry.is_open or entry.last <= now)
    return holds(WITHIN, entry.interval, time, now)
