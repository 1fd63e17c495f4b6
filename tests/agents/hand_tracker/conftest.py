"""A hand tracker in lockstep with whoever owns the cameras, frames that the plant renders, and recorded landmarks."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from agents.drivers import HandReading, HandReadings
from agents.hand_tracker import HandTracker
from agents.hand_tracker.model.fetch import from_index
from agents.hand_tracker.model.files import fetched_file, read_fetched, write_model
from agents.hand_tracker.model.found import FoundHand
from agents.hand_tracker.sighting import PALM, TIPS
from agents.plant.camera import OVERHEAD
from agents.plant.config import PlantConfig
from agents.plant.messages import hands_key
from agents.plant.reality import Reality
from agents.plant.world import RATE_HZ, STEP
from agents.scenario.format.scenario import Scenario
from dsr import Frame, LocalNetwork, ManualClock, Memory, Pose
from dsr.agent import make_agent
from dsr.errors import ConfigError
from dsr.graph.access import WriteGuard
from dsr.network.keys import Keys
from dsr.network.transport import Qos
from dsr.runtime.runner import Runner

PERIOD = 0.05
SENSORS = {"camera_overhead": {"driver": "agents.plant.driver:PlantHands"}}
RECORDED = json.loads((Path(__file__).parent / "landmarks.json").read_text())
"""Results of a landmarker, made with noise from true joints, which are there too."""
FLAT_HAND = np.array(RECORDED["frames"][0]["hands"][0]["truth_m"])
"""(21, 3) joints of an open right hand in the camera's frame, m."""
Array = NDArray[np.float64]


class Bench:
    """One hand tracker, and the memory of another agent that owns the camera and shows it hands."""

    def __init__(self, config: dict[str, Any]) -> None:
        self.clock = ManualClock()
        self.clock.advance(100.0)
        self.network = LocalNetwork(self.clock)
        self.config = config
        self.memory = self.connect("others")
        self.memory.add_node("world", "world")
        self.memory.add_node("camera_overhead", "camera")
        self.memory.add_edge("world", "camera_overhead", "RT", pose=OVERHEAD)
        self.start()

    def connect(self, agent: str) -> Memory:
        guard = WriteGuard(agent, HandTracker.writes) if agent == "hand_tracker" else None
        return Memory("test", agent, transport=self.network.connect(agent), clock=self.clock, guard=guard)

    def start(self) -> None:
        """Start the tracker, or another one in its place."""
        self.own = self.connect("hand_tracker")
        self.exchange(0.0)
        agent = make_agent(
            HandTracker,
            name="hand_tracker",
            config=self.config,
            bus=self.own.transport,
            keys=Keys("test"),
            clock=self.clock,
            memory=self.own,
        )
        assert isinstance(agent, HandTracker)
        self.agent = agent
        self.runner = Runner(agent, rid=self.own.rid)
        self.runner.setup()
        self.exchange(0.0)

    def stop(self) -> None:
        self.runner.teardown()
        self.own.close()

    def tell(self, *hands: HandReading, ticks: int = 1) -> None:
        """Let the camera's sensor tell of hands, tick after tick."""
        for _ in range(ticks):
            readings = HandReadings(self.clock.now(), list(hands))
            key = hands_key(Keys("test"), "overhead")
            self.memory.transport.publish(key, msgspec.msgpack.encode(readings), Qos.STREAM)
            self.run(PERIOD)

    def show(self, frame: Frame, ticks: int = 1) -> None:
        """Let the camera send a picture, tick after tick."""
        for _ in range(ticks):
            self.memory.put_frame("camera_overhead", msgspec.structs.replace(frame, stamp=self.clock.now()))
            self.run(PERIOD)

    def run(self, seconds: float) -> None:
        """Let time pass; no tick may fail."""
        for _ in range(round(seconds / PERIOD)):
            self.exchange(0.0)
            self.runner.tick(self.clock.now())
            assert self.runner.status().last_error in ("", self.agent.degraded)
            self.exchange(PERIOD)

    def exchange(self, seconds: float) -> None:
        self.clock.advance(seconds)
        for _ in range(3):
            for memory in (self.memory, self.own):
                memory.flush()
            self.network.deliver()
            for memory in (self.memory, self.own):
                memory.poll()

    def hands(self) -> list[str]:
        """Names of those that are perceived, as others see it."""
        return sorted(node.name for node in self.memory.nodes("hand") if node.get("perceived"))

    def place(self, name: str) -> Array:
        """(3,) where a node is in the world, m."""
        return self.memory.transform("world", name).translation


@pytest.fixture(scope="session")
def model_file() -> Path:
    """The real model, fetched if it is not here yet. Skips where neither it nor LiteRT can be had."""
    pytest.importorskip("ai_edge_litert", reason="the package ai-edge-litert (extra `hands`) is not installed")
    try:
        read_fetched()
    except ConfigError:
        try:
            write_model(from_index(print, quiet=True), fetched_file())
        except (ConfigError, OSError) as error:
            pytest.skip(f"the model of hands cannot be had: {error}")
    return fetched_file()


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
    """With a sensor that tells landmarks."""
    return make_bench(hand_sensors=SENSORS)


def reading(
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0), side: Any = "right", hidden: tuple[int, ...] = ()
) -> HandReading:
    """An open hand, moved by `offset` m in the camera's frame."""
    points = FLAT_HAND * (-1.0 if side == "left" else 1.0, 1.0, 1.0) + offset
    landmarks = tuple((float(x), float(y), float(z)) for x, y, z in points)
    return HandReading(side, landmarks, tuple(k not in hidden for k in range(21)), 0.002)


def in_world(points: Array) -> Array:
    return OVERHEAD.apply(points)


def palm_of(points: Array) -> Array:
    return np.asarray(points[list(PALM)].mean(axis=0))


def tips_of(points: Array) -> Array:
    return np.asarray(points[list(TIPS)])


def result(frame: dict[str, Any]) -> list[FoundHand]:
    """What a landmarker returned for a recorded frame."""
    size = (RECORDED["width"], RECORDED["height"], RECORDED["width"])
    return [
        FoundHand(
            np.array(hand["landmarks"]) * size, np.array(hand["world_landmarks"]), hand["side"].lower(), hand["score"]
        )
        for hand in frame["hands"]
    ]


class RecordedLandmarker:
    """Gives recorded results, one after the other, the last one again and again."""

    def __init__(self, frames: list[dict[str, Any]], error: Exception | None = None) -> None:
        self._frames = list(frames)
        self._error = error
        self.times: list[int] = []
        self.closed = False

    def detect(self, color: NDArray[np.uint8], milliseconds: int) -> list[FoundHand]:
        assert color.shape == (480, 640, 3) and color.flags["C_CONTIGUOUS"]
        self.times.append(milliseconds)
        if self._error is not None:
            raise self._error
        return result(self._frames.pop(0) if len(self._frames) > 1 else self._frames[0])

    def close(self) -> None:
        self.closed = True


def picture(frame: dict[str, Any], *, holes: bool = False) -> Frame:
    """Grey, with the depth of discs around the true joints before a table at 0.65 m."""
    meta = {"fx": RECORDED["fx"], "fy": RECORDED["fx"], "cx": RECORDED["cx"], "cy": RECORDED["cy"]}
    depth = np.full((480, 640), 0.65, np.float32)
    for hand in frame["hands"]:
        for k, (x, y, z) in sorted(enumerate(hand["truth_m"]), key=lambda entry: -entry[1][2]):
            radius = 0.012 if k in (0, 1, 5, 9, 13, 17) else 0.008
            centre = (round(x / z * meta["fx"] + meta["cx"]), round(y / z * meta["fx"] + meta["cy"]))
            cv2.circle(depth, centre, round(radius * meta["fx"] / z), float(z - radius), -1)
    if holes:
        depth[np.random.default_rng(0).random(depth.shape) < 0.6] = 0.0
    color = np.full((480, 640, 3), 128, np.uint8)
    return Frame(0.0, {"color": color, "depth": depth}, meta)


@pytest.fixture
def make_reality() -> Iterator[Callable[..., Reality]]:
    """Makes a reality that is rendered, and lets it run for some seconds."""
    made: list[Reality] = []

    def make(seconds: float, *, seed: int = 0, **parts: Any) -> Reality:
        scenario = Scenario(name="test", title="", duration=60.0, **parts)
        made.append(Reality(scenario, PlantConfig(sensor="pixels"), seed))
        for step in range(round(seconds * RATE_HZ)):
            made[-1].step(step * STEP)
        return made[-1]

    yield make
    for reality in made:
        reality.close()


def table_plane(world_from_camera: Pose) -> Array:
    """(4,) height above z = 0 in the camera's frame."""
    return np.array([*world_from_camera.rotation_matrix[2], world_from_camera.t[2]])
