"""A simulated colour and depth camera: its pose, its images, and the bumps that it gets."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from agents.plant.lens import through_lens
from agents.plant.noise import Color, Depth, SensorModel, shift_bodies
from agents.plant.renderer import RenderedPicture, Renderer
from agents.plant.world import World
from dsr.images.blobs import Frame
from dsr.math3d.quaternions import Quaternion, Vector3, product
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics

OVERHEAD = Pose((0.35, 0.0, 0.65), (math.sqrt(0.5), -math.sqrt(0.5), 0.0, 0.0))
"""world_from_camera of the overhead camera's optical frame: looking straight down, the image's right is world -y and
its upper side world +x. At 640 x 480 and the default field of view it covers x 0.09 to 0.61, y -0.35 to 0.35 m."""


Exposure = Callable[[], Frame]
"""Makes a frame as a driver delivers it of what the lens let in: `color`, `depth` and the intrinsics."""


@dataclass
class Illusion:
    """An object that is seen elsewhere than it is."""

    frames: int
    """Number of further frames that show the object displaced."""
    translation: Vector3
    """Displacement of the percept in the world, m."""
    turn: Quaternion
    """World, about the object's centre."""

    def applied_to(self, pose: Pose) -> Pose:
        """world_from_object as it is seen."""
        x, y, z = (true + shift for true, shift in zip(pose.t, self.translation, strict=True))
        return Pose((x, y, z), product(self.turn, pose.q))


class SimulatedCamera:
    """A camera on a mount that may move.

    Args:
        name: as in the scenario, `overhead` or `wrist`.
        intrinsics: image size and intrinsics.
        mount: gives world_from_camera when nothing bumped it.
        sensor: its errors.
    """

    def __init__(self, name: str, intrinsics: Intrinsics, mount: Callable[[], Pose], sensor: SensorModel) -> None:
        self.name = name
        self.intrinsics = intrinsics
        self.sensor = sensor
        self.covers = 0
        """How many things cover the lens; with any, images are black and depths unknown."""
        self.in_view: list[str] = []
        """Objects whose tag, or enough of whose colour, could be seen in the last frame."""
        self.illusions: dict[str, Illusion] = {}
        """Objects that the next frames show elsewhere."""
        self._mount = mount
        self._displacement = Pose.identity()

    @property
    def pose(self) -> Pose:
        """world_from_camera, the optical frame (z forward, x right, y down)."""
        return self._mount() @ self._displacement

    def bump(self, displacement: Pose) -> None:
        """Move the camera by `displacement`, given in its own optical frame; the believed mount does not change."""
        self._displacement = self._displacement @ displacement

    def seen_poses(self, world: World) -> dict[str, Pose]:
        """world_from_object as one frame shows them, of all objects in the scene."""
        poses = world.poses()
        for name, illusion in list(self.illusions.items()):
            if name in poses:
                poses[name] = illusion.applied_to(poses[name])
            illusion.frames -= 1
            if illusion.frames <= 0:
                del self.illusions[name]
        return poses

    def expose(self, world: World, renderer: Renderer, stamp: float) -> Exposure:
        """Draw what is before the lens now. The frame is made of that by whoever calls the result, once."""
        meta = self.intrinsics.meta()
        if self.covers:
            shape = (self.intrinsics.height, self.intrinsics.width)
            color, depth = np.zeros((*shape, 3), np.uint8), np.zeros(shape, np.float32)
            return lambda: Frame(stamp, {"color": color, "depth": depth}, meta)
        with world.shown_at(self.seen_poses(world)):
            errors = {world.body(name): error for name, error in self.sensor.errors().items() if name in world}
            lens, bodies = self.intrinsics.pinhole(), self.sensor.is_per_object
            ideal = renderer.render(self.pose, lens, bodies=bodies, camera=self.name)

        def develop() -> Frame:
            color, depth = self._develop(ideal, errors)
            return Frame(stamp, {"color": color, "depth": depth}, meta)

        return develop

    def _develop(self, ideal: RenderedPicture, errors: dict[int, float]) -> tuple[Color, Depth]:
        """Colour and depth with all errors; those of bodies are in m."""
        picture = through_lens(ideal, self.intrinsics)
        depth = picture.depth
        if picture.bodies is not None:
            depth = shift_bodies(depth, picture.bodies, errors, self.intrinsics)
        return self.sensor.color(picture.color), self.sensor.depth(depth, self.intrinsics)
