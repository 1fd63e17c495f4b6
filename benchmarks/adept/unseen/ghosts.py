"""Many supposed states of one body, moved by physics at once: copies that meet fixed bodies, and not each other."""

from __future__ import annotations

import weakref
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pybullet
from numpy.typing import NDArray

from dsr.math3d.quaternions import Quaternion, Vector3

Array = NDArray[np.float64]

_GHOST, _FIXED = 2, 1  # collision groups
_FAR = 1e3  # m, between copies that are not in use


class Mechanics(NamedTuple):
    """The laws under which things move."""

    gravity: float = 9.81
    """m/s^2, towards -z"""
    friction: float = 0.5
    """1, Coulomb coefficient of a contact"""
    restitution: float = 0.0
    """1, share of the speed that a collision leaves"""
    step: float = 0.01
    """s, longest time step"""


class States(NamedTuple):
    """States of n copies of a body."""

    position: Array
    """(n, 3) m, of the centre in the world"""
    rotation: Array
    """(n, 4) quaternion (x, y, z, w), world_from_body"""
    velocity: Array
    """(n, 3) m/s"""
    spin: Array
    """(n, 3) rad/s"""


class Ghosts:
    """A physics client with copies of one box above a floor.

    Args:
        size: (3,) m, edge lengths.
        mechanics: how it moves.
    """

    def __init__(self, size: Vector3, mechanics: Mechanics) -> None:
        self._client: int = pybullet.connect(pybullet.DIRECT)
        self._free = weakref.finalize(self, pybullet.disconnect, physicsClientId=self._client)
        self._mechanics = mechanics
        self._size = size
        self._copies: list[int] = []
        self._fixed: dict[str, tuple[Vector3, int]] = {}
        pybullet.setGravity(0.0, 0.0, -mechanics.gravity, physicsClientId=self._client)
        floor = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=self._client)
        self._add(floor, 0.0)

    def close(self) -> None:
        """Free the client; harmless when repeated."""
        self._free()

    def advance(
        self, states: States, seconds: float, fixed: Mapping[str, tuple[Vector3, Vector3, Quaternion]]
    ) -> States:
        """Move copies on by a time (s), past bodies that stand still: size (m), position and rotation by name."""
        self._fix(fixed)
        self._place(states)
        count = max(1, round(seconds / self._mechanics.step))
        pybullet.setPhysicsEngineParameter(fixedTimeStep=seconds / count, physicsClientId=self._client)
        for _ in range(count):
            pybullet.stepSimulation(physicsClientId=self._client)
        used = self._copies[: len(states.position)]
        poses = [pybullet.getBasePositionAndOrientation(body, physicsClientId=self._client) for body in used]
        speeds = [pybullet.getBaseVelocity(body, physicsClientId=self._client) for body in used]
        return States(
            *(np.array([pose[part] for pose in poses]).reshape(len(used), -1) for part in (0, 1)),
            *(np.array([speed[part] for speed in speeds]).reshape(len(used), -1) for part in (0, 1)),
        )

    def _place(self, states: States) -> None:
        """Put as many copies as are needed where they are, and the others far away, at rest."""
        shape = None
        while len(self._copies) < len(states.position):
            shape = shape if shape is not None else self._box(self._size)
            self._copies.append(self._add(shape, 1.0, _GHOST))
        for index, body in enumerate(self._copies):
            if index < len(states.position):
                place, turn, velocity, spin = (part[index].tolist() for part in states)
            else:
                place, turn, velocity, spin = [_FAR * (index + 1), 0.0, _FAR], [0, 0, 0, 1], [0, 0, 0], [0, 0, 0]
            pybullet.resetBasePositionAndOrientation(body, place, turn, physicsClientId=self._client)
            pybullet.resetBaseVelocity(body, velocity, spin, physicsClientId=self._client)

    def _fix(self, fixed: Mapping[str, tuple[Vector3, Vector3, Quaternion]]) -> None:
        for name in [name for name, (size, _) in self._fixed.items() if name not in fixed or fixed[name][0] != size]:
            pybullet.removeBody(self._fixed.pop(name)[1], physicsClientId=self._client)
        for name, (size, position, rotation) in fixed.items():
            if name not in self._fixed:
                self._fixed[name] = (size, self._add(self._box(size), 0.0))
            pybullet.resetBasePositionAndOrientation(
                self._fixed[name][1], position, rotation, physicsClientId=self._client
            )

    def _box(self, size: Sequence[float]) -> int:
        shape: int = pybullet.createCollisionShape(
            pybullet.GEOM_BOX, halfExtents=[0.5 * edge for edge in size], physicsClientId=self._client
        )
        return shape

    def _add(self, shape: int, mass: float, group: int = _FIXED) -> int:
        """Add a body that meets those of the other group only."""
        body: int = pybullet.createMultiBody(mass, shape, physicsClientId=self._client)
        # Bullet multiplies the coefficients of both bodies: the fixed ones have 1.
        friction = self._mechanics.friction if group == _GHOST else 1.0
        restitution = self._mechanics.restitution if group == _GHOST else 1.0
        pybullet.changeDynamics(
            body, -1, lateralFriction=friction, restitution=restitution, linearDamping=0.0, angularDamping=0.0,
            physicsClientId=self._client,
        )  # fmt: skip
        pybullet.setCollisionFilterGroupMask(body, -1, group, _GHOST + _FIXED - group, physicsClientId=self._client)
        return body
