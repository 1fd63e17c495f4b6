"""Persons: where their eyes are, and where they look."""

from agents.person_tracker.agent import PersonTracker

__all__ = ["PersonTracker"]
