"""Which objects need not be placed anew: percepts and all that is near them are as they were when they were placed."""

from __future__ import annotations

from collections.abc import Mapping

from dsr.math3d.tolerance import PoseTolerance
from dsr.perception.scales import RECENT_PERCEPTS, RESOLUTION
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.placement import near
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.objects import BelievedObject


class Unchanged:
    """Remembers what was placed among what, until something near that has moved.

    Args:
        config: how far physics may turn bodies.
    """

    def __init__(self, config: BeliefConfig) -> None:
        self._same = PoseTolerance(RESOLUTION, config.divergence_angle)
        self._solids: dict[str, Solid] = {}
        """All bodies where they were when that was news last"""
        self._counts: dict[str, int] = {}
        """How many percepts each object had when it was placed among those"""

    def look(self, solids: Mapping[str, Solid]) -> set[str]:
        """Take in where all bodies are; return the names of those that have moved."""
        for name in self._solids.keys() - solids.keys():
            self._counts.pop(name, None)
            self._disturb(self._solids.pop(name))
        return {name for name, solid in solids.items() if self.note(solid)}

    def note(self, solid: Solid) -> bool:
        """Take in where a body is; whether it was elsewhere before, so that what is near may be carried otherwise."""
        before = self._solids.get(solid.name)
        if before is solid or (before is not None and self._same.covers(before.pose, solid.pose)):
            return False
        self._solids[solid.name] = solid
        for place in (solid,) if before is None else (before, solid):
            self._disturb(place)
        return True

    def _disturb(self, solid: Solid) -> None:
        for other in near(solid, self._solids.values()):
            self._counts.pop(other.name, None)

    def placed(self, item: BelievedObject) -> None:
        """Know that an object was placed by its percepts so far, among all that is there."""
        assert item.track.estimate is not None
        self._counts[item.name] = item.track.estimate.count

    def __contains__(self, item: BelievedObject) -> bool:
        """Whether nothing near an object has moved since it was placed, and few percepts came."""
        count, estimate = self._counts.get(item.name), item.track.estimate
        if count is None or estimate is None or item.restarts != item.track.restarts:
            return False
        return estimate.count - count < RECENT_PERCEPTS
