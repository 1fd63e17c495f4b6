"""Recordings in several files: each is complete by itself, limits hold, a full disk costs the oldest."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.recorder.agent import LAG
from agents.recorder.config import MB
from agents.recorder.reader import read_recording
from agents.replay import ReplayedGraph
from agents.segments import segments
from dsr import Memory, Mesh
from dsr.errors import ConfigError
from tests.agents.recorder.world import KEYS, FullDisk, World, camera_frame, rebuilt


def state(memory: Memory) -> dict[Any, Any]:
    nodes: dict[Any, Any] = {node.name: (node.type, node.attributes) for node in memory.nodes()}
    return nodes | {edge.key: edge.attributes for edge in memory.edges()}


def files(folder: Path) -> list[Path]:
    return segments(folder, "recording.mcap")


def change_something(memory: Memory, rng: np.random.Generator) -> None:
    name = f"cube_{rng.integers(6)}"
    match rng.integers(4):
        case 0:
            memory.remove_node(name)
        case 1:
            memory.add_node(name, "cube", mass=float(rng.random()))
        case 2 if name in memory:
            memory.add_edge("world", name, "Virtual_RT", translation=rng.random(3).tolist(), stamp=1e9 + rng.random())
        case _ if name in memory:
            memory.update_node(name, mass=float(rng.random()))


@pytest.mark.parametrize("seed", range(20))
def test_each_file_alone_holds_the_same_graph_as_all_up_to_it(world: World, seed: int) -> None:
    """Also if the recorder's own graph, of which it makes snapshots, is behind what it records."""
    rng = np.random.default_rng(seed)
    world.memory.add_node("world", "world")
    world.run(0.5)
    recorder = world.start_recorder(rotate_period=float(rng.uniform(0.1, 2.0)), flush_period=0.2)
    world.run(1.5)
    longest = round(LAG * 10) - 2
    for _ in range(30):
        for _ in range(rng.integers(1, longest)):  # without a poll of its graph: it lags behind
            change_something(world.memory, rng)
            world.memory.flush()
            world.network.deliver()
            recorder.tick(world.clock.now())
            world.clock.advance(0.1)
        world.step()
    recorder.teardown()
    found = files(world.folder)
    assert len(found) > 5
    so_far = []
    for file in found:
        records = list(read_recording(file))
        so_far += records
        assert state(rebuilt(records)) == state(rebuilt(so_far)), file.name
    assert state(rebuilt(so_far)) == state(world.memory)


def test_messages_other_than_changes_are_in_one_file(world: World) -> None:
    recorder = world.start_recorder(rotate_period=0.5)
    for index in range(60):
        world.memory.transport.publish(KEYS.log("x"), bytes([index]))
        world.step()
    recorder.teardown()
    assert len(files(world.folder)) > 5
    logs = [record.payload for record in world.records() if record.topic == "log/x"]
    assert logs == [bytes([index]) for index in range(60)]


def test_any_file_or_the_folder_can_be_replayed(world: World) -> None:
    world.memory.add_node("world", "world")
    mesh = Mesh([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0)], [(0, 1, 2)])
    recorder = world.start_recorder(rotate_period=3.0)
    world.memory.add_node("cube_3", "cube", mesh=world.memory.put_mesh(mesh))
    for second in range(12):
        world.memory.update_node("cube_3", mass=float(second))
        for _ in range(10):
            world.memory.put_frame("camera", camera_frame(world.clock.now()))
            world.step()
    recorder.teardown()
    assert [file.name for file in files(world.folder)][:2] == ["recording.mcap", "recording-2.mcap"]
    for file in files(world.folder)[1:]:
        alone = ReplayedGraph(file)
        assert alone.problems == []
        assert "world" in alone.at(0.0) and "cube_3" in alone.at(0.0)
        assert [found.hash for found in alone.index.meshes()] == [mesh.hash]
        assert alone.index.topics["blob/camera"] >= 1, "each file begins with an image of each camera"
    together = ReplayedGraph(world.folder)
    assert [together.at(time).node("cube_3")["mass"] for time in (1.5, 4.5, 10.5)] == [1.0, 4.0, 10.0]


def test_a_file_ends_when_it_is_large(world: World) -> None:
    recorder = world.start_recorder(rotate_mb=0.1, flush_period=0.2)
    rng = np.random.default_rng(0)
    for _ in range(100):
        world.memory.transport.publish(KEYS.log("x"), rng.bytes(10_000))
        world.step()
    recorder.teardown()
    sizes = [file.stat().st_size for file in files(world.folder)]
    assert 6 <= len(sizes) <= 12
    assert all(100_000 <= size < 150_000 for size in sizes[:-1])


def test_a_graph_larger_than_the_limit_does_not_begin_a_file_at_every_tick(world: World) -> None:
    rng = np.random.default_rng(0)
    for index in range(200):
        world.memory.add_node(f"cube_{index}", "cube", note=rng.bytes(100).hex())
    world.run(1.0)
    recorder = world.start_recorder(rotate_mb=0.001, flush_period=0.2)
    for index in range(50):
        world.memory.update_node("cube_1", mass=float(index))
        world.step()
    recorder.teardown()
    assert len(files(world.folder)) == 1


def write_much(world: World, seconds: float, seed: int = 0) -> None:
    """About 0.1 MB/s that nothing can compress."""
    rng = np.random.default_rng(seed)
    for _ in range(round(seconds * 10)):
        world.memory.transport.publish(KEYS.log("x"), rng.bytes(10_000))
        world.step()


def test_the_newest_files_are_kept(world: World) -> None:
    recorder = world.start_recorder(rotate_period=1.0, keep_files=3)
    write_much(world, 10.0)
    recorder.teardown()
    numbers = [int(file.stem.partition("-")[2]) for file in files(world.folder)]
    assert len(numbers) == 3 and numbers[0] >= 7
    assert numbers == list(range(numbers[0], numbers[0] + 3))
    assert ReplayedGraph(world.folder).problems == []


@pytest.mark.parametrize("rotate_mb", [0.0, 0.1])
def test_the_files_stay_within_their_size(world: World, rotate_mb: float) -> None:
    recorder = world.start_recorder(keep_mb=0.5, rotate_mb=rotate_mb, flush_period=0.2)
    largest = 0
    for second in range(20):
        write_much(world, 1.0, second)
        largest = max(largest, sum(file.stat().st_size for file in files(world.folder)))
    recorder.teardown()
    assert 0.3 * MB < largest < 0.6 * MB
    assert len(files(world.folder)) >= 4


def test_files_of_an_unlimited_recording_are_never_removed(world: World) -> None:
    world.start_recorder(rotate_period=1.0).teardown()
    world.start_recorder().teardown()
    before = files(world.folder)
    recorder = world.start_recorder(rotate_period=1.0, keep_files=2)
    write_much(world, 6.0)
    recorder.teardown()
    assert files(world.folder)[:2] == before
    assert len(files(world.folder)) == 4


def test_a_restarted_recorder_keeps_the_limits_of_the_one_before(world: World) -> None:
    for _ in range(4):
        world.start_recorder(rotate_period=1.0, keep_files=3)
        write_much(world, 3.0)
    assert len(files(world.folder)) == 3


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> type[FullDisk]:
    opened, removed = Path.open, Path.unlink

    def unlink(path: Path, missing_ok: bool = False) -> None:
        FullDisk.free += path.stat().st_size if path.exists() else 0
        removed(path, missing_ok)

    monkeypatch.setattr(FullDisk, "free", 10**9)
    monkeypatch.setattr(FullDisk, "error", errno.ENOSPC)
    monkeypatch.setattr(
        Path,
        "open",
        lambda path, mode="r", *rest, **more: FullDisk(opened(path, mode)) if "x" in mode else opened(path, mode),
    )
    monkeypatch.setattr(Path, "unlink", unlink)
    return FullDisk


def test_a_full_disk_costs_the_oldest_file_if_there_are_limits(
    world: World, disk: type[FullDisk], caplog: pytest.LogCaptureFixture
) -> None:
    recorder = world.start_recorder(rotate_period=1.0, keep_files=100)
    write_much(world, 5.0)
    first = files(world.folder)[0]
    disk.free = 0
    write_much(world, 1.5)
    assert recorder.degraded == "" and not first.exists()
    assert "the oldest file was removed" in caplog.text
    write_much(world, 3.0)
    recorder.teardown()
    last = [record for record in world.records() if record.topic == "log/x"][-1]
    assert last.stamp > world.clock.now() - 1.0
    lost = [record for record in caplog.records if "messages are missing" in record.getMessage()]
    assert lost, "what was lost is told"


def test_a_recorder_that_starts_on_a_full_disk_makes_room_within_limits(world: World, disk: type[FullDisk]) -> None:
    recorder = world.start_recorder(rotate_period=1.0, keep_files=100)
    write_much(world, 5.0)
    recorder.teardown()
    before = files(world.folder)
    disk.free = 0
    recorder = world.start_recorder(rotate_period=1.0, keep_files=100)
    write_much(world, 0.5)
    recorder.teardown()
    assert before[0] not in files(world.folder) and files(world.folder)[-1] not in before


def test_another_fault_of_the_disk_costs_no_file(world: World, disk: type[FullDisk]) -> None:
    recorder = world.start_recorder(rotate_period=1.0, keep_files=100)
    write_much(world, 5.0)
    before = files(world.folder)
    disk.free, disk.error = 0, errno.EIO
    write_much(world, 2.0)
    assert "nothing is recorded" in recorder.degraded
    assert set(before[:-1]) <= set(files(world.folder))
    disk.free = 10**9
    write_much(world, 6.0)
    assert recorder.degraded == ""
    recorder.teardown()


def test_what_was_lost_to_a_full_disk_is_counted(
    world: World, disk: type[FullDisk], caplog: pytest.LogCaptureFixture
) -> None:
    recorder = world.start_recorder(flush_period=0.2)
    write_much(world, 2.0)
    disk.free = 0
    write_much(world, 7.0)
    disk.free = 10**9
    write_much(world, 6.0)
    recorder.teardown()
    kept = sum(record.topic == "log/x" for record in world.records())
    (told,) = [int(record.getMessage().split()[-4]) for record in caplog.records if record.levelname == "WARNING"]
    assert told == 150 - kept


def test_a_recording_that_ends_on_a_full_disk_says_how_much_is_missing(
    world: World, disk: type[FullDisk], caplog: pytest.LogCaptureFixture
) -> None:
    recorder = world.start_recorder(flush_period=0.2)
    write_much(world, 2.0)
    disk.free = 0
    write_much(world, 7.0)
    recorder.teardown()
    kept = sum(record.topic == "log/x" for record in world.records())
    told = [record.getMessage() for record in caplog.records if record.levelname == "ERROR"][-1]
    assert told == f"there was no room for the end of the recording; {90 - kept} messages are missing"


@pytest.mark.parametrize(
    ("config", "said"),
    [
        ({"rotate_mb": -1.0}, "rotate_mb -1"),
        ({"keep_files": 3}, "keep_files 3: expected rotate_mb"),
        ({"keep_files": -3, "rotate_mb": 1.0}, "keep_files -3"),
        ({"keep_mb": 5.0, "rotate_mb": 10.0}, "rotate_mb 10: expected no more than keep_mb"),
        ({"flush_period": 0.0}, "flush_period"),
    ],
)
def test_limits_that_make_no_sense_are_refused(world: World, config: dict[str, float], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        world.start_recorder(**config)
