"""The events of a whole recording, in order."""

from __future__ import annotations

from agents.replay.source import ReplayedGraph
from dsr.errors import WireError
from dsr.runtime.status import decode_status
from dsr.timeline import Event, Timeline


def events_of(source: ReplayedGraph) -> list[Event]:
    """All events of a recording, read from its beginning, in the order of their times (stamps, s)."""
    source.restart()
    timeline, events = Timeline(), []
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
    return sorted(events, key=lambda event: event.time)
