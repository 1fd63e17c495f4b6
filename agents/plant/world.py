"""The bodies of the true world: floor, table, objects, and how they move under physics."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path

import pybullet

from agents.colors import FLOOR, PALETTE, TABLE
from agents.plant.bullet import Bullet
from agents.plant.meshes import Color, Size, write_box, write_shape
from agents.plant.read_files import folder_to_read
from agents.scenario.format.scenario import ObjectSpec, TableSpec
from dsr.errors import ConfigError, suggest
from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Shape
from dsr.math3d.transforms import Pose

_KINDS = {"box": pybullet.GEOM_BOX, "cylinder": pybullet.GEOM_CYLINDER, "sphere": pybullet.GEOM_SPHERE}


def collision_shape(bullet: Bullet, size: Size, shape: Shape = ()) -> int:
    """The physics engine's number of a shape: its parts, or a solid box of `size` m without any."""
    if not shape:
        number: int = bullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[side / 2 for side in size])
        return number
    number = bullet.createCollisionShapeArray(
        shapeTypes=[_KINDS[part.kind] for part in shape],
        halfExtents=[[side / 2 for side in part.size] for part in shape],
        radii=[part.size[0] / 2 for part in shape],
        lengths=[part.size[2] for part in shape],
        collisionFramePositions=[part.position for part in shape],
        collisionFrameOrientations=[part.rotation for part in shape],
    )
    return number


def visual_shape(
    bullet: Bullet, folder: Path, name: str, size: Size, color: Color, marker_id: int | None = None, shape: Shape = ()
) -> int:
    """Make the appearance of a body from files written to `folder`; returns the physics engine's number of it.

    It shows the parts of `shape`, or a box of `size` m without any. With a `marker_id` there is a tag on top (+z).
    The files are read whenever a body gets the appearance, and may be deleted in between.
    """
    return bullet.visual_mesh(_write_looks(folder, name, size, color, marker_id, shape))


def _write_looks(folder: Path, name: str, size: Size, color: Color, marker_id: int | None, shape: Shape) -> Path:
    if shape:
        return write_shape(folder, name, size, shape, color, marker_id)
    return write_box(folder, name, size, color, marker_id)


RATE_HZ = 240
"""Physics steps a second."""
STEP = 1 / RATE_HZ
GRAVITY = 9.81
"""m/s^2, acceleration of gravity, downwards"""
FLOOR_BELOW_TABLE = 0.72
"""m, from the table top down to the floor"""
STILL_SPEED = 0.005
"""m/s at the centre, below which a body counts as still"""
STILL_SPIN = 0.1
"""rad/s, below which a body counts as still"""
LEAST_HELD_MASS = 20.0
"""kg, least mass of a body that a hand holds: a lighter one would yield to what lies on it, which would creep off."""

_SETTLE_STEPS = 3 * RATE_HZ
_STILL_STEPS = 12
_UPWARD = 0.5  # least z of a contact normal that carries weight
_FLOOR_SIZE = (6.0, 6.0, 0.1)


class World:
    """Table, floor and objects in a physics client.

    Args:
        bullet: the physics client, empty.
        table: size and place of the table.
        objects: the objects with their poses at the start.
    """

    def __init__(self, bullet: Bullet, table: TableSpec, objects: Iterable[ObjectSpec]) -> None:
        self.bullet = bullet
        bullet.setGravity(0, 0, -GRAVITY)
        bullet.setPhysicsEngineParameter(fixedTimeStep=STEP, deterministicOverlappingPairs=1)
        x, y, top = table.position
        self.specs = {spec.name: spec for spec in objects}
        self._bodies: dict[str, int] = {}
        self._held: set[str] = set()
        self._balls: dict[float, int] = {}  # collision shapes by radius, m
        with folder_to_read() as files:
            self.table = self._add_block(files, "table", table.size, TABLE, (x, y, top), table.friction)
            self.floor = self._add_block(files, "floor", _FLOOR_SIZE, FLOOR, (x, y, top - FLOOR_BELOW_TABLE), 1.0)
            self._shapes = {name: self._make_shapes(files, spec) for name, spec in self.specs.items()}
            for spec in self.specs.values():
                self._add(spec.name, spec.pose)

    def __iter__(self) -> Iterator[str]:
        """Names of the objects that are in the scene."""
        return iter(self._bodies)

    def __contains__(self, name: str) -> bool:
        return name in self._bodies

    def body(self, name: str) -> int:
        """The physics engine's number of an object; `ConfigError` if it is not in the scene."""
        if name not in self._bodies:
            raise ConfigError(f"no object {name!r} in the scene; {suggest(name, self._bodies)}")
        return self._bodies[name]

    def name_of(self, body: int) -> str | None:
        """Name of the object with the number `body`; None for table, floor and robot."""
        return next((name for name, known in self._bodies.items() if known == body), None)

    def pose(self, name: str) -> Pose:
        """world_from_object, at the object's centre."""
        return self.bullet.pose(self.body(name))

    def poses(self) -> dict[str, Pose]:
        """world_from_object of all objects in the scene."""
        return {name: self.bullet.pose(body) for name, body in self._bodies.items()}

    @contextlib.contextmanager
    def shown_at(self, poses: Mapping[str, Pose]) -> Iterator[None]:
        """Draw objects at `poses` (world_from_object) for a picture; physics must not step meanwhile."""
        moved = {name: true for name, pose in poses.items() if (true := self.pose(name)) != pose}
        for name in moved:
            self.bullet.set_pose(self.body(name), poses[name])
        try:
            yield
        finally:
            for name, pose in moved.items():
                self.bullet.set_pose(self.body(name), pose)

    def put(self, name: str, pose: Pose) -> None:
        """Teleport an object, at rest; one that was removed comes back."""
        if name not in self._bodies:
            with folder_to_read() as files:
                spec = self.specs[name]
                _write_looks(files, name, spec.size, self._color(name), spec.marker_id, spec.shape)
                self._add(name, pose)
        self.drive(name, pose, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

    def drive(self, name: str, pose: Pose, velocity: Vector3, spin: Vector3) -> None:
        """Put an object at `pose`, moving at `velocity` m/s and turning at `spin` rad/s (world)."""
        body = self.body(name)
        self.bullet.set_pose(body, pose)
        self.bullet.resetBaseVelocity(body, velocity, spin)
        self.bullet.setCollisionFilterGroupMask(body, -1, 1, -1)  # forgets the anchored contacts

    def hold(self, names: Collection[str]) -> None:
        """These objects, and no others, are driven, and do not give way to what is on them or in them."""
        for name in sorted(self._held ^ set(names)):
            if name in self._bodies:
                least = LEAST_HELD_MASS if name in names else 0.0
                self.bullet.changeDynamics(self.body(name), -1, mass=max(self.specs[name].mass, least))
        self._held = set(names)

    def push(self, name: str, velocity: tuple[float, float]) -> None:
        """Let an object move at `velocity` m/s along x and y; otherwise it follows physics."""
        body = self.body(name)
        (_, _, falling), spin = self.bullet.getBaseVelocity(body)
        self.bullet.resetBaseVelocity(body, (*velocity, falling), spin)

    def velocity(self, name: str) -> tuple[Vector3, Vector3]:
        """How fast an object moves (m/s, its centre) and turns (rad/s), world."""
        velocity, spin = self.bullet.getBaseVelocity(self.body(name))
        return velocity, spin

    def launch(self, name: str, velocity: Vector3, spin: Vector3) -> None:
        """Let an object move at `velocity` m/s and turn at `spin` rad/s (world) from where it is; physics goes on."""
        self.drive(name, self.pose(name), velocity, spin)

    def remove(self, name: str) -> None:
        """Take an object out of the scene."""
        self.bullet.remove_body(self.body(name))
        del self._bodies[name]
        self._held.discard(name)

    def is_still(self, name: str) -> bool:
        """Whether the object neither moves nor turns, at this instant."""
        velocity, spin = self.bullet.getBaseVelocity(self.body(name))
        return math.hypot(*velocity) < STILL_SPEED and math.hypot(*spin) < STILL_SPIN

    def supports(self, name: str) -> set[int]:
        """Bodies that carry the object: those that push it upwards."""
        contacts = self.bullet.getContactPoints(bodyA=self.body(name))
        return {contact[2] for contact in contacts if contact[7][2] > _UPWARD}

    def has_below(self, name: str, reach: float) -> bool:
        """Whether anything lies within `reach` m under the object."""
        body = self.body(name)
        others = [self.table, self.floor, *(other for other in self._bodies.values() if other != body)]
        return any(
            point[7][2] > _UPWARD for other in others for point in self.bullet.getClosestPoints(body, other, reach)
        )

    def supported(self, name: str, *, enclosed: bool = True) -> list[str]:
        """Objects that stand on this one or, if `enclosed`, lie in it or under it; directly or on one another."""
        found = [name]
        for base in found:
            found += [other for other in self._bodies if other not in found and self._rides(other, base, enclosed)]
        return found[1:]

    @property
    def top(self) -> float:
        """The height of the highest point of all objects, or of the table, m."""
        bodies = (self.table, *self._bodies.values())
        return max(float(self.bullet.getAABB(body)[1][2]) for body in bodies)

    def depth(self, point: Vector3, radius: float, name: str | None = None) -> float:
        """How deep (m) a ball there is in an object, of all and the table at most; 0 if it is in none."""
        if radius not in self._balls:
            self._balls[radius] = self.bullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=radius)
        bodies = (self.table, *self._bodies.values()) if name is None else (self.body(name),)
        found = [
            hit
            for body in bodies
            for hit in self.bullet.getClosestPoints(
                bodyA=-1,
                bodyB=body,
                distance=0.0,
                collisionShapeA=self._balls[radius],
                collisionShapePositionA=point,
                collisionShapeOrientationA=(0.0, 0.0, 0.0, 1.0),
            )
        ]
        return max((-hit[8] for hit in found), default=0.0)

    def step(self) -> None:
        """Advance physics by `STEP`."""
        self.bullet.stepSimulation()

    def settle(self) -> None:
        """Advance physics until all objects lie still. Raises `ConfigError` when that takes too long."""
        still = 0
        for _ in range(_SETTLE_STEPS):
            self.step()
            still = still + 1 if all(map(self.is_still, self)) else 0
            if still == _STILL_STEPS:
                return
        moving = [name for name in self if not self.is_still(name)]
        raise ConfigError(
            f"objects {moving} still move after {_SETTLE_STEPS * STEP:g} s; expected all to come to rest: "
            "start them on the table or on one another, without overlap, and centred over their support"
        )

    def _rides(self, name: str, base: str, enclosed: bool) -> bool:
        if self._encloses(base, name):
            return enclosed
        return self.body(base) in self.supports(name)

    def _encloses(self, base: str, name: str) -> bool:
        """Whether an object lies in a hollow of a larger one, or under it."""
        spec, (x, y, z) = self.specs[base], self.pose(base).inverse().apply(self.pose(name).t).tolist()
        inside = all(abs(v) < edge / 2 for v, edge in zip((x, y, z), spec.size, strict=True))
        larger = math.prod(spec.size) > math.prod(self.specs[name].size)
        return inside and larger and bool(spec.shape) and not any(part.contains((x, y, z)) for part in spec.shape)

    def _add_block(
        self, folder: Path, name: str, size: Size, color: Color, top_center: Vector3, friction: float
    ) -> int:
        """A body that nothing moves, given by the centre of its top face."""
        x, y, z = top_center
        shape = collision_shape(self.bullet, size)
        visual = visual_shape(self.bullet, folder, name, size, color)
        body: int = self.bullet.create_body(0, shape, visual, [x, y, z - size[2] / 2])
        self.bullet.changeDynamics(body, -1, lateralFriction=friction)
        return body

    def _color(self, name: str) -> Color:
        return self.specs[name].color or PALETTE[list(self.specs).index(name) % len(PALETTE)]

    def _make_shapes(self, folder: Path, spec: ObjectSpec) -> tuple[int, int]:
        color = self._color(spec.name)
        visual = visual_shape(self.bullet, folder, spec.name, spec.size, color, spec.marker_id, spec.shape)
        return collision_shape(self.bullet, spec.size, spec.shape), visual

    def _add(self, name: str, pose: Pose) -> None:
        shape, visual = self._shapes[name]
        spec = self.specs[name]
        body = self.bullet.create_body(spec.mass, shape, visual, pose.t, pose.q)
        self.bullet.changeDynamics(body, -1, lateralFriction=spec.friction, frictionAnchor=1)  # else stacks creep
        if spec.rolling_friction:
            self.bullet.changeDynamics(
                body, -1, rollingFriction=spec.rolling_friction, spinningFriction=spec.rolling_friction
            )
        self._bodies[name] = body


def upright(position: Vector3, yaw: float) -> Pose:
    """The pose at `position` m, turned by `yaw` rad about the vertical only."""
    return Pose(position, quaternions.from_rotvec((0.0, 0.0, yaw)))


def yaw_of(pose: Pose) -> float:
    """The angle of the pose's x axis about the vertical, rad."""
    x_axis = quaternions.rotate(pose.q, (1.0, 0.0, 0.0))
    return math.atan2(x_axis[1], x_axis[0])
