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
        scene: the solids of what was placed already. Who places something puts the solid there.
        config: the noise of percepts.
    """

    def __init__(self, bodies: Bodies, scene: Scene, config: BeliefConfig) -> None:
        self._bodies = bodies
        self._config = config
        self._before = bodies.scene(leaving_out=())
        self._scene = scene
        self._perceived: dict[str, tuple[Solid, Solid]] = {}

    def of(self, item: BelievedObject) -> Scene:
        """The scene without an object, but with what is to be placed after it; all where it is perceived.

        What had to give way to the object is where it would be without that.
        """
        scene = self._before | self._scene
        scene.pop(item.name, None)
        return {name: self._where_perceived(name, solid) for name, solid in scene.items()}

    def _where_perceived(self, name: str, solid: Solid) -> Solid:
        """A solid moved to its percept, at its own height. It is worked out once as long as the solid stays there."""
        known = self._perceived.get(name)
        if known is None or known[0] is not solid:
            known = self._perceived[name] = solid, self._moved(name, solid)
        return known[1]

    def _moved(self, name: str, solid: Solid) -> Solid:
        item = self._bodies.objects.get(name)
        if item is None or item.holder or item.track.estimate is None:
            return solid
        covariance = item.percept_covariance(self._config)
        return solid.moved(given_height(item.percept().position, covariance, solid.position[2]))
