"""Ray-traced frames of single tags, and a scene estimator in lockstep with whoever owns the cameras."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from agents.drivers import TagReadings
from agents.scene_estimator import SceneEstimator
from agents.scene_estimator.sighting import FrameSource
from benchmarks.tag_camera import Camera, facing
from dsr import Frame, LocalNetwork, ManualClock, Memory, Pose
from dsr.agent import make_agent
from dsr.graph.access import WriteGuard
from dsr.network.keys import Keys
from dsr.runtime.runner import Runner

from .block_scene import BlockScene, table_memory

PERIOD = 0.05
AGE = 0.7
SENSORS = {"camera_overhead": {"driver": "fake:Sensor"}}
SIZE = 0.04
STEEPEST = np.radians(50)
SMALL = Camera(width=320, height=240, focal=310.0)
OVERHEAD = Pose((0.0, 0.0, 0.4), (1.0, 0.0, 0.0, 0.0))
"""world_from_camera, looking straight down."""
MARKER = 5


class Trial:
    """One frame of a cube that carries `MARKER`."""

    def __init__(self, camera: Camera, pose: Pose, rng: np.random.Generator, bias: float = 0.0) -> None:
        self.pose = pose
        """camera_from_cube"""
        self.frame = camera.frame({MARKER: pose}, rng, bias=bias)

    def estimate(self, reader: FrameSource, *, depth: bool = True) -> Pose:
        """What is seen, with or without the depth image."""
        arrays = {name: array for name, array in self.frame.arrays.items() if depth or name != "depth"}
        (sighting,) = reader.read(msgspec.structs.replace(self.frame, arrays=arrays))[0]
        return sighting.pose


def trials(camera: Camera, distance: float, count: int, seed: int, bias_std: float = 0.0) -> list[Trial]:
    rng = np.random.default_rng(seed)
    poses = [facing(distance, rng.uniform(0.0, STEEPEST), rng) for _ in range(count)]
    return [Trial(camera, pose, rng, rng.normal(0.0, bias_std)) for pose in poses]


def nees(estimate: Pose, truth: Pose) -> float:
    """Squared error over its covariance: 6 on average if that is right."""
    between = estimate.inverse() @ truth
    error = np.concatenate([between.translation, between.rotvec])
    return float(error @ np.linalg.solve(covariance(estimate), error))


def covariance(pose: Pose) -> NDArray[np.float64]:
    assert pose.covariance is not None
    return pose.covariance


class Bench:
    """One scene estimator, and the memory of another agent that owns the cameras and shows it frames."""

    def __init__(self, config: dict[str, Any]) -> None:
        self.clock = ManualClock()
        self.network = LocalNetwork(self.clock)
        self.config = config
        self.rng = np.random.default_rng(0)
        self.memory = self.connect("arm_controller")
        self.memory.add_node("world", "world")
        self.add_camera("camera_overhead", OVERHEAD)
        self.start()

    def connect(self, agent: str) -> Memory:
        guard = WriteGuard(agent, SceneEstimator.writes) if agent == "scene_estimator" else None
        return Memory("test", agent, transport=self.network.connect(agent), clock=self.clock, guard=guard)

    def add_camera(self, name: str, world_from_camera: Pose) -> None:
        self.memory.add_node(name, "camera")
        self.memory.add_edge("world", name, "RT", pose=world_from_camera)

    def start(self) -> None:
        """Start the estimator, or another one in its place."""
        self.own = self.connect("scene_estimator")
        self.exchange(0.0)
        agent = make_agent(
            SceneEstimator,
            name="scene_estimator",
            config=self.config,
            bus=self.own.transport,
            keys=Keys("test"),
            clock=self.clock,
            memory=self.own,
        )
        assert isinstance(agent, SceneEstimator)
        self.agent = agent
        self.runner = Runner(agent, rid=self.own.rid)
        self.runner.setup()
        self.exchange(0.0)

    def stop(self) -> None:
        self.runner.teardown()
        self.own.close()

    def picture(self, *cubes: tuple[int, float, float]) -> Frame:
        """What a camera sees, looking down at cubes (marker id, x, y) whose tops are 0.38 m below it."""
        poses = {marker: Pose((x, y, 0.4), (1.0, 0.0, 0.0, 0.0)) for marker, x, y in cubes}
        return SMALL.frame(poses, self.rng)

    def show(self, picture: Frame, *cameras: str, ticks: int = 1) -> None:
        """Let each of the cameras send the picture, tick after tick."""
        for _ in range(ticks):
            for camera in cameras or ("camera_overhead",):
                self.memory.put_frame(camera, msgspec.structs.replace(picture, stamp=self.clock.now()))
            self.run(PERIOD)

    def run(self, seconds: float) -> None:
        """Let time pass; no tick may fail."""
        for _ in range(round(seconds / PERIOD)):
            self.exchange(0.0)
            self.runner.tick(self.clock.now())
            assert self.runner.status().last_error == ""
            self.exchange(PERIOD)

    def exchange(self, seconds: float) -> None:
        self.clock.advance(seconds)
        for _ in range(3):
            for memory in (self.memory, self.own):
                memory.flush()
            self.network.deliver()
            for memory in (self.memory, self.own):
                memory.poll()

    def perceived(self, name: str) -> bool | None:
        """As others see it; None without the node."""
        node = self.memory.get_node(name)
        return None if node is None else node.get("perceived") is True


class FakeSensor:
    """Returns the readings it was given, once."""

    def __init__(self) -> None:
        self.next: TagReadings | None = None
        self.closed = False

    def readings(self) -> TagReadings | None:
        readings, self.next = self.next, None
        return readings

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def sensor(monkeypatch: pytest.MonkeyPatch) -> Iterator[FakeSensor]:
    sensor = FakeSensor()
    monkeypatch.setattr("agents.scene_estimator.agent.make_driver", lambda *_, **__: sensor)
    yield sensor


@pytest.fixture
def make_bench() -> Iterator[Callable[..., Bench]]:
    benches: list[Bench] = []

    def make(**config: Any) -> Bench:
        benches.append(Bench(config))
        return benches[-1]

    yield make
    for bench in benches:
        bench.stop()
        bench.memory.close()


@pytest.fixture
def bench(make_bench: Callable[..., Bench]) -> Bench:
    return make_bench()


@pytest.fixture(scope="module")
def rendered_blocks(request: pytest.FixtureRequest) -> Iterator[BlockScene]:
    """The blocks `SPECS` of a module of tests, rendered by one camera for all of them."""
    with closing(BlockScene(request.module.SPECS)) as scene:
        yield scene


@pytest.fixture
def scene(rendered_blocks: BlockScene) -> BlockScene:
    """An empty table, and the blocks that a test may stand on it; the camera has the same noise whatever ran before."""
    rendered_blocks.begin(noise=0)
    return rendered_blocks


@pytest.fixture
def memory() -> Iterator[Memory]:
    """A memory with a table, without agents."""
    with closing(table_memory()) as memory:
        yield memory


@pytest.fixture
def camera() -> Camera:
    return Camera()


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)
