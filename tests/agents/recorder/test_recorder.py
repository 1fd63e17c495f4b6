"""The recorder keeps all that travels in a graph, on a manual clock and a network in memory."""

from __future__ import annotations

from pathlib import Path

import msgpack
import numpy as np
import pytest

from agents.recorder.channels import SNAPSHOT
from agents.recorder.images import unpack
from agents.recorder.index import RecordingIndex
from agents.replay.source import ReplayedGraph
from dsr import Frame, Mesh, Pose
from dsr.errors import ConfigError
from dsr.images.blobs import decode_frame
from dsr.replication.wire import decode_delta
from tests.agents.recorder.world import KEYS, FullDisk, World, camera_frame, rebuilt


def test_the_graph_can_be_rebuilt_even_from_a_late_recording(world: World) -> None:
    world.memory.add_node("world", "world")
    world.memory.add_node("cube_3", "cube", mass=0.05)
    world.run(1.0)
    recorder = world.start_recorder()
    world.run(3.0)
    world.memory.add_edge("world", "cube_3", "RT", pose=Pose((0.4, 0.1, 0.02), stamp=1e9))
    world.run(0.5)
    world.memory.update_edge("world", "cube_3", "RT", pose=Pose((0.5, 0.1, 0.02), stamp=1e9 + 1))
    world.memory.update_node("cube_3", mass=0.06)
    world.run(0.5)
    recorder.teardown()
    memory = rebuilt(world.records())
    assert memory.node("cube_3")["mass"] == 0.06
    assert memory.edge("world", "cube_3", "RT").pose.translation[0] == 0.5


@pytest.mark.parametrize("period", [60.0, 1.0])
def test_all_parts_of_the_graph_are_recorded(world: World, period: float) -> None:
    """Changes alone tell of what came after the first snapshot; later ones hold all of it."""
    world.memory.create_part("kitchen")
    world.memory.add_node("world", "world")
    world.memory.add_node("cup", "cube", "kitchen", mass=0.1)
    world.run(1.0)
    recorder = world.start_recorder(snapshot_period=period)
    world.run(3.0)
    world.memory.create_part("lab")
    world.memory.add_node("robot", "robot", "lab")
    world.memory.add_edge("world", "robot", "RT", pose=Pose((1, 0, 0)))
    world.memory.add_edge("robot", "cup", "RT", pose=Pose((0, 0, 0)))
    world.run(2.0)
    world.memory.update_edge("robot", "cup", "RT", pose=Pose((0, 1, 0)))
    world.run(0.5)
    recorder.teardown()
    topics = {record.topic for record in world.records()}
    assert any(topic.startswith("d/writer-lab.") for topic in topics) and not any("part/" in topic for topic in topics)
    memory = rebuilt(world.records())
    assert memory.transform("world", "cup").t == (1, 1, 0) and memory.part(memory.node("robot")) == "lab"
    replayed = ReplayedGraph(world.folder)
    assert replayed.at(replayed.duration).transform("world", "cup").t == (1, 1, 0)


def test_the_snapshot_comes_first_and_again_after_its_period(world: World) -> None:
    world.memory.add_node("world", "world")
    world.run(0.5)
    recorder = world.start_recorder(snapshot_period=2.0)
    world.run(8.0)
    recorder.teardown()
    stamps = [record.stamp for record in world.records() if record.topic == "snapshot"]
    assert len(stamps) >= 3
    assert np.diff(stamps) == pytest.approx(2.0, abs=0.11)


def test_other_traffic_is_recorded_as_it_is(world: World) -> None:
    recorder = world.start_recorder()
    truth = msgpack.packb({"stamp": 1.0, "objects": {"cube_3": [0, 0, 0, 0, 0, 0, 1]}})
    bus = world.memory.transport
    for key, payload in ((KEYS.truth(), truth), (KEYS.log("x"), b"\x01"), (KEYS.status("x"), b"not even MessagePack")):
        bus.publish(key, payload)
    bus.publish(KEYS.device("arm/state"), b"state")
    bus.publish(KEYS.device("camera/overhead/poses"), b"poses")
    bus.publish(KEYS.device("camera/overhead"), b"images are recorded as blobs")
    world.run(1.0)
    recorder.teardown()
    found = {record.topic: record.payload for record in world.records()}
    assert found["truth"] == truth and found["log/x"] == b"\x01" and found["status/x"] == b"not even MessagePack"
    devices = {topic: payload for topic, payload in found.items() if topic.startswith("device/")}
    assert devices == {"device/arm/state": b"state", "device/camera/overhead/poses": b"poses"}


def test_messages_of_one_instant_keep_their_order(world: World) -> None:
    recorder = world.start_recorder()
    wanted = [KEYS.log("x"), KEYS.truth(), KEYS.status("x"), KEYS.device("arm/state"), KEYS.log("y")]
    for key in wanted:
        world.memory.transport.publish(key, b"")
    world.run(0.5)
    recorder.teardown()
    found = [f"{KEYS.root}/{record.topic}" for record in world.records()]
    assert [key for key in found if key in wanted] == wanted


def test_what_a_repair_brought_is_recorded(world: World) -> None:
    recorder = world.start_recorder()
    world.run(1.0)
    world.network.partition(["writer"], ["recorder"])
    world.memory.add_node("world", "world")
    world.run(0.3)
    world.network.heal()
    world.run(3.0)
    recorder.teardown()
    assert {node.name for node in rebuilt(world.records()).nodes()} == {"world"}


@pytest.mark.parametrize(("frames_hz", "expected"), [(2.0, 10), (10.0, 50), (0.0, 0)])
def test_images_are_thinned_and_small_blobs_are_not(world: World, frames_hz: float, expected: int) -> None:
    recorder = world.start_recorder(frames_hz=frames_hz, still_hz=frames_hz)
    for _ in range(50):
        world.memory.put_frame("camera", camera_frame(world.clock.now()))
        ids = {"ids": np.array([3], np.int32)}
        world.memory.put_frame("camera/detections", Frame(world.clock.now(), ids, {}))
        world.step()
    recorder.teardown()
    topics = [record.topic for record in world.records()]
    assert abs(topics.count("blob/camera") - expected) <= 1
    assert topics.count("blob/camera/detections") == 50


def test_recorded_images_can_be_looked_at(world: World) -> None:
    recorder = world.start_recorder()
    world.memory.put_frame("camera", camera_frame(7.0))
    world.run(1.0)
    recorder.teardown()
    (payload,) = [record.payload for record in world.records() if record.topic == "blob/camera"]
    frame = unpack(decode_frame(payload))
    assert frame.stamp == 7.0 and frame.arrays["color"].shape == (120, 160, 3)
    np.testing.assert_allclose(frame.arrays["depth"], 0.8, atol=1e-3)


def test_a_large_blob_that_is_no_frame_is_kept_as_it_is(world: World) -> None:
    recorder = world.start_recorder()
    world.memory.transport.publish(KEYS.blob("mesh/1f2e"), b"m" * 100_000)
    world.run(1.0)
    recorder.teardown()
    assert [record.payload for record in world.records() if record.topic == "blob/mesh/1f2e"] == [b"m" * 100_000]


def test_nothing_older_than_the_flush_period_is_lost_by_a_kill(world: World) -> None:
    world.start_recorder()
    for index in range(50):
        world.memory.transport.publish(KEYS.log("x"), bytes([index]))
        world.step()
    logs = [record for record in world.records() if record.topic == "log/x"]
    assert logs[-1].stamp >= world.clock.now() - 1.2


def test_a_restarted_recorder_writes_a_new_segment(world: World) -> None:
    world.start_recorder()
    world.memory.add_node("world", "world")
    world.run(1.0)
    world.start_recorder()
    world.memory.add_node("table", "table")
    world.run(3.0)
    assert sorted(file.name for file in world.folder.iterdir()) == ["recording-2.mcap", "recording.mcap"]
    assert {node.name for node in rebuilt(world.records()).nodes()} == {"world", "table"}


def test_an_overflow_is_counted_and_shown(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agents.recorder.agent._MOST_WAITING", 5)
    recorder = world.start_recorder()
    for _ in range(8):
        world.memory.transport.publish(KEYS.log("x"), b"")
    world.step()
    assert "3 messages were not recorded" in recorder.degraded


@pytest.mark.parametrize("config", [{"frames_hz": -1.0}, {"frames_hz": float("nan")}, {"jpeg_quality": 0}])
def test_a_wrong_configuration_is_refused(world: World, config: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=next(iter(config))):
        world.start_recorder(**config)


def test_meshes_that_nodes_name_are_kept_once_each(world: World) -> None:
    mesh = Mesh([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0)], [(0, 1, 2)])
    world.memory.add_node("flag", "object", mesh=world.memory.put_mesh(mesh))
    world.memory.add_node("twin", "object", mesh=mesh.hash)
    world.memory.add_node("ghost", "object", mesh="0" * 64)
    recorder = world.start_recorder()
    world.run(3.0)
    world.memory.update_node("twin", mesh=f"{mesh.hash},{mesh.hash}")
    world.run(1.0)
    recorder.teardown()
    assert [record.payload for record in world.records() if record.topic == "mesh"] == [mesh.data]


def test_a_full_disk_is_told_and_recording_goes_on_when_there_is_room(
    world: World, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    opened = Path.open
    monkeypatch.setattr(Path, "open", lambda path, mode="r", *rest, **more: FullDisk(opened(path, mode)))  # type: ignore[call-overload]
    monkeypatch.setattr(FullDisk, "free", 10**9)
    recorder = world.start_recorder()
    world.memory.add_node("before", "cube")
    world.run(1.0)
    FullDisk.free = 0
    world.memory.add_node("unrecorded", "cube")
    world.run(12.0)
    assert "No space left" in recorder.degraded and "messages are missing" in recorder.degraded
    FullDisk.free = 10**9
    world.run(6.0)
    world.memory.add_node("after", "cube")
    world.run(1.0)
    assert recorder.degraded == ""
    recorder.teardown()
    monkeypatch.undo()
    assert [record.levelname for record in caplog.records if record.levelname != "INFO"] == ["ERROR", "WARNING"]
    assert sorted(file.name for file in world.folder.iterdir()) == ["recording-2.mcap", "recording.mcap"]
    index = RecordingIndex(world.folder)
    assert index.metadata["segment"] in ("recording.mcap", "recording-2.mcap")
    snapshots = [record for record in world.records() if record.topic == SNAPSHOT]
    names = {str(add.key) for record in snapshots[-1:] for add in decode_delta(record.payload).adds}
    assert {"before", "unrecorded"} <= names, "the first snapshot after the gap holds what changed in it"


def test_a_disk_that_is_full_at_the_start_is_a_clear_error(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    opened = Path.open
    monkeypatch.setattr(Path, "open", lambda path, mode="r", *rest, **more: FullDisk(opened(path, mode)))  # type: ignore[call-overload]
    monkeypatch.setattr(FullDisk, "free", 0)
    with pytest.raises(ConfigError, match="No space left"):
        world.start_recorder()
