"""The timeline: events (instants) and situations (with a begin and an end) in the working memory.

    chronicle = Chronicle(memory, "waiter")
    serving = chronicle.begin("serving", ("tray", "guest"))
    chronicle.happened("Spill", "cup_1", confidence=0.8)
    chronicle.end(serving)
    chronicle.query(kind="grasping", participants="cup_1", relation="overlaps", of=chronicle.entry(serving))

What is over goes into summaries of hours, days and weeks (`Consolidator`); `recall` asks these too.

`Timeline` finds events out from the changes of a graph instead: for recordings, and graphs in which nobody writes them.
"""

from dsr.timeline.allen import ALLEN, INVERSE, AllenRelation, Interval, holds, relation, relations
from dsr.timeline.changes import EVENT_KINDS, Timeline
from dsr.timeline.chronicle import WRITTEN_ATTRIBUTES, WRITTEN_EDGES, WRITTEN_NODES, Chronicle, is_keyed, kept_by
from dsr.timeline.consolidation import SUMMARY_ATTRIBUTES, SUMMARY_NODES, Consolidator
from dsr.timeline.entries import EVENT, EXPLAINED, SITUATION, TIMELINE, Entry, explanations, read_entry
from dsr.timeline.kinds import ACTION, AGENT, DERIVED, FORBIDDEN, INTENTION, OBJECTS, PRESENT, RELATIONS, SURPRISING
from dsr.timeline.queries import query
from dsr.timeline.recall import SUMMARY, StoredSummary, read_summary, recall, stored_summaries
from dsr.timeline.remembered import PeriodSummary, Remembered
from dsr.timeline.retention import Retention
from dsr.timeline.summaries import SURPRISES
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
    "SUMMARY",
    "SUMMARY_ATTRIBUTES",
    "SUMMARY_NODES",
    "SURPRISES",
    "SURPRISING",
    "TIMELINE",
    "WRITTEN_ATTRIBUTES",
    "WRITTEN_EDGES",
    "WRITTEN_NODES",
    "AllenRelation",
    "Chronicle",
    "Consolidator",
    "Entry",
    "Event",
    "Interval",
    "PeriodSummary",
    "Remembered",
    "Retention",
    "StoredSummary",
    "Timeline",
    "explanations",
    "holds",
    "is_keyed",
    "kept_by",
    "query",
    "read_entry",
    "read_summary",
    "recall",
    "relation",
    "relations",
    "stored_summaries",
    "tell",
]
