"""Cubes before a camera, as sightings and as a graph: what the tests of the calibrator share."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.calibrator import Calibrator
from agents.calibrator.solve.problem import ObjectSighting
from agents.recorder.agent import Recorder
from dsr.math3d.transforms import Pose
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec

DOWN = Pose((0.35, 0.0, 0.65), (math.sqrt(0.5), -math.sqrt(0.5), 0.0, 0.0))
"""world_from_camera, looking straight down"""
BUMP = Pose.from_rotvec((0.03, -0.02, 0.01), (0.05, -0.08, 0.1))
WIDE = ((-0.1, -0.12), (0.11, -0.1), (0.1, 0.12), (-0.12, 0.1))
"""m, places of four cubes on the table"""
CLUSTER = ((-0.021, -0.021), (0.021, -0.021), (0.021, 0.021), (-0.021, 0.021))
SIGMAS = np.array([0.8e-3] * 3 + [4e-3] * 3)  # m, rad
FLIP = Pose.from_rotvec((0.0, 0.0, 0.0), (0.6, 0.2, 0.0))


def cubes(places: Sequence[tuple[float, float]] = WIDE) -> dict[str, Pose]:
    """world_from_cube by name."""
    return {
        f"cube_{number}": Pose.from_rotvec((0.35 + x, y, 0.02), (0.0, 0.0, 0.7 * number))
        for number, (x, y) in enumerate(places, start=1)
    }


def sightings(
    objects: Mapping[str, Pose],
    camera: Pose = DOWN,
    *,
    rng: np.random.Generator | None = None,
    bare: Sequence[str] = (),
    wrong: Mapping[str, Pose] | None = None,
    parents: Sequence[Pose] = (Pose.identity(),),
) -> list[ObjectSighting]:
    """What a camera at `camera` in its parent sees of objects that are believed where they are.

    With `rng` percepts are noisy; those of `bare` objects tell no rotation; `wrong` moves some of what is seen;
    `parents` are world_from_parent, by view.
    """
    found = []
    for view, parent in enumerate(parents):
        for name, world_from_object in objects.items():
            exact = (parent @ camera).inverse() @ world_from_object @ (wrong or {}).get(name, Pose.identity())
            error = np.zeros(6) if rng is None else rng.normal(size=6) * SIGMAS
            sigmas = np.where(np.arange(6) < 3, SIGMAS, np.pi) if name in bare else SIGMAS
            seen = (exact @ Pose.from_rotvec(error[:3], error[3:])).with_covariance(np.diag(sigmas**2))
            found.append(ObjectSighting(name, view, seen, parent.inverse() @ world_from_object))
    return found


class Stage:
    """A graph with a camera that is not where the graph says, in which a calibrator runs.

    Args:
        parent: what carries the camera; other than `world`, it moves and its pose has a stamp.
        objects: world_from_object, by name.
        recording: folder that gets a recording.
        config: of the calibrator.
    """

    def __init__(
        self,
        parent: str = "world",
        objects: Mapping[str, Pose] | None = None,
        recording: Path | None = None,
        **config: Any,
    ) -> None:
        agents = [AgentSpec("calibrator", Calibrator, config)]
        if recording is not None:
            agents.append(AgentSpec("recorder", Recorder, {"folder": str(recording)}))
        self.lockstep = Lockstep(agents, strict=True)
        self.memory = self.lockstep.memory
        self.parent = parent
        self.world_from_parent = Pose.identity()
        self.parent_from_camera = DOWN
        self.objects = dict(cubes() if objects is None else objects)
        self.seen_off: dict[str, Pose] = {}
        self._rng = np.random.default_rng(0)
        self.memory.add_node("world", "world")
        if parent != "world":
            self.memory.add_node(parent, "gripper")
        self.memory.add_node("camera", "camera")
        self.memory.add_edge(parent, "camera", "RT", pose=DOWN @ BUMP)
        for name, pose in self.objects.items():
            self.memory.add_node(name, "cube", size=(0.04, 0.04, 0.04))
            self.memory.add_edge("world", name, "Virtual_RT", pose=pose)

    def look(self, seconds: float = 1.5) -> None:
        """Let time pass in which the camera sees all objects ten times a second."""
        for _ in range(round(seconds * 10)):
            stamp = self.lockstep.clock.now()
            if self.parent != "world":
                self.memory.add_edge("world", self.parent, "RT", pose=self.world_from_parent.with_stamp(stamp))
            camera_from_world = (self.world_from_parent @ self.parent_from_camera).inverse()
            for name, pose in self.objects.items():
                error = self._rng.normal(size=6) * SIGMAS
                seen = camera_from_world @ pose @ self.seen_off.get(name, Pose.identity())
                percept = seen @ Pose.from_rotvec(error[:3], error[3:])
                covariance = np.diag(SIGMAS**2)
                self.memory.add_edge(
                    "camera", name, "RT", pose=percept.with_covariance(covariance).with_stamp(stamp)
                )  # fmt: skip
            self.lockstep.run_for(0.1)

    def wait(self, seconds: float) -> None:
        """Let time pass in which the camera sees nothing."""
        self.lockstep.run_for(seconds)

    @property
    def misplaced(self) -> float:
        """m, at most, between where the camera shows the objects in the graph and the truth."""
        written: Pose = self.memory.edge(self.parent, "camera", "RT")["pose"]
        shown = self.world_from_parent @ written @ (self.world_from_parent @ self.parent_from_camera).inverse()
        return max((shown @ pose).distance(pose)[0] for pose in self.objects.values())

    @property
    def error(self) -> tuple[float, float]:
        """m, rad between the camera's pose in the graph and the truth."""
        written: Pose = self.memory.edge(self.parent, "camera", "RT")["pose"]
        return written.distance(self.parent_from_camera)
