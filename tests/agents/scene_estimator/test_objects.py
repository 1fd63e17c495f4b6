"""Which node carries which tag, and which unknown tags become nodes."""

from __future__ import annotations

import logging

import pytest

from agents.scene_estimator import SceneEstimatorConfig
from agents.scene_estimator.objects import TaggedObjects
from agents.scene_estimator.sighting import Sighting
from dsr import LocalNetwork, ManualClock, Memory, Pose

AFTER = 3


@pytest.fixture
def memory() -> Memory:
    clock = ManualClock()
    return Memory("test", "estimator", transport=LocalNetwork(clock).connect("estimator"), clock=clock)


@pytest.fixture
def objects(memory: Memory) -> TaggedObjects:
    config = SceneEstimatorConfig(insert_after=AFTER, insert_within=0.03, default_size=0.05)
    return TaggedObjects(memory, config, logging.getLogger("test"))


def show(objects: TaggedObjects, *markers: int, x: float = 0.0, camera: str = "left") -> None:
    objects.update()
    objects.consider(camera, [Sighting(marker, Pose((x, 0.0, 0.5))) for marker in markers])


def test_an_unknown_tag_becomes_a_cube_when_it_was_seen_steadily(objects: TaggedObjects, memory: Memory) -> None:
    for _ in range(AFTER):
        show(objects, 4)
        assert memory.nodes() == []
    show(objects, 4)
    node = objects.find(4)
    assert node is not None
    assert (node.name, node.type) == ("cube_4", "cube")
    assert dict(node) == {"marker_id": 4, "size": (0.05, 0.05, 0.05), "perceived": True}


def test_a_tag_seen_now_and_then_is_a_ghost(objects: TaggedObjects, memory: Memory) -> None:
    for _ in range(5):
        for _ in range(AFTER):
            show(objects, 4)
        show(objects)
    assert memory.nodes() == []


def test_a_tag_that_jumps_is_a_ghost(objects: TaggedObjects, memory: Memory) -> None:
    for frame in range(20):
        show(objects, 4, x=0.05 * (frame % 2))
    assert memory.nodes() == []
    for _ in range(AFTER + 1):
        show(objects, 4)
    assert "cube_4" in memory


def test_each_camera_counts_for_itself(objects: TaggedObjects, memory: Memory) -> None:
    for _ in range(AFTER):
        show(objects, 4, camera="left")
        show(objects, 4, camera="right", x=1.0)
    assert memory.nodes() == []
    show(objects, 4, camera="right", x=1.0)
    assert "cube_4" in memory


def test_a_name_that_is_taken_is_left_alone(
    objects: TaggedObjects, memory: Memory, caplog: pytest.LogCaptureFixture
) -> None:
    memory.add_node("cube_4", "cube", marker_id=7)
    for _ in range(10):
        show(objects, 4)
    assert objects.find(4) is None
    assert dict(memory.node("cube_4")) == {"marker_id": 7}
    assert [record.message for record in caplog.records] == [
        "tag 4 is seen, but cube_4 is known to carry another one or none"
    ]


def test_known_tags_are_found_by_whatever_name(objects: TaggedObjects, memory: Memory) -> None:
    memory.add_node("breakfast", "box", marker_id=4, size=(0.1, 0.2, 0.3))
    for _ in range(10):
        show(objects, 4)
    node = objects.find(4)
    assert node is not None
    assert node.name == "breakfast"
    assert objects.size(4) == (0.1, 0.2, 0.3)
    assert len(memory.nodes()) == 1


def test_sizes_that_are_missing_or_none_are_replaced(objects: TaggedObjects, memory: Memory) -> None:
    memory.add_node("a", "cube", marker_id=4)
    memory.add_node("b", "cube", marker_id=5, size=(0.1, 0.0, 0.1))
    objects.update()
    assert [objects.size(marker) for marker in (4, 5, 6)] == [(0.05, 0.05, 0.05)] * 3


def test_tags_follow_what_others_write(objects: TaggedObjects, memory: Memory) -> None:
    memory.add_node("a", "cube", marker_id=4)
    objects.update()
    memory.update_node("a", marker_id=5)
    objects.update()
    assert objects.find(4) is None
    assert objects.find(5) is not None
    memory.remove_node("a")
    assert objects.find(5) is None
    for _ in range(AFTER + 1):
        show(objects, 5)
    assert "cube_5" in memory


def test_a_tag_on_what_is_no_object_is_neither_found_nor_new(objects: TaggedObjects, memory: Memory) -> None:
    memory.add_node("table", "table", marker_id=4)
    for _ in range(10):
        show(objects, 4)
    assert objects.find(4) is None
    assert len(memory.nodes()) == 1
