"""The scene around each object that perception is about to place: all other things, where they are perceived."""

from __future__ import annotations

from simulation_handler.config import BeliefConfig
from simulation_handler.contact.placement import given_height
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import Bodies
from simulation_handler.state.objects import BelievedObject

Scene = dict[str, Solid]
"""Solids at their poses of this moment, by name."""


class Neighbourhood:
    """What is around objects while they are placed one after the other.

    Args:
        bodies: as they were before.
        scene: the solids of what was placed already.
        config: the noise of percepts.
    """

    def __init__(self, bodies: Bodies, scene: Scene, config: BeliefConfig) -> None:
        self._bodies = bodies
        self._config = config
        self.scene = scene
        """All that was placed already, where it is believed to be"""
        self.placed: set[str] = set()
        """Names of what was placed"""
        self._solids = bodies.scene(leaving_out=()) | scene
        self._perceived: Scene = {}

    def put(self, solid: Solid) -> None:
        """Take in where something was placed."""
        self.scene[solid.name] = self._solids[solid.name] = solid
        self._perceived.pop(solid.name, None)
        self.placed.add(solid.name)

    def of(self, item: BelievedObject) -> Scene:
        """The scene without an object, but with what is to be placed after it; all where it is perceived.

        What had to give way to the object is where it would be without that.
        """
        for name, solid in self._solids.items():
            if name not in self._perceived:
                self._perceived[name] = self._where_perceived(solid)
        return {name: self._perceived[name] for name in self._solids if name != item.name}

    def _where_perceived(self, solid: Solid) -> Solid:
        """A solid moved to its percept, at its own height."""
        item = self._bodies.objects.get(solid.name)
        if item is None or item.holder or item.track.estimate is None:
            return solid
        covariance = item.percept_covariance(self._config)
        return solid.moved(given_height(item.percept().position, covariance, solid.position[2]))
