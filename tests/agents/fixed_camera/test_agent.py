"""A camera on a stand: its pose is in the graph once, its frames arrive."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest

from agents.fixed_camera import FixedCamera
from dsr import Frame, LocalNetwork, ManualClock, Memory, Pose
from dsr.agent import make_agent
from dsr.errors import ConfigError
from dsr.graph.access import WriteGuard
from dsr.images.frame_reader import FrameReader
from dsr.network.keys import Keys

MOUNT = {"position": [-0.9, 0.0, 1.5], "look_at": [0.0, 0.0, 0.72]}


class Camera:
    """A driver with one frame."""

    def __init__(self, bus: object, keys: object, name: str = "") -> None:
        self.name = name
        self.closed = False
        image = np.zeros((48, 64, 3), np.uint8)
        self.next: Frame | None = Frame(1.0, {"color": image}, {"fx": 60.0, "fy": 60.0, "cx": 32.0, "cy": 24.0})

    def frame(self) -> Frame | None:
        frame, self.next = self.next, None
        return frame

    def close(self) -> None:
        self.closed = True


class Faulty(Camera):
    """A driver whose camera is gone."""

    trouble = "unplugged"
    counts: ClassVar[dict[str, int]] = {"lost": 2}


@pytest.fixture
def network() -> LocalNetwork:
    return LocalNetwork(ManualClock())


@pytest.fixture
def memory(network: LocalNetwork) -> Memory:
    clock = ManualClock()
    transport = network.connect("fixed_camera")
    guard = WriteGuard("fixed_camera", FixedCamera.writes)
    return Memory("test", "fixed_camera", transport=transport, clock=clock, guard=guard)


def make(memory: Memory, **config: Any) -> FixedCamera:
    settings = {"driver": f"{__name__}:Camera", **config}
    return make_agent(
        FixedCamera,
        name="fixed_camera",
        config=settings,
        bus=memory.transport,
        keys=Keys("test"),
        clock=memory.clock,
        memory=memory,
    )


def start(memory: Memory, **config: Any) -> FixedCamera:
    agent = make(memory, **config)
    agent.setup()
    return agent


def test_the_pose_and_the_frames_are_in_the_memory(memory: Memory, network: LocalNetwork) -> None:
    reader = FrameReader(network.connect("viewer"), Keys("test").blob("camera_fixed"))
    agent = start(memory, mount=MOUNT)
    agent.tick(1.0)
    network.deliver()
    assert memory.transform("world", "camera_fixed").t == (-0.9, 0.0, 1.5)
    assert memory.transform("camera_fixed", "world").apply([0.0, 0.0, 0.72])[:2] == pytest.approx([0.0, 0.0])
    node = memory.node("camera_fixed")
    assert (node.type, node["stream"], node["fx"], node["width"]) == ("camera", "camera_fixed", 60.0, 64)
    frame = reader.latest()
    assert frame is not None and frame.stamp == 1.0
    agent.teardown()


def test_what_the_driver_says_of_its_camera_is_in_the_status(memory: Memory) -> None:
    agent = start(memory, driver=f"{__name__}:Faulty", mount=MOUNT)
    agent.tick(1.0)
    assert agent.degraded == "camera 'camera_fixed': unplugged" and agent.counts == {"lost": 2}
    Faulty.trouble = ""
    agent.tick(1.1)
    assert agent.degraded == ""


def test_a_driver_has_a_short_name_too(memory: Memory) -> None:
    agent = start(memory, driver="plant", mount=MOUNT)
    agent.tick(1.0)
    assert agent.degraded == "" and agent.counts == {}
    agent.teardown()
    with pytest.raises(ConfigError, match="unknown driver 'plnt'; did you mean 'plant'"):
        start(memory, driver="plnt", mount=MOUNT)


def test_a_pose_that_is_known_already_stays(memory: Memory) -> None:
    memory.add_node("world", "world")
    memory.add_node("camera_fixed", "camera")
    memory.add_edge("world", "camera_fixed", "RT", pose=Pose((1.0, 2.0, 3.0)))
    start(memory, mount=MOUNT)
    assert memory.transform("world", "camera_fixed").t == (1.0, 2.0, 3.0)


def test_the_scenario_may_tell_the_pose(memory: Memory) -> None:
    start(memory, scenario="b_drop_in_box", options={"name": "fixed"})
    assert memory.transform("world", "camera_fixed").t == (-0.9, 0.0, 1.5)


@pytest.mark.parametrize(("config", "message"), [({}, "expected `mount`"), ({"scenario": "hovering"}, "'overhead'")])
def test_without_a_pose_it_does_not_start(memory: Memory, config: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        start(memory, **config)


def test_it_ends_though_it_never_started(memory: Memory) -> None:
    make(memory).teardown()
