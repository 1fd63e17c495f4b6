"""Lines of text: events of the graph, with surprises, explanations and warnings, each told once; and logs of agents."""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Iterable, Iterator

import rerun as rr

from agents.inbox import Message
from agents.viewer import palette
from agents.viewer.elapsed import Elapsed
from agents.viewer.palette import Color
from agents.viewer.texts import drawable
from dsr import Change, Memory, Node, WireError
from dsr.graph.schema import SCHEMA_RECORD
from dsr.runtime.logs import decode_log
from dsr.timeline import DERIVED, EVENT, EXPLAINED, RELATIONS, SITUATION, read_entry
from dsr.vocabulary.sentences import explained_sentence, rejected_sentences

ENTITY = "log"
"""Of the events."""
LOGS = "agents"
"""Of all that agents say. Warnings and errors are events as well."""
_SURPRISING = "surprising"
_TOLD_ELSEWHERE = ("action", SITUATION, SCHEMA_RECORD)
"""Node types whose coming and going the plan or the timeline shows, or that are no things."""
_MOST_NAMES = 8
_MOST_REJECTED = 3
_LEVELS = {
    "DEBUG": rr.TextLogLevel.DEBUG,
    "INFO": rr.TextLogLevel.INFO,
    "WARNING": rr.TextLogLevel.WARN,
    "ERROR": rr.TextLogLevel.ERROR,
    "CRITICAL": rr.TextLogLevel.CRITICAL,
}
_COLORS = {"WARNING": palette.PERCEPT, "ERROR": palette.SURPRISE, "CRITICAL": palette.SURPRISE}


class EventView:
    """Logs lines of text; malformed messages are counted and left out."""

    def __init__(self, recording: rr.RecordingStream, elapsed: Elapsed, log: logging.Logger) -> None:
        self.malformed = 0
        self._recording = recording
        self._elapsed = elapsed
        self._log = log
        self._surprising: set[str] = set()

    def draw_record(self, message: Message) -> None:
        """Log what an agent said."""
        try:
            record = decode_log(message.payload)
            level = _LEVELS.get(record.level, rr.TextLogLevel.INFO)
            color = _COLORS.get(record.level, palette.NAME)
            for entity in (LOGS, ENTITY) if record.level in _COLORS else (LOGS,):
                self._say(record.agent, record.text, record.stamp, level, color, entity)
        except WireError as error:
            self.malformed += 1
            if self.malformed == 1:
                self._log.warning("dropped a message on %s: %s (logged once)", message.key, error)

    def draw_changes(self, changes: Iterable[Change], memory: Memory, now: float) -> None:
        """Log nodes that came or went, relations between objects, and what became surprising or ceased to be."""
        subjects: dict[str, list[str]] = defaultdict(list)
        for change in changes:
            for predicate in self._predicates(change, memory):
                subjects[predicate].append(change.src or change.name)
        for predicate, names in subjects.items():
            color = palette.SURPRISE if predicate.startswith(_SURPRISING) else palette.NAME
            self._say("graph", _sentence(names, predicate), now, rr.TextLogLevel.INFO, color)

    def _predicates(self, change: Change, memory: Memory) -> Iterator[str]:
        """What to say about the changed node, or the source of the changed edge."""
        if change.element == "edge":
            if change.type in RELATIONS and change.kind != "updated":
                yield f"{'no more ' if change.kind == 'removed' else ''}{change.type} {change.dst}"
            return
        node = memory.get_node(change.name)
        if change.type == EVENT:
            if change.kind == "added" and node is not None:
                self._draw_event(node)
            return
        if change.kind != "updated" and change.type not in _TOLD_ELSEWHERE:
            yield "appeared" if change.kind == "added" else "gone"
        if _SURPRISING in change.attributes:
            is_surprising = node is not None and node.get(_SURPRISING) is True
            if is_surprising is not (change.name in self._surprising):
                self._surprising ^= {change.name}
                yield _SURPRISING + _reason(node) if is_surprising else f"not {_SURPRISING} any more"

    def _draw_event(self, node: Node) -> None:
        """Log an explanation, or what an agent tells; what follows from the graph is told above."""
        entry = read_entry(node)
        if entry is None:
            return
        if entry.kind == EXPLAINED:
            self._say("explained", _explanation(node), entry.begin, rr.TextLogLevel.INFO, palette.HELD)
        elif entry.kind not in DERIVED:
            sure = "" if entry.confidence == 1.0 else f" ({entry.confidence:.2f})"
            text = entry.text or f"{entry.kind} {', '.join(entry.participants)}"
            self._say(entry.source or "event", f"{text}{sure}", entry.begin, rr.TextLogLevel.INFO, palette.HELD)

    def _say(
        self, who: str, text: str, stamp: float, level: rr.TextLogLevel, color: Color, entity: str = ENTITY
    ) -> None:
        """Log a line that begins with the seconds since time 0, as the story of a run does, and who says it.

        Always with a colour: rerun draws lines that have none in that of the line before.
        """
        line = f"{self._elapsed.text(stamp)}  {drawable(who)}: {drawable(text)}"
        self._recording.log([entity, who], rr.TextLog(line, level=level, color=color))


def _reason(node: Node | None) -> str:
    """Why something is surprising."""
    return f": {node['surprise']}" if node is not None and "surprise" in node else ""


def _explanation(event: Node) -> str:
    """What was chosen, with its score, and the best of what was rejected."""
    score = f" ({event['score']:.1f})" if "score" in event else ""
    rejected = rejected_sentences(event.attributes)
    best = "; or ".join(f"{other.sentence} ({other.score})" for other in rejected[:_MOST_REJECTED])
    more = f", and {len(rejected) - _MOST_REJECTED} more" if len(rejected) > _MOST_REJECTED else ""
    return f"{explained_sentence(event.attributes)}{score}{f'. Rejected: {best}{more}' if rejected else ''}"


def _sentence(names: list[str], predicate: str) -> str:
    if len(names) == 1:
        return f"{names[0]} {predicate}"
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return f"{predicate}: {', '.join(names[:_MOST_NAMES])}{more}"
