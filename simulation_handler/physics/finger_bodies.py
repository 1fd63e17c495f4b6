"""Fingertips in a simulation: small spheres that constraints pull along; part of the simulator, as `Simulator.fingers`.

They are no bodies of the simulator: none of its methods knows them, nothing rests on them, and a scene that is frozen
has none.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import pybullet

from dsr.math3d.quaternions import Vector3

_FORCE = 5.0  # N, with which a finger is pulled to its place at most
_MASS = 0.01  # kg
_FRICTION = 1.0  # 1, Coulomb coefficient of a fingertip
_PARKED: Vector3 = (0.0, 0.0, -1000.0)  # m, where spheres are that nobody needs
_UPRIGHT = (0.0, 0.0, 0.0, 1.0)
_STILL: Vector3 = (0.0, 0.0, 0.0)


@dataclass
class _Finger:
    """A sphere and where it is pulled to."""

    body: int
    constraint: int
    place: Vector3
    """m"""
    stride: Vector3 = _STILL
    """m that its place moves in each of the next steps"""
    strides: int = 0
    """How many of those are left"""
    met: set[str] = field(default_factory=set)
    """Bodies that it does not go through"""


class FingerBodies:
    """Dynamic spheres on fixed constraints in the world, by name.

    Args:
        client: of pybullet.
        ids: pybullet's numbers of the simulator's bodies, by name; the simulator keeps this up to date.
        radius: m, of the spheres.
    """

    def __init__(self, client: int, ids: Mapping[str, int], radius: float) -> None:
        self.radius = radius
        self._client = client
        self._ids = ids
        self._fingers: dict[str, _Finger] = {}
        self._parked: list[int] = []  # not removed: pybullet gives the number, and with it the filters, to other bodies

    def __contains__(self, name: str) -> bool:
        return name in self._fingers

    @property
    def bodies(self) -> list[int]:
        """Numbers of the spheres in use, as pybullet has them."""
        return [finger.body for finger in self._fingers.values()]

    def position(self, name: str) -> Vector3:
        """(3,) of a sphere's centre, m."""
        body = self._fingers[name].body
        position: Vector3 = pybullet.getBasePositionAndOrientation(body, physicsClientId=self._client)[0]
        return position

    def add(self, name: str, position: Vector3) -> None:
        """Add a finger at `position` (3,) m; it goes through everything until `meet` names bodies."""
        body = self._parked.pop() if self._parked else self._make()
        pybullet.changeDynamics(body, -1, mass=_MASS, physicsClientId=self._client)
        self._put(body, position)
        constraint = pybullet.createConstraint(
            body, -1, -1, -1, pybullet.JOINT_FIXED, _STILL, _STILL, position, physicsClientId=self._client
        )
        self._fingers[name] = finger = _Finger(body, constraint, position)
        self._pull(finger)

    def remove(self, name: str) -> None:
        """Take one out; harmless if there is none."""
        finger = self._fingers.pop(name, None)
        if finger is None:
            return
        self._filter(finger, set())
        pybullet.removeConstraint(finger.constraint, physicsClientId=self._client)
        pybullet.changeDynamics(finger.body, -1, mass=0.0, physicsClientId=self._client)
        self._put(finger.body, _PARKED)
        self._parked.append(finger.body)

    def meet(self, name: str, bodies: Collection[str]) -> None:
        """Let a finger push these bodies from now on, and go through all others."""
        self._filter(self._fingers[name], set(bodies))

    def move(self, name: str, position: Vector3, count: int) -> None:
        """Pull a finger evenly to `position` (3,) m over the next `count` steps."""
        finger = self._fingers[name]
        x, y, z = ((there - here) / count for here, there in zip(finger.place, position, strict=True))
        finger.stride, finger.strides = (x, y, z), count

    def advance(self) -> None:
        """Move the anchors of all fingers; call this before each step of physics."""
        for finger in self._fingers.values():
            if finger.strides:
                x, y, z = (here + stride for here, stride in zip(finger.place, finger.stride, strict=True))
                finger.place, finger.strides = (x, y, z), finger.strides - 1
                self._pull(finger)

    def forget(self, body: str) -> None:
        """Forget a body; call this before it is removed from the simulator."""
        for finger in self._fingers.values():
            self._filter(finger, finger.met - {body})

    def _make(self) -> int:
        """A sphere that by itself meets nothing."""
        shape = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=self.radius, physicsClientId=self._client)
        body: int = pybullet.createMultiBody(_MASS, shape, basePosition=_PARKED, physicsClientId=self._client)
        pybullet.changeDynamics(
            body, -1, lateralFriction=_FRICTION, restitution=0.0,
            activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING, physicsClientId=self._client,
        )  # fmt: skip
        pybullet.setCollisionFilterGroupMask(body, -1, 0, 0, physicsClientId=self._client)
        return body

    def _put(self, body: int, position: Vector3) -> None:
        pybullet.resetBasePositionAndOrientation(body, position, _UPRIGHT, physicsClientId=self._client)
        pybullet.resetBaseVelocity(body, _STILL, _STILL, physicsClientId=self._client)

    def _pull(self, finger: _Finger) -> None:
        pybullet.changeConstraint(
            finger.constraint, jointChildPivot=finger.place, maxForce=_FORCE, physicsClientId=self._client
        )

    def _filter(self, finger: _Finger, met: set[str]) -> None:
        """Tell pybullet what changes in what a finger meets."""
        for name in sorted(met ^ finger.met):
            pybullet.setCollisionFilterPair(
                finger.body, self._ids[name], -1, -1, int(name in met), physicsClientId=self._client
            )
        finger.met = met
