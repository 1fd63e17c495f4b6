"""Writes the facts of the graph to the timeline, so that agents need not watch all of the graph."""

from agents.chronicler.agent import Chronicler, ChroniclerConfig

__all__ = ["Chronicler", "ChroniclerConfig"]
