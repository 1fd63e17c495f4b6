"""Rigid bodies under gravity: a typed wrapper over one pybullet client, bodies by name.

Everything is in the world frame, SI units, quaternions (x, y, z, w). The same calls in the same order give
bit-identical results, also in another process.

Contacts: measured on 40 mm cubes, those at rest interpenetrate by less than 0.05 mm with Bullet's own
parameters; those that fall by 40 mm do so by 3 mm on impact, unless the steps are made smaller meanwhile.
Friction anchors keep them from creeping (0.7 mm in 10 s in a stack of three without).
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Iterable, Set
from types import TracebackType
from typing import NamedTuple

import pybullet

from dsr.errors import DsrError, suggest
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.math3d.shapes import MOST_PARTS, PartKind, Shape
from dsr.perception.scales import FASTEST_SEEN, FRAME, RESOLUTION
from simulation_handler.physics.finger_bodies import FingerBodies
from simulation_handler.scales import FRICTION, GRAVITY
from simulation_handler.shapes.hull_shapes import make_hulls

TIME_STEP = 1.0 / 240.0
"""s, of one physics step."""
MOST_STEPS = round(2.0 * FRAME / TIME_STEP)
"""Steps of physics in one step of the belief: time in which cameras have shown several images is lost"""
FINGER_RADIUS = 0.005
"""m, of the spheres of fingertips: less than a fingertip's by the error of landmarks."""
_STEP_REACH = 0.0004  # m that a body may move in one step: it gets that far into what it hits
_MOST_PARTS = math.ceil((FASTEST_SEEN + GRAVITY * TIME_STEP) * TIME_STEP / _STEP_REACH)
"""Parts of a step: enough for what hands move"""
_RECOVERY = 0.08  # share of an interpenetration that is undone in 1/240 s, as pybullet has it
_ENABLE_SLEEPING: int = pybullet.ACTIVATION_STATE_ENABLE_SLEEPING
_DISABLE_SLEEPING: int = pybullet.ACTIVATION_STATE_DISABLE_SLEEPING
_ROLLING_FRICTION = 0.01  # m, of what is round, if nobody says: a ball comes to rest as on a soft cloth
SLEEP_SPEED = 0.02
"""m/s or rad/s, below which a body may fall asleep"""
_GEOMETRIES: dict[PartKind, int] = {
    "box": pybullet.GEOM_BOX,
    "cylinder": pybullet.GEOM_CYLINDER,
    "sphere": pybullet.GEOM_SPHERE,
}
TOUCHING = RESOLUTION
"""m between two surfaces up to which bodies touch"""


class SimulationError(DsrError):
    """A body that does not exist, exists twice, or cannot be simulated."""


class Contact(NamedTuple):
    """Two bodies that touch."""

    upper: str
    """The body that the contact pushes up (for a side contact, the first one)."""
    lower: str
    distance: float
    """m between the surfaces; negative where they interpenetrate."""
    steepness: float
    """Vertical part of the contact's unit normal, 0 for a side contact to 1 for one body on another."""


class Simulator:
    """A world of named rigid bodies with gravity and contact.

    Args:
        sleeping: bodies at rest cost little; what slept leaves traces that keep later runs from being bit-identical.
        most_parts: into how many steps 1/240 s is divided at most while something moves fast; with fewer, it gets
            further into what it hits.
    """

    def __init__(self, *, sleeping: bool = True, most_parts: int = _MOST_PARTS) -> None:
        self._sleeping = sleeping
        self._most_parts = most_parts
        self._client: int = pybullet.connect(pybullet.DIRECT)
        self._free = weakref.finalize(self, pybullet.disconnect, physicsClientId=self._client)
        self._ids: dict[str, int] = {}
        self._names: dict[int, str] = {}
        self._masses: dict[str, float] = {}
        self._shapes: dict[Vector3 | Shape, int] = {}
        self._radii: dict[int, float] = {}
        self._passing: set[tuple[str, str]] = set()
        self._parts = 1
        self._poses: dict[int, tuple[Vector3, Quaternion]] = {}
        """Where bodies are, as far as somebody has asked since they moved"""
        self.fingers = FingerBodies(self._client, self._ids, FINGER_RADIUS)
        """Fingertips that push; they are none of the bodies."""
        pybullet.setGravity(0.0, 0.0, -GRAVITY, physicsClientId=self._client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=TIME_STEP, deterministicOverlappingPairs=1, physicsClientId=self._client
        )

    def __enter__(self) -> Simulator:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __contains__(self, name: str) -> bool:
        return name in self._ids

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all bodies, in the order they were added."""
        return tuple(self._ids)

    def add_box(
        self,
        name: str,
        size: Vector3,
        position: Vector3,
        rotation: Quaternion = (0.0, 0.0, 0.0, 1.0),
        *,
        mass: float = 0.0,
        friction: float = FRICTION,
    ) -> None:
        """Add a solid box; see `add_body`."""
        self.add_body(name, size, (), position, rotation, mass=mass, friction=friction)

    def add_body(
        self,
        name: str,
        size: Vector3,
        shape: Shape,
        position: Vector3,
        rotation: Quaternion = (0.0, 0.0, 0.0, 1.0),
        *,
        mass: float = 0.0,
        friction: float = FRICTION,
        rolling_friction: float | None = None,
    ) -> None:
        """Add a body.

        Args:
            name: not in use yet.
            size: (3,) edge lengths of its bounding box, m.
            shape: its pieces; none for a solid box.
            position: (3,) of its centre, m.
            rotation: (4,) of the body in the world.
            mass: kg; 0 for one that never moves.
            friction: Coulomb coefficient; that of a contact is the product of both bodies'.
            rolling_friction: m, lever arm of the resistance to rolling and spinning; None for one that is usual.

        Raises:
            SimulationError: for a name in use, or a size, shape or mass that no body can have.
        """
        if name in self._ids:
            raise SimulationError(f"body {name!r} is already in the simulation")
        if not all(0.0 < edge < math.inf for edge in size) or not 0.0 <= mass < math.inf:
            raise SimulationError(f"body {name!r}: size {size} m, mass {mass} kg; expected finite positive values")
        if len(shape) > MOST_PARTS:
            raise SimulationError(f"body {name!r}: {len(shape)} pieces; the simulation takes {MOST_PARTS}")
        body: int = pybullet.createMultiBody(
            mass, self._shape_of(size, shape), basePosition=position, baseOrientation=rotation,
            physicsClientId=self._client,
        )  # fmt: skip
        pybullet.changeDynamics(
            body, -1, lateralFriction=friction, frictionAnchor=1, restitution=0.0, sleepThreshold=SLEEP_SPEED,
            activationState=_ENABLE_SLEEPING if self._sleeping else _DISABLE_SLEEPING, physicsClientId=self._client,
        )  # fmt: skip
        if rolling_friction is None:
            rolling_friction = _ROLLING_FRICTION if any(part.kind != "box" for part in shape) else 0.0
        if rolling_friction:
            pybullet.changeDynamics(
                body, -1, rollingFriction=rolling_friction, spinningFriction=rolling_friction,
                physicsClientId=self._client,
            )  # fmt: skip
        self._ids[name], self._names[body], self._masses[name] = body, name, mass
        self._radii[body] = 0.5 * math.hypot(*size)

    def remove(self, name: str) -> None:
        """Take a body out; objects that rested on it will fall."""
        body = self._id(name)
        self._wake_around(body)
        self.fingers.forget(name)
        self.let_pass({pair for pair in self._passing if name not in pair})
        pybullet.removeBody(body, physicsClientId=self._client)
        del self._ids[name], self._names[body], self._masses[name], self._radii[body]
        self._poses.pop(body, None)

    def position(self, name: str) -> Vector3:
        """(3,) of the body's centre, m."""
        return self.pose(name)[0]

    def pose(self, name: str) -> tuple[Vector3, Quaternion]:
        """Position (3,) m of the body's centre, and rotation (4,)."""
        body = self._id(name)
        if (known := self._poses.get(body)) is None:
            known = pybullet.getBasePositionAndOrientation(body, physicsClientId=self._client)
            self._poses[body] = known
        return known

    def speed(self, name: str) -> tuple[float, float]:
        """How fast the body moves (m/s) and turns (rad/s)."""
        linear, angular = self.velocity(name)
        return math.hypot(*linear), math.hypot(*angular)

    def place(
        self,
        name: str,
        position: Vector3,
        rotation: Quaternion,
        velocity: Vector3 = (0.0, 0.0, 0.0),
        spin: Vector3 = (0.0, 0.0, 0.0),
    ) -> None:
        """Put a body at `position` (m, world) and `rotation`, at rest or moving (m/s, rad/s).

        Bodies that touched it there, or touch it here, wake.
        """
        body = self._id(name)
        self._wake_around(body)
        self._poses.pop(body, None)
        pybullet.resetBasePositionAndOrientation(body, position, rotation, physicsClientId=self._client)
        pybullet.resetBaseVelocity(body, velocity, spin, physicsClientId=self._client)
        self._forget_contacts(body)
        self._wake_around(body)

    def set_velocity(self, name: str, linear: Vector3, angular: Vector3) -> None:
        """Let a body move (3,) m/s and turn (3,) rad/s from now on, until it meets something."""
        pybullet.resetBaseVelocity(self._id(name), linear, angular, physicsClientId=self._client)

    def velocity(self, name: str) -> tuple[Vector3, Vector3]:
        """(3,) m/s of the body's centre, and (3,) rad/s."""
        linear, angular = pybullet.getBaseVelocity(self._id(name), physicsClientId=self._client)
        return linear, angular

    def wake(self, name: str) -> None:
        """Wake a body and all bodies near it."""
        self._wake_around(self._id(name))

    def make_static(self, name: str, static: bool) -> None:
        """Hold a body where it is, whatever pushes it; or let it go again."""
        body = self._id(name)
        mass = 0.0 if static else self._masses[name]
        pybullet.changeDynamics(body, -1, mass=mass, physicsClientId=self._client)
        self._wake_around(body)

    def let_pass(self, pairs: Set[tuple[str, str]]) -> None:
        """Let these pairs of bodies, and no others, pass through each other."""
        for pair in sorted(pairs ^ self._passing):
            self._filter(pair, may_collide=pair not in pairs)
        self._passing = set(pairs)

    def _filter(self, pair: tuple[str, str], *, may_collide: bool) -> None:
        one, other = map(self._id, pair)
        pybullet.setCollisionFilterPair(one, other, -1, -1, int(may_collide), physicsClientId=self._client)
        self._wake_around(one)  # sleepers have just lost all their contacts
        self._wake_around(other)

    def step(self, count: int = 1) -> None:
        """Let `count` times 1/240 s pass, in smaller steps while something moves fast.

        Bodies that interpenetrate come apart as slowly in smaller steps: what flies apart must not do so ever faster.
        """
        self._poses.clear()
        for _ in range(count):
            self.fingers.advance()
            parts = self._parts_of_a_step()
            if parts != self._parts:
                self._parts = parts
                pybullet.setPhysicsEngineParameter(
                    fixedTimeStep=TIME_STEP / parts, contactERP=_RECOVERY / parts, physicsClientId=self._client
                )
            for _ in range(parts):
                pybullet.stepSimulation(physicsClientId=self._client)

    def contacts(self, within: float = TOUCHING) -> list[Contact]:
        """Pairs of bodies whose surfaces are closer than `within` m: the deepest point of each pair, sorted."""
        deepest: dict[tuple[str, str], Contact] = {}
        for point in pybullet.getContactPoints(physicsClientId=self._client):
            if point[1] not in self._names or point[2] not in self._names:
                continue
            contact = self._contact(point[1], point[2], point[7][2], point[8])
            if contact.distance >= within:
                continue
            known = deepest.get(contact[:2])
            if known is None or contact.distance < known.distance:
                deepest[contact[:2]] = contact
        return sorted(deepest.values())

    def contacts_between(self, one: str, other: str) -> list[Contact]:
        """Where the surfaces of two bodies touch: `contacts` tells nothing of two that cannot move."""
        a, b = self._id(one), self._id(other)
        points = pybullet.getClosestPoints(a, b, TOUCHING, physicsClientId=self._client)
        return [self._contact(a, b, point[7][2], point[8]) for point in points]

    def snapshot(self) -> int:
        """Keep the whole state (poses, velocities, contacts) in memory; returns a handle for `restore`."""
        handle: int = pybullet.saveState(physicsClientId=self._client)
        return handle

    def restore(self, handle: int) -> None:
        """Go back to a snapshot. Raises `SimulationError` if bodies were added or removed since."""
        try:
            self._poses.clear()
            pybullet.restoreState(handle, physicsClientId=self._client)
        except pybullet.error as error:
            raise SimulationError(f"snapshot {handle} does not fit the bodies that are there now") from error

    def discard(self, handle: int) -> None:
        """Forget a snapshot."""
        pybullet.removeState(handle, physicsClientId=self._client)

    def close(self) -> None:
        """Free everything; harmless when repeated."""
        self._free()
        self._client = -1
        self._ids.clear()

    def _id(self, name: str) -> int:
        try:
            return self._ids[name]
        except KeyError:
            raise SimulationError(f"no body {name!r} in the simulation; {suggest(name, self._ids)}") from None

    def _parts_of_a_step(self) -> int:
        """Into how many steps 1/240 s must be divided so that nothing gets far into what it hits."""
        if self._most_parts == 1:
            return 1
        fastest, velocity_of, client, hypot = 0.0, pybullet.getBaseVelocity, self._client, math.hypot
        radii = self._radii if not (tips := self.fingers.bodies) else self._radii | dict.fromkeys(tips, FINGER_RADIUS)
        for body, radius in radii.items():
            linear, spin = velocity_of(body, client)
            speed = hypot(*linear) + radius * hypot(*spin)  # a bound of the speed of its corners, m/s
            fastest = max(fastest, speed)
        fastest += GRAVITY * TIME_STEP
        return min(math.ceil(fastest * TIME_STEP / _STEP_REACH), self._most_parts)

    def _shape_of(self, size: Vector3, shape: Shape) -> int:
        """One shape per form for the life of the client: pybullet never frees the shape of a removed body."""
        key = shape or size
        if key not in self._shapes:
            made = self._made_of(shape) if shape else self._box(size)
            if made < 0:
                raise SimulationError(f"pybullet cannot make a body of the pieces {shape}")
            self._shapes[key] = made
        return self._shapes[key]

    def _box(self, size: Vector3) -> int:
        made: int = pybullet.createCollisionShape(
            pybullet.GEOM_BOX, halfExtents=[0.5 * edge for edge in size], physicsClientId=self._client
        )
        return made

    def _made_of(self, shape: Shape) -> int:
        return make_hulls(shape, self._client) if any(part.corners for part in shape) else self._compound(shape)

    def _compound(self, shape: Shape) -> int:
        made: int = pybullet.createCollisionShapeArray(
            shapeTypes=[_GEOMETRIES[part.kind] for part in shape],
            halfExtents=[[0.5 * edge for edge in part.size] for part in shape],
            radii=[0.5 * part.size[0] for part in shape],
            lengths=[part.size[2] for part in shape],
            collisionFramePositions=[part.position for part in shape],
            collisionFrameOrientations=[part.rotation for part in shape],
            physicsClientId=self._client,
        )
        return made

    def _contact(self, a: int, b: int, normal_z: float, distance: float) -> Contact:
        """Contact of bodies a and b with the normal that pushes a away from b."""
        if normal_z < 0.0:
            a, b = b, a
        return Contact(self._names[a], self._names[b], distance, abs(normal_z))

    def _forget_contacts(self, body: int) -> None:
        """Drop cached contacts, whose friction anchors would pull the body back to where it was.

        Setting the collision group, even to the default, makes Bullet refresh the body's broadphase proxy.
        """
        pybullet.setCollisionFilterGroupMask(body, -1, 1, -1, physicsClientId=self._client)

    def _wake_around(self, body: int) -> None:
        """Wake a body and all that is near it and can move: pybullet lets sleepers hang in the air."""
        if not self._sleeping:
            return
        low, high = pybullet.getAABB(body, physicsClientId=self._client)
        near = pybullet.getOverlappingObjects(
            [edge - TOUCHING for edge in low], [edge + TOUCHING for edge in high], physicsClientId=self._client
        )
        self._wake({body, *(other for other, _ in near or ())})

    def _wake(self, bodies: Iterable[int]) -> None:
        for body in sorted(bodies):
            if not self._masses.get(self._names.get(body, ""), 0.0):
                continue
            pybullet.changeDynamics(
                body, -1, activationState=pybullet.ACTIVATION_STATE_WAKE_UP, physicsClientId=self._client
            )
