"""A table with a cube behind a box, seen by a camera above and by two persons, one on each side."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from dsr import LocalNetwork, ManualClock, Memory, Pose

TURNED = (0.0, 0.0, 1.0, 0.0)


@pytest.fixture
def clock() -> ManualClock:
    return ManualClock()


@pytest.fixture
def memory(clock: ManualClock) -> Iterator[Memory]:
    with Memory("sight", "tester", transport=LocalNetwork(clock).connect("a"), clock=clock) as memory:
        memory.replica.synchroniser.nobody_there()
        for name, kind in (("world", "world"), ("human_1", "person"), ("human_2", "person")):
            memory.add_node(name, kind)
        memory.add_node("table", "table", size=(1.2, 1.2, 0.04))
        memory.add_node("camera", "camera", fx=300.0, fy=300.0, cx=159.5, cy=119.5, width=320, height=240)
        memory.add_node("cube", "cube", size=(0.04, 0.04, 0.04))
        memory.add_node("box", "box", size=(0.02, 0.2, 0.2))
        poses = {
            "table": Pose(),
            "camera": Pose((0.0, 0.0, 0.8), (1.0, 0.0, 0.0, 0.0)),
            "cube": Pose((0.1, 0.0, 0.02)),
            "box": Pose((0.0, 0.0, 0.1)),
            "human_1": Pose((1.0, 0.0, 0.2), TURNED),
            "human_2": Pose((-1.0, 0.0, 0.2)),
        }
        for name, pose in poses.items():
            memory.add_edge("world", name, "RT", pose=pose)
        yield memory
