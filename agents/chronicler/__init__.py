"""Writes to the timeline what follows from the state of the graph, so that agents need not watch all of it."""

from agents.chronicler.agent import Chronicler, ChroniclerConfig

__all__ = ["Chronicler", "ChroniclerConfig"]
