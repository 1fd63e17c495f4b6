"""Drivers behind the agent of a camera on a stand: frames and intrinsics in the memory, troubles in the status."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from agents.fixed_camera import FixedCamera
from dsr import Frame, LocalNetwork, Memory
from dsr.agent import make_agent
from dsr.clock import WALL_CLOCK
from dsr.graph.access import WriteGuard
from dsr.images.frame_reader import FrameReader
from dsr.network.keys import Keys
from dsr.runtime.runner import Runner
from dsr.runtime.status import State
from dsr.vocabulary.intrinsics import Intrinsics, read_intrinsics
from tests.agents.cameras.conftest import eventually

MOUNT = {"position": [-0.9, 0.0, 1.5], "look_at": [0.0, 0.0, 0.72]}
Make = Callable[..., "Stand"]


class Stand:
    """A camera agent, ticked by the wall clock."""

    def __init__(self, network: LocalNetwork, **config: Any) -> None:
        self.network = network
        guard = WriteGuard("fixed_camera", FixedCamera.writes)
        transport = network.connect("fixed_camera")
        self.memory = Memory("g", "fixed_camera", transport=transport, clock=WALL_CLOCK, guard=guard)
        self.frames = FrameReader(network.connect("viewer"), Keys("g").blob("camera_fixed"))
        self.agent = make_agent(
            FixedCamera, name="fixed_camera", config={"mount": MOUNT, **config}, bus=transport, keys=Keys("g"),
            clock=WALL_CLOCK, memory=self.memory,
        )  # fmt: skip
        self.runner = Runner(self.agent, rid=self.memory.rid)
        self.runner.setup()

    def tick(self) -> Frame | None:
        self.runner.tick(WALL_CLOCK.now())
        self.network.deliver()
        return self.frames.latest()


@pytest.fixture
def make() -> Iterator[Make]:
    made: list[Stand] = []

    def stand(**config: Any) -> Stand:
        made.append(Stand(LocalNetwork(WALL_CLOCK), **config))
        return made[-1]

    yield stand
    for one in made:
        one.runner.teardown()
        one.memory.close()


def test_a_film_is_in_the_memory_with_its_lens(make: Make, tmp_path: Path) -> None:
    film, calibration = tmp_path / "film.avi", tmp_path / "camera.toml"
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter_fourcc(*"MJPG"), 25.0, (64, 48))
    for number in range(10):
        writer.write(np.full((48, 64, 3), 20 * number, np.uint8))
    writer.release()
    calibration.write_text(
        "fx = 60.0\nfy = 61.0\ncx = 31.5\ncy = 23.5\nwidth = 64\nheight = 48\n"
        'distortion_model = "plumb_bob"\ndistortion = [0.1, 0.0, 0.0, 0.0]\n'
    )
    stand = make(driver="video", options={"file": str(film), "calibration": str(calibration)})
    found: list[Frame] = []
    eventually(lambda: found.extend(filter(None, [stand.tick()])) or found)
    told = read_intrinsics(stand.memory.node("camera_fixed"))
    assert told is not None and told == Intrinsics.from_meta(found[0].meta, (48, 64))
    assert told.distortion is not None and told.distortion.coefficients == (0.1, 0.0, 0.0, 0.0)
    assert stand.runner.status().state is State.READY


def test_a_camera_that_is_not_there_degrades_the_agent_until_it_is(
    make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stand = make(driver="webcam", options={"device": str(tmp_path / "video0"), "first_pause": 0.01})
    eventually(lambda: stand.tick() is None and stand.agent.degraded)
    status = stand.runner.status()
    assert status.state is State.DEGRADED and status.counts == {"lost": 1}
    assert status.last_error.startswith(f"camera 'camera_fixed': there is no {tmp_path}/video0")
    film = cv2.VideoWriter(str(tmp_path / "video0.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 25.0, (64, 48))
    for number in range(50):
        film.write(np.full((48, 64, 3), 4 * number + 30, np.uint8))
    film.release()
    (tmp_path / "video0.avi").rename(tmp_path / "video0")  # OpenCV opens files and cameras alike
    eventually(lambda: stand.tick() is not None)
    assert stand.agent.degraded == "" and stand.runner.status().state is State.READY
