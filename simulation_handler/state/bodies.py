"""The objects and fixtures of the belief, with their bodies in the simulation."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from dsr.errors import suggest
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.math3d.shapes import Shape
from dsr.math3d.transforms import Pose
from dsr.perception.scales import RESOLUTION, SLOW
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.placement import place
from simulation_handler.perception.tracking import PerceptTrack
from simulation_handler.physics.rest import STRIDE, Rest
from simulation_handler.physics.rollouts.scene import Placing, RolloutBody, RolloutScene
from simulation_handler.physics.simulator import SimulationError, Simulator
from simulation_handler.scales import UNSEEN_SLACK
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.objects import BelievedObject

FLOOR = "_floor"
_FLOOR_SIZE = (20.0, 20.0, 0.2)  # m


class Bodies:
    """Keeps objects, fixtures and the simulator in step with each other."""

    def __init__(self, config: BeliefConfig) -> None:
        self.sim = Simulator()
        self.objects: dict[str, BelievedObject] = {}
        self.fixtures: dict[str, Solid] = {}
        self._frictions: dict[str, float] = {}
        """1, Coulomb coefficients of the fixtures"""
        self._config = config
        self._solids: dict[str, Solid] = {}
        self._lowest: float | None = None
        """m, top of the lowest table; None until that is known"""
        self._lay_floor()

    def set_fixture(
        self, name: str, size: Vector3, pose: Pose, shape: Shape = (), friction: float | None = None
    ) -> None:
        """Add a body that never moves (world_from_centre), or put it elsewhere; objects on it wake.

        `friction` is its Coulomb coefficient, None if nobody says it.
        """
        if name in self.objects:
            raise SimulationError(f"{name!r} is an object of the belief and cannot be a fixture")
        solid, before = Solid(name, size, pose.t, pose.q, fixed=True, shape=shape), self.fixtures.get(name)
        friction = self._config.default_friction if friction is None else friction
        if before == solid and self._lowest is not None and friction == self.friction_of(name):
            return
        self._fix(solid, friction)
        if before is not None or self._lowest is None or solid.top < self._lowest:
            self._lay_floor()

    def _lay_floor(self) -> None:
        """Put the floor below the lowest table."""
        self._lowest = min([solid.top for name, solid in self.fixtures.items() if name != FLOOR], default=None)
        height = (self._lowest or 0.0) - self._config.floor_below_table
        floor = Solid(FLOOR, _FLOOR_SIZE, (0.0, 0.0, height - 0.5 * _FLOOR_SIZE[2]), fixed=True)
        self._fix(floor, self._config.default_friction)

    def friction_of(self, name: str) -> float:
        """Coulomb coefficient (1) of a fixture; the default one of what is none."""
        return self._frictions.get(name, self._config.default_friction)

    def _fix(self, solid: Solid, friction: float) -> None:
        if self.fixtures.get(solid.name) == solid and self.friction_of(solid.name) == friction:
            return
        if solid.name in self.sim:
            self.sim.remove(solid.name)
        self.sim.add_body(solid.name, solid.size, solid.shape, solid.position, solid.rotation, friction=friction)
        self.fixtures[solid.name], self._frictions[solid.name] = solid, friction

    def add_object(
        self,
        name: str,
        size: Vector3,
        mass: float | None,
        friction: float | None,
        shape: Shape = (),
        *,
        rolling_friction: float | None = None,
        tagged: bool = True,
    ) -> BelievedObject:
        """Let an object exist, without a place yet."""
        if name in self.objects or name in self.fixtures:
            raise SimulationError(f"{name!r} is already part of the belief")
        mass = self._config.default_mass if mass is None else mass
        friction = self._config.default_friction if friction is None else friction
        self.objects[name] = BelievedObject(
            name, size, mass, friction, PerceptTrack(self._config), shape,
            rolling_friction=rolling_friction, tagged=tagged,
        )  # fmt: skip
        return self.objects[name]

    def remove(self, name: str) -> None:
        """Forget an object or a fixture; harmless if there is none."""
        if name in self.sim:
            self.sim.remove(name)
        self.objects.pop(name, None)
        self._solids.pop(name, None)
        self._frictions.pop(name, None)
        if self.fixtures.pop(name, None) is not None:
            self._lowest = None

    def object(self, name: str) -> BelievedObject:
        """The object of that name. Raises `SimulationError` if there is none."""
        try:
            return self.objects[name]
        except KeyError:
            raise SimulationError(f"no object {name!r} in the belief; {suggest(name, self.objects)}") from None

    def pose(self, name: str) -> Pose:
        """world_from_object of a body."""
        return Pose.unchecked(*self.sim.pose(name))

    def solid(self, name: str) -> Solid:
        """The object at its believed pose; the same solid, with all that was worked out of it, while it stays there."""
        position, rotation = self.sim.pose(name)
        solid = self._solids.get(name)
        if solid is None or solid.position != position or solid.rotation != rotation:
            solid = self._solids[name] = self.objects[name].solid(position, rotation)
        return solid

    def above(self, item: BelievedObject, percept: Vector3) -> set[str]:
        """Names of compound bodies that stand higher than an object and so do not carry it; none if it has left.

        Of a mug on a tray, the bottom is so low that, by noise, the tray might be thought to rest on that.
        """
        body = self.solid(item.name) if item.name in self.sim else None
        if body is None or math.dist(body.position, percept) > self._config.hover_tolerance:
            return set()
        others = [
            other for name, other in self.objects.items() if other.shape and name in self.sim and other is not item
        ]
        return {other.name for other in others if self.solid(other.name).bottom > body.bottom + RESOLUTION}

    def on_contact(self, solid: Solid, leaving_out: Collection[str]) -> Solid:
        """The solid of an unseen object, put on what carries it there, if something does."""
        others = list(self.scene(leaving_out={solid.name, *leaving_out}).values())
        return place(solid, UNSEEN_SLACK**2 * np.eye(3), others, self._config).solid

    def scene(self, leaving_out: Collection[str]) -> dict[str, Solid]:
        """All fixtures, and all other bodies at their believed poses."""
        present = (name for name in self.objects if name in self.sim and name not in leaving_out)
        return self.fixtures | {name: self.solid(name) for name in present}

    def frozen(self) -> RolloutScene:
        """Copy the present scene, to be simulated elsewhere: bodies that are held are fixed, speeds are left out."""
        bodies = [
            RolloutBody(
                solid.name, solid.size, solid.position, solid.rotation, friction=self.friction_of(solid.name),
                fixed=True, shape=solid.shape,
            )
            for solid in self.fixtures.values()
        ]  # fmt: skip
        return RolloutScene((*bodies, *(self.body(name) for name in self.objects if name in self.sim)))

    def body(self, name: str) -> RolloutBody:
        """The body of an object as it is now, at rest."""
        item, pose = self.objects[name], self.sim.pose(name)
        return RolloutBody(
            name, item.size, *pose, item.mass, item.friction, item.static, item.shape, item.rolling_friction
        )  # fmt: skip

    def put(self, item: BelievedObject, position: Vector3, rotation: Quaternion) -> None:
        """Put the body of an object somewhere, at rest; the first time makes it."""
        if item.name in self.sim:
            self.sim.place(item.name, position, rotation)
        else:
            self.sim.add_body(
                item.name, item.size, item.shape, position, rotation,
                mass=item.mass, friction=item.friction, rolling_friction=item.rolling_friction,
            )  # fmt: skip
            item.static, item.gone = False, False
        item.put = Pose.unchecked(position, rotation)

    def note_stances(self) -> None:
        """Keep in mind how all objects are turned now, but for those on their way: those follow what was seen."""
        for name, item in self.objects.items():
            if name in self.sim and not item.driven:
                item.stance = self.sim.pose(name)[1]

    def take_away(self, item: BelievedObject) -> None:
        """Take the body of an object out: it has no place any more."""
        if item.name in self.sim:
            self.sim.remove(item.name)
        item.leave_to_physics()
        item.put, item.static, item.gone = None, False, True

    def set_static(self, item: BelievedObject, static: bool) -> None:
        """Hold the body of an object where it is, or let it go."""
        if item.static != static:
            self.sim.make_static(item.name, static)
            item.static = static

    def has_left(self, item: BelievedObject) -> bool:
        """Whether physics has moved an object from the pose at which it was put."""
        return item.name in self.sim and item.has_left(self.pose(item.name), self._config)

    def in_motion(self) -> set[str]:
        """Objects that fall or roll."""
        return {name for name in self.objects if name in self.sim and self.sim.speed(name)[0] > SLOW}

    def pass_time(self, count: int) -> None:
        """Let so many steps of physics pass. Of many, the last ones are left out that would move nothing."""
        if count >= 2 * STRIDE and not self.sim.fingers.bodies:
            poses = self._placings()
            rest = Rest(poses, {name: 0.5 * math.hypot(*self.objects[name].size) for name in poses})
            while count >= 2 * STRIDE:
                self.sim.step(STRIDE)
                count -= STRIDE
                if rest.look(self._placings()):
                    return
        self.sim.step(count)

    def _placings(self) -> dict[str, Placing]:
        return {name: self.sim.pose(name) for name in self.objects if name in self.sim}

    def unplaced(self) -> dict[str, Vector3]:
        """Edge lengths (m) of the boxes that exist and have no place, by name; those believed to be gone come last."""
        items = (item for name, item in self.objects.items() if name not in self.sim and not item.shape)
        return {item.name: item.size for item in sorted(items, key=lambda item: (item.gone, item.name))}
