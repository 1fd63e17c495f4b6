"""Worlds: several graphs side by side in one system, forks of one another or made anew (docs/how-to/worlds.md)."""

from dsr.worlds.clients import Client, Monitor, Provider, Reader, WorldsConfig
from dsr.worlds.comparison import Difference, Tolerance, difference
from dsr.worlds.filters import Filter, FilterConfig
from dsr.worlds.hosting import Hosted, HostedConfig
from dsr.worlds.registry import ROOT, WorldInfo

__all__ = [
    "ROOT",
    "Client",
    "Difference",
    "Filter",
    "FilterConfig",
    "Hosted",
    "HostedConfig",
    "Monitor",
    "Provider",
    "Reader",
    "Tolerance",
    "WorldInfo",
    "WorldsConfig",
    "difference",
]
