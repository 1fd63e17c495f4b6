"""The timeline: events (instants) and situations (with a begin and an end) in the working memory.

    chronicle = Chronicle(memory, "waiter")
    serving = chronicle.begin("serving", ("tray", "guest"))
    chronicle.happened("Spill", "cup_1", confidence=0.8)
    chronicle.end(serving)
    chronicle.query(kind="grasping", participants="cup_1", relation="overlaps", of=chronicle.entry(serving))

`Timeline` finds events out from the changes of a graph instead: for recordings, and graphs in which nobody writes them.
"""

from dsr.timeline.allen import ALLEN, INVERSE, AllenRelation, Interval, holds, relation, relations
from dsr.timeline.changes import EVENT_KINDS, Timeline
from dsr.timeline.chronicle import WRITTEN_ATTRIBUTES, WRITTEN_EDGES, WRITTEN_NODES, Chronicle, is_keyed, kept_by
from dsr.timeline.entries import EVENT, EXPLAINED, SITUATION, TIMELINE, Entry, explanations, read_entry
from dsr.timeline.kinds import ACTION, AGENT, DERIVED, FORBIDDEN, INTENTION, OBJECTS, PRESENT, RELATIONS, SURPRISING
from dsr.timeline.queries import query
from dsr.timeline.retention import Retention
from dsr.timeline.telling import Event, tell

__all__ = [
    "ACTION",
    "AGENT",
    "ALLEN",
    "DERIVED",
    "EVENT",
    "EVENT_KINDS",
    "EXPLAINED",
    "FORBIDDEN",
    "INTENTION",
    "INVERSE",
    "OBJECTS",
    "PRESENT",
    "RELATIONS",
    "SITUATION",
    "SURPRISING",
    "TIMELINE",
    "WRITTEN_ATTRIBUTES",
    "WRITTEN_EDGES",
    "WRITTEN_NODES",
    "AllenRelation",
    "Chronicle",
    "Entry",
    "Event",
    "Interval",
    "Retention",
    "Timeline",
    "explanations",
    "holds",
    "is_keyed",
    "kept_by",
    "query",
    "read_entry",
    "relation",
    "relations",
    "tell",
]
