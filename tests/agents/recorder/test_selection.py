"""What is recorded can be chosen, by part and by pattern; unknown names are refused."""

from __future__ import annotations

import numpy as np
import pytest

from agents.recorder.selection import PARTS, RecordSelection
from dsr import Frame, Mesh
from dsr.errors import ConfigError
from tests.agents.recorder.world import KEYS, World, camera_frame

TOPICS = {
    "d/writer-1f": "graph",
    "rt/writer-1f": "streams",
    "blob/camera/detections": "data",
    "truth": "truth",
    "device/arm/state": "devices",
    "log/planner": "logs",
    "status/planner": "statuses",
}
LARGE = 1 << 20


@pytest.mark.parametrize(("topic", "part"), TOPICS.items())
def test_a_part_is_chosen_by_its_name(topic: str, part: str) -> None:
    with_graph = ["graph"] if part == "streams" else []
    assert RecordSelection(only=[part, *with_graph]).includes(topic, 10)
    assert not RecordSelection(without=[part] if part != "graph" else [part, "streams"]).includes(topic, 10)
    others = [other for other in PARTS if other not in (part, "streams")]
    assert not RecordSelection(only=others).includes(topic, 10) or part == "streams"


def test_a_blob_is_an_image_if_it_is_large() -> None:
    images = RecordSelection(only=["images/camera_wrist"])
    assert images.includes("blob/camera_wrist", LARGE)
    assert not images.includes("blob/camera_wrist", 100)
    assert not images.includes("blob/camera_overhead", LARGE)
    assert not RecordSelection(without=["images"]).includes("blob/camera_wrist", LARGE)
    assert RecordSelection(without=["images"]).includes("blob/camera_wrist", 100)


def test_some_of_a_part_is_chosen_by_a_pattern() -> None:
    choice = RecordSelection(only=["graph", "streams/arm_controller", "devices/arm/*"], without=["devices/arm/command"])
    assert choice.includes("rt/arm_controller-0af2", 10) and not choice.includes("rt/scene_estimator-0af2", 10)
    assert choice.includes("device/arm/state", 10) and not choice.includes("device/arm/command", 10)
    assert not choice.includes("log/planner", 10)


@pytest.mark.parametrize(
    ("choice", "said"),
    [
        ({"only": ["imges"]}, "'imges' is no part of a recording; did you mean 'images'"),
        ({"without": ["d/*"]}, "'d/\\*' is no part"),
        ({"only": ["streams"]}, "streams without graph"),
        ({"without": ["graph"]}, "streams without graph"),
        ({"only": ["graph"], "without": ["graph"]}, "nothing is left to record"),
        ({"without": list(PARTS)}, "nothing is left to record"),
    ],
)
def test_unknown_names_are_refused(world: World, choice: dict[str, list[str]], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        RecordSelection(**choice)
    with pytest.raises(ConfigError, match=said):
        world.start_recorder(**choice)


def traffic(world: World) -> None:
    """Some of each part."""
    memory, bus = world.memory, world.memory.transport
    memory.add_node("world", "world")
    mesh = memory.put_mesh(Mesh([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0)], [(0, 1, 2)]))
    memory.add_node("arm", "arm", joint_positions=[0.0], mesh=mesh)
    world.run(1.5)
    memory.update_node("arm", joint_positions=[0.1])
    memory.put_frame("camera", camera_frame(7.0))
    memory.put_frame("camera/detections", Frame(7.0, {"ids": np.array([3], np.int32)}, {}))
    for key in (KEYS.truth(), KEYS.log("x"), KEYS.status("x"), KEYS.device("arm/state")):
        bus.publish(key, b"x")
    world.run(1.0)


OF_PART = {
    "graph": {"snapshot", "d"}, "streams": {"rt"}, "images": {"blob/camera"}, "data": {"blob/camera/detections"},
    "meshes": {"mesh"}, "truth": {"truth"}, "devices": {"device/arm/state"}, "logs": {"log/x"},
    "statuses": {"status/x"},
}  # fmt: skip


def recorded(world: World) -> set[str]:
    topics = {record.topic for record in world.records()}
    return {topic.partition("/")[0] if topic.startswith(("d/", "rt/")) else topic for topic in topics}


@pytest.mark.parametrize("part", PARTS)
def test_only_what_is_wanted_is_recorded(world: World, part: str) -> None:
    chosen = ["graph", "streams"] if part == "streams" else [part]
    recorder = world.start_recorder(only=chosen)
    traffic(world)
    recorder.teardown()
    assert recorded(world) == set().union(*(OF_PART[name] for name in chosen))


@pytest.mark.parametrize("part", PARTS)
def test_what_is_not_wanted_is_left_out(world: World, part: str) -> None:
    chosen = ["graph", "streams"] if part == "graph" else [part]
    recorder = world.start_recorder(without=chosen)
    traffic(world)
    recorder.teardown()
    left = set().union(*(OF_PART[name] for name in PARTS if name not in chosen))
    assert recorded(world) == left


def test_a_stream_that_never_came_is_told(world: World, caplog: pytest.LogCaptureFixture) -> None:
    recorder = world.start_recorder(only=["graph", "images/camera", "images/camera_wrist"])
    traffic(world)
    recorder.teardown()
    told = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert "nothing came of images/camera_wrist; streams heard: camera, camera/detections" in told
    assert not any("images/camera;" in text for text in told)
