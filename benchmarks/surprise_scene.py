"""A table with cubes under a camera, made of numbers: percepts with the measured noise, a belief, a surprise detector.

Everything happens in one memory, without other agents, so that an hour takes a minute.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from agents.drivers import TagReading, TagReadings
from agents.plant.camera import OVERHEAD
from agents.plant.poses import DISTANCES, SIGMA_ROTATION, SIGMA_TRANSLATION
from agents.scene_estimator.pose import NoiseModel
from agents.scene_estimator.sighting import read_sensor
from benchmarks.timing import duration
from dsr.agent import make_agent
from dsr.clock import ManualClock
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.network.keys import Keys
from dsr.network.local_transport import LocalNetwork
from surprise import SurpriseDetector

CAMERA = "camera_overhead"
PERIOD = 0.05
"""s between two ticks of the detector; percepts come at every other one."""
SIX = {f"cube_{k}": ((0.25, 0.36, 0.47)[k % 3], (-0.12, 0.12)[k // 3], 0.0) for k in range(6)}
"""x, y (m) and yaw (rad) of six cubes."""
_EDGE = 0.04
_BELIEF_STD = (0.0005, 0.01)  # m, rad: of a belief that was averaged for seconds
_REFRESH = 1.0  # s between two writings of a belief that rests


class SurpriseScene:
    """What a detector reads, and what it says.

    Args:
        places: x, y (m) and yaw (rad) of each cube on the table.
        seed: of the noise.
        bias: m, least and greatest systematic depth error; each cube has its own, towards the camera.
        jitter: m, standard deviation of the depth error that changes from frame to frame.
        config: of the detector.
    """

    def __init__(
        self,
        places: Mapping[str, tuple[float, float, float]],
        seed: int = 0,
        *,
        bias: tuple[float, float] = (0.005, 0.015),
        jitter: float = 0.003,
        config: Mapping[str, Any] | None = None,
    ) -> None:
        self.rng = np.random.default_rng(seed)
        self.truths = {name: upright(*place) for name, place in places.items()}
        self.beliefs = dict(self.truths)
        self.unsure: dict[str, float] = {}
        """m, standard deviation of the believed places of cubes of which the belief is less sure than of others."""
        self.hidden: set[str] = set()
        """Cubes of which there are no percepts."""
        self.false: dict[str, Pose] = {}
        """world_from_object of percepts that are wrong, for the next frame only."""
        self.clock = ManualClock(1000.0)
        transport = LocalNetwork(self.clock).connect("scene")
        self.memory = Memory("scene", "scene", transport=transport, clock=self.clock)
        self.memory.wait_joined(0.0, all_known=True)
        self._bias = {name: float(self.rng.uniform(*bias)) for name in places}
        self._jitter = jitter
        self._config = config
        self._written: dict[str, tuple[Pose, float, float]] = {}
        self._ticks = 0
        self.detector_seconds = 0.0
        """s that its ticks took"""
        self.exposed = 0.0
        """s, when the last frame was exposed"""
        self.events: list[tuple[float, str, bool, str]] = []
        """Each change of a flag: (s, node, surprising, why)"""
        self._flags: dict[str, bool] = {}
        self._furnish()
        self.start_detector()

    def _furnish(self) -> None:
        self.memory.add_node("world", "world")
        self.memory.add_node(CAMERA, "camera")
        self.memory.add_edge("world", CAMERA, "RT", pose=OVERHEAD)
        for name in self.truths:
            self.memory.add_node(name, "cube", size=(_EDGE,) * 3, marker_id=len(self.memory.nodes("cube")))
            self.memory.add_edge(CAMERA, name, "sees", detectable=1.0, covered_by="")

    def start_detector(self) -> None:
        """Start it, or another one in place of one that was killed."""
        transport, keys = self.memory.transport, Keys("scene")
        agent = make_agent(
            SurpriseDetector,
            name="surprise",
            config=self._config,
            bus=transport,
            keys=keys,
            clock=self.clock,
            memory=self.memory,
        )
        assert isinstance(agent, SurpriseDetector)
        self.detector = agent
        agent.setup()

    def run(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / PERIOD)):
            self.tick()

    def run_until_surprising(self, name: str, at_most: float) -> float | None:
        """Let time pass until the flag of a node is up; how long that took, s, or None if it stayed down."""
        start = self.clock.now()
        while self.clock.now() - start < at_most:
            self.tick()
            if self.is_surprising(name):
                return self.clock.now() - start
        return None

    def tick(self) -> None:
        """One tick of the detector, after a new frame if one is due; the frame was exposed 50 ms before."""
        self.clock.advance(PERIOD)
        self._ticks += 1
        if self._ticks % 2:
            self.exposed = self.clock.now() - PERIOD
            self._expose(self.exposed)
        self._believe()
        self.detector_seconds += duration(partial(self.detector.tick, self.clock.now()))
        self._record()

    def is_surprising(self, name: str) -> bool:
        """What the detector says."""
        return self.memory.node(name).get("surprising") is True

    def why(self, name: str) -> str:
        """Its reason."""
        text: str = self.memory.node(name).get("surprise", "")
        return text

    def _expose(self, stamp: float) -> None:
        """Percepts of a frame, with the errors and the covariance of the tag sensor and the scene estimator."""
        for name, truth in self.truths.items():
            noise, jitter = self.rng.standard_normal(6), self.rng.normal(0.0, self._jitter)
            if name in self.hidden:
                continue
            camera_from_object = OVERHEAD.inverse() @ self.false.pop(name, truth)
            distance = math.hypot(*camera_from_object.t)
            nearer = camera_from_object.translation * (1.0 - (self._bias[name] + jitter) / distance)
            sigma_translation = float(np.interp(distance, DISTANCES, SIGMA_TRANSLATION))
            sigma_rotation = float(np.interp(distance, DISTANCES, SIGMA_ROTATION))
            shaken = Pose.from_rotvec(noise[:3] * sigma_translation, noise[3:] * sigma_rotation)
            pose = Pose(nearer, camera_from_object.q) @ shaken
            reading = TagReading(0, (*pose.t, *pose.q), sigma_translation, sigma_rotation)
            sighting = read_sensor(TagReadings(stamp, [reading]), NoiseModel())[0]
            self.memory.add_edge(CAMERA, name, "RT", pose=sighting.pose)

    def _believe(self) -> None:
        now, (usual, radians) = self.clock.now(), _BELIEF_STD
        for name, belief in self.beliefs.items():
            metres = self.unsure.get(name, usual)
            pose, std, written = self._written.get(name, (None, metres, -math.inf))
            if pose is not belief or std != metres or now - written >= _REFRESH:
                covariance = np.diag([metres**2] * 3 + [radians**2] * 3)
                self.memory.add_edge("world", name, "Virtual_RT", pose=Pose(belief.t, belief.q, now, covariance))
                self._written[name] = (belief, metres, now)

    def _record(self) -> None:
        for name in (*self.truths, CAMERA, *(hand.name for hand in self.memory.nodes("hand"))):
            flag = self.is_surprising(name)
            if flag != self._flags.get(name, False):
                self._flags[name] = flag
                self.events.append((self.clock.now(), name, flag, self.why(name)))


def upright(x: float, y: float, yaw: float) -> Pose:
    """world_from_cube of a cube that stands on the table."""
    return Pose.from_rotvec((x, y, 0.5 * _EDGE), (0.0, 0.0, yaw))


def moved(pose: Pose, metres: float, direction: float, turn: float = 0.0) -> Pose:
    """The pose moved over the table in a direction (rad from world x) and turned about the vertical (rad)."""
    x, y, z = pose.t
    position = (x + metres * math.cos(direction), y + metres * math.sin(direction), z)
    return Pose(position, (Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, turn)) @ Pose((0.0, 0.0, 0.0), pose.q)).q)
