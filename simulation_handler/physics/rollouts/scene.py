"""A scene to simulate: bodies somewhere in the world, as values that can be changed by copy and sent around."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

from dsr.errors import suggest
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.math3d.shapes import Shape
from simulation_handler.physics.simulator import SimulationError
from simulation_handler.scales import FRICTION
from simulation_handler.shapes.geometry import Solid

Placing = tuple[Vector3, Quaternion]
"""world_from_body: position (m) and rotation (x, y, z, w)."""

STILL: Vector3 = (0.0, 0.0, 0.0)


class RolloutBody(NamedTuple):
    """A body, at rest unless it is said how it moves."""

    name: str
    size: Vector3
    """Edge lengths of its bounding box, m."""
    position: Vector3
    """Position of the body's centre in the world, m."""
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)
    mass: float = 0.0
    """kg; 0 for one that can never move."""
    friction: float = FRICTION
    """Coulomb coefficient; that of a contact is the product of both bodies'."""
    fixed: bool = False
    """Whether the body stays where it is: a fixture, or an object that is held in place."""
    shape: Shape = ()
    """Pieces of the body's shape; none for a solid box."""
    rolling_friction: float | None = None
    """m, lever arm of the resistance to rolling; None if that is not known"""
    velocity: Vector3 = STILL
    """Velocity of the body's centre in the world at the beginning, m/s."""
    spin: Vector3 = STILL
    """Angular velocity of the body in the world at the beginning, rad/s."""

    @property
    def solid(self) -> Solid:
        """The body alone."""
        return Solid(self.name, self.size, self.position, self.rotation, self.fixed, self.shape)


@dataclass(frozen=True)
class RolloutScene:
    """Bodies of different names, sorted by name, so that equal scenes have equal outcomes.

    Every method returns a changed copy. Raises `SimulationError` for a name that is there twice, or that is not
    there.
    """

    bodies: tuple[RolloutBody, ...]

    def __post_init__(self) -> None:
        ordered = tuple(sorted(self.bodies))
        for body, following in pairwise(ordered):
            if body.name == following.name:
                raise SimulationError(f"body {body.name!r} is twice in a scene")
        object.__setattr__(self, "bodies", ordered)

    def __contains__(self, name: str) -> bool:
        return name in self._by_name

    def __getitem__(self, name: str) -> RolloutBody:
        self._check([name])
        return self._by_name[name]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all bodies, sorted."""
        return tuple(self._by_name)

    def moved(self, placings: Mapping[str, Placing]) -> RolloutScene:
        """Copy the scene with some bodies elsewhere, at rest there."""
        self._check(placings)
        return RolloutScene(
            tuple(_at_rest(body, *placings[body.name]) if body.name in placings else body for body in self.bodies)
        )

    def without(self, names: Collection[str]) -> RolloutScene:
        """Copy the scene without some bodies."""
        self._check(names)
        return RolloutScene(tuple(body for body in self.bodies if body.name not in names))

    def held(self, names: Collection[str]) -> RolloutScene:
        """Copy the scene with some bodies held where they are, whatever pushes them."""
        return self._with_fixed(names, True)

    def released(self, names: Collection[str]) -> RolloutScene:
        """Copy the scene with some bodies free to move; one without mass stays fixed all the same."""
        return self._with_fixed(names, False)

    def _with_fixed(self, names: Collection[str], fixed: bool) -> RolloutScene:
        self._check(names)
        return RolloutScene(tuple(body._replace(fixed=fixed) if body.name in names else body for body in self.bodies))

    @cached_property
    def _by_name(self) -> dict[str, RolloutBody]:
        return {body.name: body for body in self.bodies}

    def _check(self, names: Iterable[str]) -> None:
        for name in names:
            if name not in self._by_name:
                raise SimulationError(f"no body {name!r} in the scene; {suggest(name, self._by_name)}")


def _at_rest(body: RolloutBody, position: Vector3, rotation: Quaternion) -> RolloutBody:
    return body._replace(position=position, rotation=rotation, velocity=STILL, spin=STILL)
