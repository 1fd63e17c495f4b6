"""Worlds: several graphs side by side in one system, forks of one another or made anew (docs/worlds.md)."""

from dsr.worlds.registry import ROOT, WorldInfo

__all__ = ["ROOT", "WorldInfo"]
