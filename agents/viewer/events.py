"""The event log: logs of agents, changes of the graph, surprises, and their explanations."""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime

import rerun as rr

from agents.inbox import Message
from agents.viewer import palette
from agents.viewer.palette import Color
from agents.viewer.texts import drawable
from dsr import Change, Memory, Node, WireError
from dsr.runtime.logs import decode_log
from dsr.timeline import DERIVED, EVENT, EXPLAINED, RELATIONS, SITUATION, read_entry
from dsr.vocabulary.sentences import explained_sentence, rejected_sentences

ENTITY = "log"
_JUDGEMENTS = ("perceived", "plausible", "surprising")
_TOLD_ELSEWHERE = ("action", SITUATION)  # node types whose coming and going the plan or the timeline shows
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

    def __init__(self, recording: rr.RecordingStream, log: logging.Logger) -> None:
        self.malformed = 0
        self._recording = recording
        self._log = log
        self._judgements: dict[tuple[str, str], bool] = {}

    def draw_record(self, message: Message) -> None:
        """Log what an agent said."""
        try:
            record = decode_log(message.payload)
            level = _LEVELS.get(record.level, rr.TextLogLevel.INFO)
            self._say(record.agent, record.text, record.stamp, level, _COLORS.get(record.level, palette.NAME))
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
            color = palette.SURPRISE if predicate.startswith("surprising") else palette.NAME
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
        for name in sorted(change.attributes.intersection(_JUDGEMENTS)):
            value = node.get(name) if node is not None else None
            if isinstance(value, bool) and self._judgements.get((change.name, name)) is not value:
                self._judgements[change.name, name] = value
                yield (name if value else f"not {name}") + _reason(node, name)

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

    def _say(self, who: str, text: str, stamp: float, level: rr.TextLogLevel, color: Color) -> None:
        """Log a line that begins with the time of day (UTC, as rerun shows it) and who says it.

        Always with a colour: rerun draws lines that have none in that of the line before.
        """
        time = datetime.fromtimestamp(stamp, UTC).strftime("%H:%M:%S")
        line = f"{time}  {drawable(who)}: {drawable(text)}"
        self._recording.log([ENTITY, who], rr.TextLog(line, level=level, color=color))


def _reason(node: Node | None, judgement: str) -> str:
    """Why something is surprising, if it is."""
    is_surprising = judgement == "surprising" and node is not None and node.get("surprising", False)
    return f": {node['surprise']}" if is_surprising and node is not None and "surprise" in node else ""


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
