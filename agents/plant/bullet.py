"""A private physics client: the functions of pybullet, bound to a world of its own."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pybullet
from numpy.typing import NDArray

from agents.plant.looks import Looks
from dsr.math3d import quaternions
from dsr.math3d.batches import skew
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.math3d.transforms import Pose
from dsr.runtime.native_output import silenced


class Bullet:
    """A physics world without a window; every function of pybullet is a method that acts on it alone."""

    def __init__(self) -> None:
        self.client: int = pybullet.connect(pybullet.DIRECT)
        self.changes = 0
        """How often a body came or went: the number of one that went is given to another one."""
        self._base_from_inertia: dict[int, Pose] = {}
        self.looks: Looks | None = None
        """What its bodies look like. None unless somebody who wants to know puts it there before the first body."""

    def __getattr__(self, name: str) -> Any:
        bound = partial(getattr(pybullet, name), physicsClientId=self.client)
        setattr(self, name, bound)
        return bound

    def visual_mesh(self, file: Path, **more: Any) -> int:
        """The number of the look that an OBJ file gives to bodies. The file may go when all have got it."""
        if self.looks is not None:
            self.looks.read(str(file))
        number: int = self.createVisualShape(pybullet.GEOM_MESH, fileName=str(file), **more)
        return number

    def create_body(self, *arguments: Any, **more: Any) -> int:
        """As `createMultiBody` of pybullet."""
        return self._noted(self.createMultiBody(*arguments, **more))

    def load_urdf(self, *arguments: Any, **more: Any) -> int:
        """As `loadURDF` of pybullet."""
        return self._noted(self.loadURDF(*arguments, **more))

    def remove_body(self, body: int) -> None:
        """As `removeBody` of pybullet."""
        self.removeBody(body)
        self.changes += 1
        self._base_from_inertia.pop(body, None)
        if self.looks is not None:
            self.looks.remove(body)

    def _noted(self, body: int) -> int:
        self.changes += 1
        if self.looks is not None:
            self.looks.add(body, self.getVisualShapeData(body))
        return body

    def pose(self, body: int) -> Pose:
        """world_from_body, the frame at the body's centre of mass."""
        position, rotation = self.getBasePositionAndOrientation(body)
        return Pose.unchecked(position, quaternions.normalised(rotation))

    def link_pose(self, body: int, link: int) -> Pose:
        """world_from_link as the URDF defines the link's frame."""
        state = self.getLinkState(body, link, computeForwardKinematics=True)
        return Pose(state[4], state[5])

    def links(self, bodies: Iterable[int]) -> dict[tuple[int, int], NDArray[np.float64]]:
        """world_from_link (4, 4) of all links by body and number, in the frames of the description; -1 is the base."""
        keys, poses = [], []
        for body in bodies:
            keys.append((body, -1))
            poses.append(self._base(body))
            if count := self.getNumJoints(body):
                states = self.getLinkStates(body, range(count), computeForwardKinematics=True)
                keys += [(body, link) for link in range(count)]
                poses += [state[4:6] for state in states]
        return dict(zip(keys, _matrices(poses), strict=True))

    def _base(self, body: int) -> tuple[Vector3, Quaternion]:
        """world_from_base; the engine tells where the frame of the body's inertia is."""
        position, rotation = self.getBasePositionAndOrientation(body)
        if body not in self._base_from_inertia:
            self._base_from_inertia[body] = Pose(*self.getDynamicsInfo(body, -1)[3:5])
        base_from_inertia = self._base_from_inertia[body]
        if base_from_inertia == Pose.identity():
            return position, rotation
        base = Pose(position, rotation) @ base_from_inertia.inverse()
        return base.t, base.q

    def set_pose(self, body: int, pose: Pose) -> None:
        """Teleport the body; its velocity stays."""
        self.resetBasePositionAndOrientation(body, pose.t, pose.q)

    def close(self) -> None:
        """End the world; harmless when repeated."""
        if self.client >= 0:
            with silenced():
                pybullet.disconnect(self.client)
            self.client = -1


def _matrices(poses: Sequence[tuple[Vector3, Quaternion]]) -> NDArray[np.float64]:
    """(n, 4, 4) of positions and unit quaternions."""
    result = np.tile(np.eye(4), (len(poses), 1, 1))
    if poses:
        quaternions = np.array([rotation for _, rotation in poses])
        turns, w = skew(quaternions[:, :3]), quaternions[:, 3, None, None]
        result[:, :3, :3] += 2.0 * (w * turns + turns @ turns)
        result[:, :3, 3] = [position for position, _ in poses]
    return result
