"""The event log: what agents say, and what comes and goes in the graph."""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime

import rerun as rr

from agents.inbox import Message
from dsr import Change, Memory, WireError
from dsr.runtime.logs import decode_log

ENTITY = "log"
_RELATIONS = ("on", "in", "grasping")
_JUDGEMENTS = ("perceived", "plausible", "surprising")
_MOST_NAMES = 8
_LEVELS = {
    "DEBUG": rr.TextLogLevel.DEBUG,
    "INFO": rr.TextLogLevel.INFO,
    "WARNING": rr.TextLogLevel.WARN,
    "ERROR": rr.TextLogLevel.ERROR,
    "CRITICAL": rr.TextLogLevel.CRITICAL,
}


class EventView:
    """Logs lines of text; malformed messages are counted and left out."""

    def __init__(self, recording: rr.RecordingStream, log: logging.Logger) -> None:
        self.malformed = 0
        self._recording = recording
        self._log = log
        self._judgements: dict[tuple[str, str], bool] = {}

    def draw_record(self, message: Message) -> None:
        """Log what an agent said."""
        try:
            record = decode_log(message.payload)
            self._say(record.agent, record.text, record.stamp, _LEVELS.get(record.level, rr.TextLogLevel.INFO))
        except (WireError, ValueError, OverflowError) as error:  # the latter two for a stamp that is no time
            self.malformed += 1
            if self.malformed == 1:
                self._log.warning("dropped a message on %s: %s (logged once)", message.key, error)

    def draw_changes(self, changes: Iterable[Change], memory: Memory, now: float) -> None:
        """Log nodes that came or went, relations between objects, and judgements about them that changed."""
        subjects: dict[str, list[str]] = defaultdict(list)
        for change in changes:
            for predicate in self._predicates(change, memory):
                subjects[predicate].append(change.src or change.name)
        for predicate, names in subjects.items():
            self._say("graph", _sentence(names, predicate), now, rr.TextLogLevel.INFO)

    def _predicates(self, change: Change, memory: Memory) -> Iterator[str]:
        """What to say about the changed node, or the source of the changed edge."""
        if change.element == "edge":
            if change.type in _RELATIONS and change.kind != "updated":
                yield f"{'no more ' if change.kind == 'removed' else ''}{change.type} {change.dst}"
            return
        if change.kind != "updated":
            yield "appeared" if change.kind == "added" else "gone"
        node = memory.get_node(change.name)
        for name in sorted(change.attributes.intersection(_JUDGEMENTS)):
            value = node.get(name) if node is not None else None
            if isinstance(value, bool) and self._judgements.get((change.name, name)) is not value:
                self._judgements[change.name, name] = value
                yield name if value else f"not {name}"

    def _say(self, who: str, text: str, stamp: float, level: rr.TextLogLevel) -> None:
        """Log a line that begins with the time of day (UTC, as rerun shows it) and who says it."""
        time = datetime.fromtimestamp(stamp, UTC).strftime("%H:%M:%S")
        self._recording.log([ENTITY, who], rr.TextLog(f"{time}  {who}: {text}", level=level))


def _sentence(names: list[str], predicate: str) -> str:
    if len(names) == 1:
        return f"{names[0]} {predicate}"
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return f"{predicate}: {', '.join(names[:_MOST_NAMES])}{more}"
