"""Kinds of entries that follow from the state of the graph, and that the chronicler writes."""

from __future__ import annotations

from dsr.timeline.entries import EXPLAINED
from dsr.vocabulary.relations import THINGS

RELATIONS = ("on", "in", "grasping")
"""Edge types whose coming and going is told; as kinds of situations they have participants (source, destination)."""
OBJECTS = (*THINGS, "hand")
"""Node types whose coming and going is told."""
PRESENT, SURPRISING, AGENT = "present", "surprising", "agent"
"""Situations: a thing is believed to be in the scene; it surprises; an agent is at work."""
FORBIDDEN = "halted"
"""Situation: an emergency stop forbids motion; its participant is the node of the order."""
INTENTION, ACTION = "intention", "action"
"""Situations: an intention is pursued, an action runs. Events: its status became another."""
DERIVED = frozenset({*RELATIONS, PRESENT, SURPRISING, AGENT, FORBIDDEN, INTENTION, ACTION, EXPLAINED})
"""All kinds in this module: those that a reader of the changes finds out by itself."""
