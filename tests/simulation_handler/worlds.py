"""Synthetic worlds: true poses, an overhead camera with the noise that the belief has to overcome, a belief."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Part, Shape
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics
from simulation_handler.belief import Belief
from simulation_handler.config import BeliefConfig
from simulation_handler.perception.percepts import SeenObject
from simulation_handler.perception.visibility import CameraView, RayVisibility
from simulation_handler.shapes.geometry import Solid

CAMERA = (0.35, 0.0, 0.65)
CUBE = (0.04, 0.04, 0.04)
TABLE = (1.2, 1.2, 0.04)
PERIOD = 0.05
WALL = 0.003
BALL = (0.06, 0.06, 0.06)
ROUND: Shape = (Part("sphere", BALL),)


def container(size: Vector3, wall: float = WALL, *, upside_down: bool = False) -> Shape:
    """A box without a lid, or, upside down, without a bottom."""
    x, y, z = (0.5 * (edge - wall) for edge in size)
    return (
        Part("box", (size[0], size[1], wall), (0.0, 0.0, z if upside_down else -z)),
        *(Part("box", (wall, size[1], size[2]), (side * x, 0.0, 0.0)) for side in (-1, 1)),
        *(Part("box", (size[0], wall, size[2]), (0.0, side * y, 0.0)) for side in (-1, 1)),
    )


def beaker(size: Vector3, wall: float = WALL, walls: int = 12) -> Shape:
    """A round bottom and a ring of walls, open on top."""
    inner, angles = 0.5 * (size[0] - wall), [2.0 * math.pi * k / walls for k in range(walls)]
    width = size[0] * math.tan(math.pi / walls)
    return (
        Part("cylinder", (size[0], size[0], wall), (0.0, 0.0, 0.5 * (wall - size[2]))),
        *(
            Part("box", (wall, width, size[2] - wall), (inner * math.cos(a), inner * math.sin(a), 0.5 * wall),
                 quaternions.from_rotvec((0.0, 0.0, a)))
            for a in angles
        ),
    )  # fmt: skip


class SyntheticCamera:
    """Percepts of true poses: a constant depth bias per object along the viewing ray, noise, now and then a tilt."""

    depth_noise = 0.003
    lateral_noise = 0.001
    yaw_noise = np.deg2rad(1.0)
    tilt_noise = np.deg2rad(1.0)
    tilt_outlier = np.deg2rad(12.0)
    tilt_outliers = 0.03

    def __init__(self, seed: int = 0, bias: tuple[float, float] = (0.005, 0.015)) -> None:
        self.rng = np.random.default_rng(seed)
        self.bias_range = bias
        self.bias: dict[str, float] = {}

    def percept(self, name: str, truth: Pose, stamp: float) -> Pose:
        """world_from_object as it is perceived, with the covariance of the noise (without the bias)."""
        bias = self.bias.setdefault(name, self.rng.uniform(*self.bias_range))
        position = np.array(truth.t)
        ray = (position - CAMERA) / np.linalg.norm(position - CAMERA)
        noise = self.lateral_noise * self.rng.normal(size=3)
        noise += (self.depth_noise * self.rng.normal() - noise @ ray - bias / -ray[2]) * ray
        tilts = self.tilt_noise * self.rng.normal(size=2)
        if self.rng.random() < self.tilt_outliers:
            tilts = tilts + self.tilt_outlier
        turn = Pose.from_rotvec((0, 0, 0), (tilts[0], tilts[1], self.yaw_noise * self.rng.normal()))
        rotation = (Pose((0, 0, 0), truth.q) @ turn).q
        turned = np.array(Pose((0, 0, 0), rotation).rotation_matrix).T @ ray
        covariance = np.zeros((6, 6))
        covariance[:3, :3] = self.lateral_noise**2 * np.eye(3)
        covariance[:3, :3] += (self.depth_noise**2 - self.lateral_noise**2) * np.outer(turned, turned)
        covariance[3:, 3:] = np.diag([self.tilt_noise**2, self.tilt_noise**2, self.yaw_noise**2])
        return Pose(position + noise, rotation, stamp, covariance)


VIEW = CameraView("camera", Pose(CAMERA, (1.0, 0.0, 0.0, 0.0)), Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480))


class World:
    """True poses, a camera at 10 Hz and a belief at 20 Hz, to which everything is flagged as surprising at once.

    With `rays`, the belief knows the camera, so that it can tell what it should see; and the camera sees of the
    `seen` objects only those that nothing hides.
    """

    def __init__(
        self, truths: dict[str, Pose], seed: int = 0, *, rays: bool = False, policy: Any = "hypotheses"
    ) -> None:
        self.truths = dict(truths)
        self.seen = set(truths)
        self.by: dict[str, str] = {}  # name of the camera by which an object is seen, if that is another one
        self.camera = SyntheticCamera(seed)
        self.belief = Belief(BeliefConfig(policy=policy))
        self.rays = RayVisibility([VIEW]) if rays else None
        self.belief.set_fixture("table", TABLE, Pose((0.35, 0.0, -0.02)))
        self.percepts: dict[str, Pose] = {}
        self.now, self.ticks = 1000.0, 0
        for name in truths:
            self.belief.add_object(name, CUBE, mass=0.05)

    def run(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / PERIOD)):
            self.tick()

    def tick(self) -> None:
        """One step of the belief, with new percepts at every other one."""
        self.now += PERIOD
        self.ticks += 1
        if self.ticks % 2:
            for name in sorted(self.seen & self._in_view()):
                self.see(name, self.camera.percept(name, self.truths[name], self.now))
        self.belief.flag(self.belief.names)
        self.belief.set_visibility(None if self.rays is None else self.rays.look_for)
        self.belief.step(self.now)

    def _in_view(self) -> set[str]:
        if self.rays is None:
            return set(self.truths)
        solids = [Solid(name, CUBE, pose.t, pose.q) for name, pose in self.truths.items()]
        return {name for (_, name), share in self.rays.shares(solids).items() if share > 0.9}

    def see(self, name: str, percept: Pose) -> None:
        """Let the belief perceive an object."""
        self.percepts[name] = percept
        self.belief.observe([SeenObject(name, percept, percept.stamp, CAMERA, self.by.get(name, VIEW.camera))])

    def pose(self, name: str) -> Pose:
        """Where an object is believed to be."""
        pose = self.belief.pose(name)
        assert pose is not None
        return pose

    def error(self, name: str) -> float:
        """Distance of the belief from the truth, m."""
        return self.pose(name).distance(self.truths[name])[0]

    def percept_error(self, name: str) -> float:
        """Distance of the newest percept from the truth, m."""
        return self.percepts[name].distance(self.truths[name])[0]


def cube_at(x: float, y: float, z: float = 0.02, yaw: float = 0.0) -> Pose:
    """Pose of a cube that lies flat."""
    return Pose.from_rotvec((x, y, z), (0.0, 0.0, yaw))
