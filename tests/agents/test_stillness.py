"""Whether a camera stood still, from the samples of its frame chain."""

from __future__ import annotations

import numpy as np
import pytest

from agents.stillness import stood_still
from dsr import LocalNetwork, ManualClock, Memory, Pose

SPEED, TURN = 0.02, 0.05


@pytest.fixture
def memory() -> Memory:
    clock = ManualClock(100.0)
    memory = Memory("test", "arm", transport=LocalNetwork(clock).connect("arm"), clock=clock)
    for name, kind in (("world", "world"), ("gripper", "gripper"), ("camera", "camera")):
        memory.add_node(name, kind)
    memory.add_edge("gripper", "camera", "RT", pose=Pose((0.0, 0.1, 0.0)))
    return memory


def move(memory: Memory, speed: float = 0.0, turn: float = 0.0) -> None:
    """Let the gripper move for a second, until 101 s."""
    for seconds in np.arange(0.0, 1.01, 0.05):
        turned = Pose.from_rotvec((speed * seconds, 0.0, 0.5), (0.0, 0.0, turn * seconds), 100.0 + seconds)
        memory.add_edge("world", "gripper", "RT", pose=turned)


def still(memory: Memory, stamp: float = 100.9) -> bool:
    return stood_still(memory, "camera", stamp, SPEED, TURN)


@pytest.mark.parametrize(
    ("speed", "turn", "expected"),
    [(0.0, 0.0, True), (0.01, 0.0, True), (0.03, 0.0, False), (0.0, 0.04, True), (0.0, 0.06, False)],
)
def test_speeds_are_compared_with_the_limits(memory: Memory, speed: float, turn: float, expected: bool) -> None:
    move(memory, speed, turn)
    assert still(memory) is expected


def test_what_counts_is_the_time_of_the_exposure(memory: Memory) -> None:
    move(memory, speed=0.5)
    for stamp in (101.5, 102.0):
        memory.add_edge("world", "gripper", "RT", pose=Pose((0.5, 0.0, 0.5), stamp=stamp))
    assert still(memory, 101.9)
    assert not still(memory, 100.9)


def test_a_chain_not_known_at_that_time_may_move(memory: Memory) -> None:
    move(memory)
    assert still(memory, 101.05)
    assert not still(memory, 101.5)
    assert not still(memory, 100.05)


def test_fixed_cameras_stand_still_at_all_times(memory: Memory) -> None:
    memory.add_edge("world", "gripper", "RT", pose=Pose((0.0, 0.0, 0.5)))
    assert still(memory, 1.0)
    assert still(memory, 1e9)


def test_a_camera_without_a_place_cannot_be_said_to_move(memory: Memory) -> None:
    assert still(memory)
    memory.remove_node("camera")
    assert still(memory)
