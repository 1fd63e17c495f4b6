"""Perspectives: who sees what, and what each person knows of the world by that."""

from agents.perspectives.agent import Perspectives
from agents.perspectives.visibility import Visibility

__all__ = ["Perspectives", "Visibility"]
