"""Imagination: plans are carried out in forks of the world, compared, and one of them is adopted."""

from agents.imagination.agent import Adoption, Imagination

__all__ = ["Adoption", "Imagination"]
