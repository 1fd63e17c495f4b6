"""The events of a whole recording, in order."""

from __future__ import annotations

from typing import NamedTuple

from agents.replay.source import ReplayedGraph
from dsr.errors import WireError
from dsr.runtime.status import decode_status
from dsr.timeline import EVENT, SITUATION, Event, Timeline


class History(NamedTuple):
    """What a recording tells of the past."""

    events: list[Event]
    """In the order of their times (stamps, s)."""
    names: set[str]
    """Nodes that there ever were, without those of the timeline."""


def history_of(source: ReplayedGraph) -> History:
    """All that happened in a recording, read from its beginning."""
    source.restart()
    timeline, events = Timeline(), []
    names: set[str] = set()
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
                names.update(
                    change.name
                    for change in changes
                    if change.element == "node" and change.type not in (EVENT, SITUATION)
                )
    return History(sorted(events, key=lambda event: event.time), names)
