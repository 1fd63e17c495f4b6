"""Forgets old entries of the timeline, and tells which agent forgets which.

Each writer (an agent by name, restarts included) keeps the newest of its own entries, up to a count and an age; what
lasts goes last. Entries of writers that are not there any more are everybody's: whoever has a `Chronicle` forgets those
that are older than the age or, beyond the count, the oldest; but none of the last `RECENT` seconds, since a writer that
seems gone may only be out of reach. Removals are idempotent: it does no harm if several do it.
"""

from __future__ import annotations

import math
from collections.abc import Collection

import msgspec

from dsr.errors import ConfigError
from dsr.memory import Memory
from dsr.network.keys import agent_of
from dsr.timeline.entries import EVENT, SITUATION, Entry, read_entry

RECENT = 60.0
"""s; so young, nothing of a writer that is gone is forgotten, nor is a situation that it left open ended"""


class Retention(msgspec.Struct, frozen=True):
    """How many of its own entries a writer keeps, and for how long."""

    count: int = 500
    """Events and situations together; a few more until it looks again."""
    age: float = 3600.0
    """s since it was over"""

    def __post_init__(self) -> None:
        if self.count < 1 or not self.age > 0.0:
            raise ConfigError(f"retention of {self.count} entries, {self.age} s: expected a positive count and age")

    def outlived(self, entries: list[Entry], now: float, room: int = 0) -> list[Entry]:
        """List the `entries` that are too old at time `now` (s), or too many beside `room` more; oldest first."""
        ordered = sorted(entries, key=lambda entry: (entry.last, entry.begin, entry.name))
        excess = len(ordered) + room - self.count
        return [entry for index, entry in enumerate(ordered) if index < excess or entry.last < now - self.age]


class Orphans:
    """Entries of writers that are not there any more."""

    def __init__(self, memory: Memory, keep: Retention) -> None:
        self._memory = memory
        self._keep = keep
        self._missed: dict[str, float] = {}

    def outlived(self, entries: list[Entry], now: float) -> list[Entry]:
        """List the `entries` of agents that are gone that may be forgotten at time `now` (s)."""
        orphans = [entry for entry in entries if self._is_orphan(entry)]
        return [entry for entry in self._keep.outlived(orphans, now) if _last_sign(entry) < now - RECENT]

    def abandoned(self, entries: list[Entry], now: float) -> list[tuple[Entry, float]]:
        """Open situations whose writers have been missed for `RECENT` s, and since when (s).

        Of nobody if nobody at all can be reached: then it is we who are cut off.
        """
        there = self._there()
        if not self._memory.peers:
            self._missed = {}
            return []
        writers = {writer for entry in entries if entry.is_open for writer in entry.writers}
        self._missed = {writer: self._missed.get(writer, now) for writer in writers if writer not in there}
        found = []
        for entry in entries:
            since = [self._missed.get(writer, math.inf) for writer in entry.writers]
            if entry.is_open and since and max(since) <= now - RECENT:
                found.append((entry, max(since)))
        return found

    def _is_orphan(self, entry: Entry) -> bool:
        return not self._there().intersection(entry.writers)

    def _there(self) -> set[str]:
        return {agent_of(rid) for rid in (self._memory.rid, *self._memory.peers)}


def read_all(memory: Memory) -> list[Entry]:
    """All entries of the timeline."""
    nodes = [*memory.nodes(EVENT), *memory.nodes(SITUATION)]
    return [entry for node in nodes if (entry := read_entry(node)) is not None]


def written_by(agent: str, entries: Collection[Entry]) -> list[Entry]:
    """List the entries that the agent wrote, alone or with others."""
    return [entry for entry in entries if agent in entry.writers]


def _last_sign(entry: Entry) -> float:
    """The last time (s) at which its writer told something of it."""
    return entry.begin if entry.end is None else entry.end
