"""What happened in a recording, as JSON: events as `dsr timeline` tells them, read off the changes of the graph."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable

from agents.recorder.export.rows import participants_of
from agents.ros_bridge.bridge.config import Send
from agents.ros_bridge.bridge.core import BridgeCore
from agents.ros_bridge.mapping.events import EVENT, to_event
from dsr.errors import WireError
from dsr.graph.watch import Watch
from dsr.runtime.status import decode_status
from dsr.timeline import Event, Timeline
from dsr.timeline.entries import EVENT as INSTANT
from dsr.timeline.entries import Entry


class RecordedEventsOut:
    """Publishes events, each once; recordings without a chronicler have them, too."""

    def __init__(self, core: BridgeCore, config: Send) -> None:
        self._core = core
        self._timeline = Timeline()
        self._outlet = core.outlet(config.events, EVENT)
        self._watch: Watch = core.memory.watch()
        core.on_close(self._watch.close)

    def update(self, now: float) -> None:
        """Send what the changes since the last call amount to at time `now` (s)."""
        changes = self._watch.poll()
        if changes:
            self._send(self._timeline.note(changes, self._core.memory, now))

    def note_status(self, payload: bytes, now: float) -> None:
        """Send what the status in a message says that is new."""
        with contextlib.suppress(WireError):  # counted where diagnostics are made of it
            self._send(self._timeline.note_status(decode_status(payload), now))
        self._send(self._timeline.note_silence(now))

    def _send(self, events: Iterable[Event]) -> None:
        for event in events:
            participants = tuple(sorted(participants_of(event)))
            if not (self._outlet.wanted and self._core.wants(participants)):
                continue
            details = event.details
            entry = Entry(
                name=str(details.get("name", "")), type=INSTANT, kind=event.kind, participants=participants,
                begin=event.time, end=event.time, text=event.text, source=str(details.get("source", "")),
            )  # fmt: skip
            self._outlet.send(lambda entry=entry: to_event(self._core.types, entry))  # type: ignore[misc]
