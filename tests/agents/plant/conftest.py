"""Small scenes for the tests of the simulated reality."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from agents.arm_controller.motion.trajectory import MotionLimits, resampled, timed
from agents.plant.arm import SimulatedArm
from agents.plant.bullet import Bullet
from agents.plant.config import PlantConfig
from agents.plant.reality import Reality
from agents.plant.world import RATE_HZ, STEP, World
from agents.scenario.format.scenario import ObjectSpec, Scenario, TableSpec


@pytest.fixture
def cube() -> Callable[..., ObjectSpec]:
    """Makes a cube called `cube_<id>` at x, y, z m."""

    def make(marker_id: int, x: float, y: float, z: float = 0.02, **fields: Any) -> ObjectSpec:
        return ObjectSpec(name=f"cube_{marker_id}", marker_id=marker_id, position=(x, y, z), **fields)

    return make


@pytest.fixture
def make_world() -> Iterator[Callable[..., World]]:
    """Makes worlds with objects, and closes them."""
    made: list[World] = []

    def make(*objects: ObjectSpec) -> World:
        made.append(World(Bullet(), TableSpec(), objects))
        return made[-1]

    yield make
    for world in made:
        world.bullet.close()


@pytest.fixture
def make_reality() -> Iterator[Callable[..., Reality]]:
    """Makes realities of a scenario's parts, without images unless asked for, and closes them."""
    made: list[Reality] = []

    def make(*objects: ObjectSpec, seed: int = 0, config: dict[str, Any] | None = None, **parts: Any) -> Reality:
        scenario = Scenario(name="test", title="", duration=60.0, objects=list(objects), **parts)
        made.append(Reality(scenario, PlantConfig(**({"sensor": "poses"} | (config or {}))), seed))
        return made[-1]

    yield make
    for reality in made:
        reality.close()


@pytest.fixture
def send() -> Callable[..., None]:
    """Sends an arm straight to joint positions (rad), at 0 to 1 of its velocity limits."""

    def straight(arm: SimulatedArm, positions: Any, speed: float = 1.0) -> None:
        fastest = np.array([joint.velocity for joint in arm.model.chain.joints])
        way = timed(resampled(np.array([arm.positions, positions])), fastest, MotionLimits(speed, 5.0, 100.0))
        arm.follow(way.times.tolist(), way.positions.tolist())

    return straight


@pytest.fixture
def play() -> Callable[..., None]:
    """Lets a reality run over scenario time, from `start` for `seconds`."""

    def run(reality: Reality, seconds: float, start: float = 0.0) -> None:
        for step in range(round(seconds * RATE_HZ)):
            reality.step(start + step * STEP)

    return run
