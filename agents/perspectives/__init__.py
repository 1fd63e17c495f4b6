"""Perspectives: which person sees which things, and knows which part of the world by that."""

from agents.perspectives.agent import Perspectives
from agents.perspectives.visibility import Visibility

__all__ = ["Perspectives", "Visibility"]
