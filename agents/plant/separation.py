"""How near the arms of the true world come to one another: for judges, never for agents."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, product

from agents.plant.arm import SimulatedArm
from agents.plant.world import World

MEASURED = 0.3
"""m between two arms from which on nothing is measured: far more than arms keep apart"""
EVERY = 4
"""Steps of physics between two measurements: an arm of 1 m/s moves by 17 mm meanwhile. Contacts are told by each"""


class ArmSeparation:
    """The least distance between any two arms, with what their grippers hold.

    Args:
        world: with the held objects.
        arms: all of them.
    """

    def __init__(self, world: World, arms: Sequence[SimulatedArm]) -> None:
        self._world = world
        self._pairs = list(combinations(arms, 2))
        self._steps = 0
        self._least: float | None = None

    def step(self) -> None:
        """Look, after a step of physics."""
        measures = self._steps % EVERY == 0
        self._steps += 1
        for one, other in self._pairs:
            for a, b in product(self._bodies(one), self._bodies(other)):
                found = self._distances(a, b, measures=measures)
                self._least = min([*found, *([] if self._least is None else [self._least])], default=None)

    def take(self) -> float | None:
        """The least distance (m) since the last call; negative for the depth of a contact, None if there was none."""
        least, self._least = self._least, None
        return least

    def _distances(self, one: int, other: int, *, measures: bool) -> list[float]:
        bullet = self._world.bullet
        if measures:
            points = bullet.getClosestPoints(bodyA=one, bodyB=other, distance=MEASURED)
        else:
            points = bullet.getContactPoints(bodyA=one, bodyB=other)
        return [point[8] for point in points]

    def _bodies(self, arm: SimulatedArm) -> list[int]:
        """The arm, and what it holds."""
        return [arm.body] if arm.held is None else [arm.body, self._world.body(arm.held)]
