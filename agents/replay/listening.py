"""The events of a running graph: those on its timeline, or, where nobody writes that, those that its changes tell."""

from __future__ import annotations

from typing import NamedTuple

from agents.inbox import Inbox
from agents.replay.source import ReplayedGraph
from dsr.clock import WALL_CLOCK
from dsr.errors import WireError
from dsr.memory import Memory
from dsr.runtime.status import PERIOD, decode_status
from dsr.timeline import EVENT, SITUATION, Entry, Event, Timeline, kept_by, query, read_entry, tell

LISTEN = 1.5 * PERIOD
"""s in which every agent is heard at least once"""
_MOST_STATUSES = 1000
_MOST_TOLD = 20_000


class Listener:
    """Tells the events from before it was made, as far as the graph knows, and from then on."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._timeline = Timeline()
        self._watch = memory.watch()
        self._entries = memory.watch(node_type=(EVENT, SITUATION))
        self._statuses = Inbox(memory.transport, memory.keys.status(), WALL_CLOCK, _MOST_STATUSES)
        self._told: set[tuple[str, str, float]] = set()
        self._past: set[tuple[str, str]] | None = None

    @property
    def keeper(self) -> str | None:
        """Name of the agent that writes the timeline; None if nobody does."""
        return kept_by(self._memory)

    def events(self) -> list[Event]:
        """Events since the last call, in the order of times."""
        written, derived = self._written(), self._derived()
        if self._past is None:
            self._past = {(event.kind, event.subject) for event in written}
            derived = [event for event in derived if (event.kind, event.subject) not in self._past]
        return sorted(written if self.keeper else [*written, *derived], key=lambda event: event.time)

    def _written(self) -> list[Event]:
        """News of the timeline in the graph; without a keeper what is new there is among the derived ones."""
        if self._past is None:
            self._entries.poll()
            entries = query(self._memory)
        else:
            names = {change.name for change in self._entries.poll() if change.kind != "removed"}
            nodes = [node for name in sorted(names) if (node := self._memory.get_node(name)) is not None]
            entries = [entry for node in nodes if (entry := read_entry(node)) is not None]
        if len(self._told) > _MOST_TOLD:
            self._told = {key for key in self._told if key[0] in self._memory}
        events = []
        for entry in entries:
            for event in tell([entry]):
                key = (entry.name, event.kind, event.time)
                if key not in self._told:
                    self._told.add(key)
                    events.append(event)
        return events if self.keeper or self._past is None else []

    def _derived(self) -> list[Event]:
        now = WALL_CLOCK.now()
        events = self._timeline.note(self._watch.poll(), self._memory, now)
        for message in self._statuses.take():
            try:
                events += self._timeline.note_status(decode_status(message.payload), message.stamp)
            except WireError:  # its sender counts elsewhere
                continue
        return [*events, *self._timeline.note_silence(now)]


class RecordedHistory(NamedTuple):
    """The past as a recording tells it."""

    events: list[Event]
    """Events in the order of their times (stamps, s)."""
    names: set[str]
    """Nodes that there ever were, without those of the timeline."""
    entries: list[Entry]
    """Entries of the timeline in the graph, as they were last, also forgotten ones; in the order of their begin."""
    end: float
    """s, of the last record."""


def history_of(source: ReplayedGraph) -> RecordedHistory:
    """Read the whole past of a recording, from its beginning."""
    source.restart()
    timeline, events = Timeline(), []
    names: set[str] = set()
    entries: dict[str, Entry] = {}
    now = source.index.begin
    with source.memory.watch() as watch:
        while (record := source.next()) is not None:
            now = source.index.begin + record.time
            if record.topic.startswith("status/"):
                try:
                    events += timeline.note_status(decode_status(record.payload), now)
                except WireError:
                    source.malformed += 1
            events += timeline.note_silence(now)
            if changes := watch.poll():
                events += timeline.note(changes, source.memory, now)
                for change in changes:
                    if change.element == "node" and change.type not in (EVENT, SITUATION):
                        names.add(change.name)
                    elif change.element == "node" and (node := source.memory.get_node(change.name)) is not None:
                        entry = read_entry(node)
                        entries.update({} if entry is None else {entry.name: entry})
    ordered = sorted(entries.values(), key=lambda entry: (entry.begin, entry.name))
    return RecordedHistory(sorted(events, key=lambda event: event.time), names, ordered, now)
