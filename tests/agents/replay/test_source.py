"""The graph of a recording at any of its times."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from agents.recorder import RecordingError
from agents.recorder.mcap_file import RecordedMessage, RecordingWriter
from agents.replay import ReplayedGraph
from dsr.errors import DsrError
from tests.agents.replay.conftest import Studio, state


def test_each_time_has_its_state(counted: Path) -> None:
    graph = ReplayedGraph(counted)
    assert graph.duration == pytest.approx(11.95, abs=0.06)
    for second in (2, 5, 11, 0, 8):
        memory = graph.at(second + 0.5)
        assert memory.node("cube_3")["mass"] == second
        assert memory.edge("world", "cube_3", "Virtual_RT").pose.translation[0] == pytest.approx(0.1 * second)
        assert ("cube_old" in memory) is (second < 4)
        assert ("cube_new" in memory) is (second >= 8)
        assert memory.clock.now() == pytest.approx(graph.index.begin + second + 0.5)


@pytest.mark.parametrize("seed", range(5))
def test_a_leap_to_any_time_gives_what_reading_all_gives(hovering: Path, seed: int) -> None:
    straight, leaping = ReplayedGraph(hovering), ReplayedGraph(hovering)
    times = np.random.default_rng(seed).uniform(0.0, straight.duration, 8)
    expected = {time: state(memory) for time, memory in straight.states(sorted(times))}
    for time in times:
        assert state(leaping.at(time)) == expected[time]


def test_frames_have_a_past(counted: Path) -> None:
    graph = ReplayedGraph(counted)
    memory = graph.at(10.5)
    pose = memory.transform("world", "cube_3", at=graph.index.begin + 9.5, types=("Virtual_RT",))
    assert pose.translation[0] == pytest.approx(0.95)


def test_changes_come_in_order_and_none_is_joined_with_another(counted: Path) -> None:
    masses = []
    for time, changes in ReplayedGraph(counted).changes():
        masses += [time for change in changes if change.name == "cube_3" and "mass" in change.attributes]
    assert masses == pytest.approx(range(12), abs=0.06)


def test_a_recording_cannot_be_written_to(counted: Path) -> None:
    memory = ReplayedGraph(counted).at(5.0)
    with pytest.raises(DsrError, match="cannot be written to"):
        memory.add_node("cube_9", "cube")


@pytest.mark.parametrize("seed", range(25))
def test_a_cut_recording_replays_up_to_the_cut(counted: Path, seed: int) -> None:
    file = counted / "recording.mcap"
    whole = ReplayedGraph(counted)
    expected = {time: state(memory) for time, memory in whole.states(np.arange(0.0, 12.0, 0.5))}
    data = file.read_bytes()
    file.write_bytes(data[: int(np.random.default_rng(seed).integers(3000, len(data)))])
    cut = ReplayedGraph(counted)
    assert cut.problems and "cut off" in cut.problems[0]
    for time in np.arange(0.0, cut.duration, 0.5):
        assert state(cut.at(time)) == expected[time]


@pytest.mark.parametrize("seed", range(60))
def test_a_garbled_recording_never_raises(counted: Path, seed: int) -> None:
    file = counted / "recording.mcap"
    rng = np.random.default_rng(seed)
    data = bytearray(file.read_bytes())
    for position in rng.integers(200, len(data), 5):
        data[position] ^= 1 << int(rng.integers(8))
    file.write_bytes(data)
    try:
        graph = ReplayedGraph(counted)
    except RecordingError:
        return
    for time in rng.uniform(0.0, 12.0, 4):
        graph.at(time)


def test_nonsense_in_a_message_is_counted_and_left_out(tmp_path: Path, studio: Studio) -> None:
    studio.memory.add_node("world", "world")
    good = studio.memory.snapshot()
    writer = RecordingWriter(tmp_path / "a.mcap", {"graph": "../odd name"})
    payloads = [b"", b"\x93\x01", good[:-3], b"\xff" * 40, good]
    for index, payload in enumerate(payloads):
        writer.write(RecordedMessage(10.0 + index, "snapshot", payload))
    writer.write(RecordedMessage(16.0, "d/x-1", b"{}"))
    writer.close()
    graph = ReplayedGraph(tmp_path / "a.mcap")
    assert [node.name for node in graph.at(6.0).nodes()] == ["world"]
    assert graph.malformed == 5 and "snapshot at 0.000 s" in graph.first_malformed


def test_a_segment_after_a_gap_takes_over(tmp_path: Path) -> None:
    first = Studio(tmp_path)
    first.memory.add_node("world", "world")
    first.memory.add_node("table", "table")
    first.run(1.0)
    first.finish()
    second = Studio(tmp_path)
    second.clock.advance(20.0)
    second.memory.add_node("box", "box")
    second.run(1.0)
    second.finish()
    graph = ReplayedGraph(tmp_path)
    assert graph.duration == pytest.approx(20.95, abs=0.11)
    assert {node.name for node in graph.at(10.0).nodes()} == {"world", "table"}
    assert "box" in graph.at(20.9)
    assert "table" in graph.at(0.5)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 a zip", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" + bytes(60)])
def test_what_is_no_recording_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.mcap").write_bytes(content)
    with pytest.raises(RecordingError, match=r"a\.mcap"):
        ReplayedGraph(tmp_path / "a.mcap")


def test_nothing_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no recording in this folder"):
        ReplayedGraph(tmp_path)
    with pytest.raises(RecordingError, match="cannot be read"):
        ReplayedGraph(tmp_path / "nothing.mcap")
