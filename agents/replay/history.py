"""The events of a whole recording, in order."""

from __future__ import annotations

from typing import NamedTuple

from agents.replay.source import ReplayedGraph
from dsr.errors import WireError
from dsr.runtime.status import decode_status
from dsr.timeline import EVENT, SITUATION, Entry, Event, Timeline, read_entry


class History(NamedTuple):
    """What a recording tells of the past."""

    events: list[Event]
    """In the order of their times (stamps, s)."""
    names: set[str]
    """Nodes that there ever were, without those of the timeline."""
    entries: list[Entry]
    """Of the timeline in the graph, as they were last, also those that were forgotten; in the order of beginning."""
    end: float
    """s, of the last record."""


def history_of(source: ReplayedGraph) -> History:
    """All that happened in a recording, read from its beginning."""
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
    return History(sorted(events, key=lambda event: event.time), names, ordered, now)
