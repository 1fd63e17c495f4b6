"""Lines of text: events of the graph, with surprises, explanations and warnings, each told once; and logs of agents."""

from __future__ import annotations

import logging
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator

import rerun as rr

from agents.inbox import Message
from agents.viewer import palette
from agents.viewer.elapsed import Elapsed
from agents.viewer.palette import Color
from agents.viewer.settling import Settling, Shift
from agents.viewer.texts import drawable
from dsr import Change, Memory, Node, WireError
from dsr.graph.schema import SCHEMA_RECORD
from dsr.runtime.logs import decode_log
from dsr.timeline import DERIVED, EVENT, EXPLAINED, RELATIONS, SITUATION, TIMELINE, read_entry
from dsr.vocabulary.sentences import explained_sentence, rejected_sentences

ENTITY = "log"
"""Of the events."""
GRAPH = "graph"
"""Who says what the graph shows. Such lines name nobody, nor do explanations."""
LOGS = "agents"
"""Of all that agents say. Warnings and errors are events as well."""
_SURPRISING = "surprising"
_NOT_TOLD = ("action", "body", "finger", SITUATION, SCHEMA_RECORD)
"""Types of nodes whose coming and going the plan or the timeline shows, or that are parts, or no things."""
_SURPRISE_LATE = 1.0  # s after a percept, in which its surprise is told at the latest
_MOST_NAMES = 8
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
        self._surprised_at = -math.inf
        self._settling = Settling()

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
        told: dict[str, list[str]] = defaultdict(list)
        events = []
        for change in changes:
            if change.type == EVENT and change.element == "node":
                events.append(change)
            elif (shift := _shift(change)) is not None:
                self._settling.note(shift, now)
            for predicate in self._surprises(change, memory):
                told[predicate].append(change.name)
        self._elapsed.set(now)
        for predicate, names in told.items():
            is_surprise = predicate.startswith(_SURPRISING)
            self._surprised_at = now if is_surprise else self._surprised_at
            color = palette.SURPRISE if is_surprise else palette.NAME
            self._say(GRAPH, _sentence(names, predicate), now, rr.TextLogLevel.INFO, color)
        for change in events:
            self._draw_event(change, memory)
        self._draw_settled(now)
        self._elapsed.set(now)

    def close(self) -> None:
        """Log what has not lasted long enough yet."""
        self._draw_settled(math.inf)

    def _draw_settled(self, now: float) -> None:
        for together in self._settling.settled(now):
            told: dict[str, list[str]] = defaultdict(list)
            for shift in (settled.shift for settled in together):
                told[_predicate(shift)].append(shift.subject[0])
            time = together[0].time
            self._elapsed.set(time)
            for predicate, names in told.items():
                self._say(GRAPH, _sentence(names, predicate), time, rr.TextLogLevel.INFO, palette.NAME)

    def _surprises(self, change: Change, memory: Memory) -> Iterator[str]:
        """That a node became surprising, or ceased to be."""
        if change.element == "node" and _SURPRISING in change.attributes:
            node = memory.get_node(change.name)
            is_surprising = node is not None and node.get(_SURPRISING) is True
            if is_surprising is not (change.name in self._surprising):
                self._surprising ^= {change.name}
                yield _SURPRISING + _reason(node) if is_surprising else f"not {_SURPRISING} any more"

    def _draw_event(self, change: Change, memory: Memory) -> None:
        """Log an explanation, or what an agent tells, at its own time; what follows from the graph is told above.

        An explanation has the time of the percept, at which its surprise was not told yet: the explanation comes after.
        """
        node = memory.get_node(change.name) if change.kind == "added" else None
        entry = read_entry(node) if node is not None else None
        if node is None or entry is None:
            return
        self._elapsed.set(entry.begin)
        if entry.kind == EXPLAINED:
            if entry.begin < self._surprised_at < entry.begin + _SURPRISE_LATE:
                self._elapsed.set(self._surprised_at)
            self._say(EXPLAINED, _explanation(node), entry.begin, rr.TextLogLevel.INFO, palette.HELD)
        elif entry.kind not in DERIVED:
            sure = "" if entry.confidence == 1.0 else f" ({entry.confidence:.2f})"
            text = entry.text or f"{entry.kind} {', '.join(entry.participants)}"
            self._say(entry.source or EVENT, f"{text}{sure}", entry.begin, rr.TextLogLevel.INFO, palette.HELD)

    def _say(
        self, who: str, text: str, stamp: float, level: rr.TextLogLevel, color: Color, entity: str = ENTITY
    ) -> None:
        """Log a line that begins with the seconds since time 0, as the story of a run does.

        Always with a colour: rerun draws lines that have none in that of the line before.
        """
        said = drawable(text) if who in (GRAPH, EXPLAINED) else f"{drawable(who)}: {drawable(text)}"
        line = f"{self._elapsed.text(stamp)}  {said}"
        self._recording.log([entity, who], rr.TextLog(line, level=level, color=color))


def _shift(change: Change) -> Shift | None:
    """What came or went by a change, if that is told."""
    if change.kind == "updated":
        return None
    if change.element == "edge":
        subject = (change.src, change.dst, change.type) if change.type in RELATIONS else None
    else:
        is_told = change.type not in _NOT_TOLD and change.name != TIMELINE
        subject = (change.name, "", "") if is_told else None
    return None if subject is None else Shift(subject, change.kind == "added")


def _predicate(shift: Shift) -> str:
    """What to say about the node, or the source of the edge."""
    _, dst, type = shift.subject
    if not type:
        return "appeared" if shift.is_there else "gone"
    return f"{'' if shift.is_there else 'no more '}{type} {dst}"


def _reason(node: Node | None) -> str:
    """Why something is surprising."""
    return f": {node['surprise']}" if node is not None and "surprise" in node else ""


def _explanation(event: Node) -> str:
    """What was chosen, with its score, and how much was rejected: the page of explanations lists that."""
    score = f"score {event['score']:.1f}" if "score" in event else ""
    rejected = len(rejected_sentences(event.attributes))
    known = ", ".join(filter(None, (score, f"{rejected} rejected" if rejected else "")))
    return f"{explained_sentence(event.attributes)}{f' ({known})' if known else ''}"


def _sentence(names: list[str], predicate: str) -> str:
    if len(names) == 1:
        return f"{names[0]} {predicate}"
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return f"{predicate}: {', '.join(names[:_MOST_NAMES])}{more}"
