"""A snapshot of the graph at one moment, with all from which actions are inferred."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from dsr.vocabulary.observed_actions import Deed


@dataclass(frozen=True)
class ObservedThing:
    """An object."""

    name: str
    perceived: bool = False
    plausible: bool = True
    is_placed: bool = False
    """Whether the belief has a place for it."""
    deeds: tuple[Deed, ...] = ()
    """What was done with it last, by the belief, oldest first"""


@dataclass(frozen=True)
class Snapshot:
    """One moment."""

    now: float
    """Time of the snapshot, s."""
    things: Mapping[str, ObservedThing] = field(default_factory=dict)
