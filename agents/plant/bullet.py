"""A private physics client: the functions of pybullet, bound to a world of its own."""

from __future__ import annotations

from functools import partial
from typing import Any

import pybullet

from dsr.math3d.transforms import Pose
from dsr.runtime.native_output import silenced


class Bullet:
    """A physics world without a window; every function of pybullet is a method that acts on it alone."""

    def __init__(self) -> None:
        self.client: int = pybullet.connect(pybullet.DIRECT)
        # else the library keeps meshes and textures of all worlds for good, by file names that none uses again
        self.setPhysicsEngineParameter(enableFileCaching=0)

    def __getattr__(self, name: str) -> Any:
        bound = partial(getattr(pybullet, name), physicsClientId=self.client)
        setattr(self, name, bound)
        return bound

    def pose(self, body: int) -> Pose:
        """world_from_body, the frame at the body's centre of mass."""
        position, rotation = self.getBasePositionAndOrientation(body)
        return Pose(position, rotation)

    def link_pose(self, body: int, link: int) -> Pose:
        """world_from_link as the URDF defines the link's frame."""
        state = self.getLinkState(body, link, computeForwardKinematics=True)
        return Pose(state[4], state[5])

    def set_pose(self, body: int, pose: Pose) -> None:
        """Teleport the body; its velocity stays."""
        self.resetBasePositionAndOrientation(body, pose.t, pose.q)

    def close(self) -> None:
        """End the world; harmless when repeated."""
        if self.client >= 0:
            with silenced():
                pybullet.disconnect(self.client)
            self.client = -1
