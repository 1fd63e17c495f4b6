"""Bags of all formats hold the same messages, and damaged ones what is left of them."""

from __future__ import annotations

import bz2
import contextlib
import re
from collections import Counter
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType

from agents.recorder import mcap_file
from agents.recorder.mcap_file import RecordingError
from agents.recorder.opening import is_bag
from agents.replay import ReplayedGraph
from agents.ros_bridge.bags import unpacking
from agents.ros_bridge.bags.reader import Bag
from dsr.errors import ConfigError
from tests.agents.ros_bridge.bags.made import BEGIN, COLOR, DELAY, FORMATS, TYPES, Message, drive, mcap, rosbag2

DRIVE = drive()


@pytest.mark.parametrize("format", FORMATS)
def test_all_formats_hold_the_same_messages(format: str, tmp_path: Path) -> None:
    path = FORMATS[format](tmp_path, DRIVE)
    assert is_bag(path)
    bag = Bag(path, TYPES)
    assert {topic.name: topic.messages for topic in bag.topics.values()} == Counter(one.topic for one in DRIVE)
    assert not any(topic.complaint for topic in bag.topics.values()) and not bag.problems
    assert bag.begin == pytest.approx(BEGIN, abs=1e-6) and bag.end == pytest.approx(DRIVE[-1].time, abs=1e-6)
    read = list(bag.messages(bag.topics))
    assert sorted((round(m.time, 6), m.topic) for m in read) == sorted((round(m.time, 6), m.topic) for m in DRIVE)
    assert [one.time for one in read] == sorted(one.time for one in read)
    written = {(round(one.time, 6), one.topic): one for one in DRIVE}
    for one in read:
        type = bag.topics[one.topic].type
        found, expected = (TYPES.decode(type, cdr) for cdr in (one.cdr, written[round(one.time, 6), one.topic].cdr))
        assert repr(found) == repr(expected)
    images = list(bag.messages([COLOR], since=BEGIN + 2.0))
    assert [round(one.time - BEGIN - DELAY, 6) for one in images] == pytest.approx(np.arange(2.0, 4.0, 0.1))


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4, CompressionType.NONE])
@pytest.mark.parametrize("chunks", [True, False])
def test_an_mcap_file_that_was_never_closed_is_read_up_to_its_cut(
    tmp_path: Path, compression: CompressionType, chunks: bool
) -> None:
    whole = mcap(tmp_path / "whole.mcap", DRIVE, compression, chunks=chunks).read_bytes()
    for part, share in enumerate((0.3, 0.8)):
        cut = tmp_path / f"{part}.mcap"
        cut.write_bytes(whole[: int(share * len(whole))])
        bag = Bag(cut, TYPES)
        assert "never closed or cut off" in bag.problems[0]
        read = list(bag.messages(bag.topics))
        assert [(round(one.time, 6), one.topic, one.cdr) for one in read] == [
            (round(time, 6), topic, cdr) for time, topic, _, cdr in DRIVE[: len(read)]
        ]
        assert len(read) > (share - 0.25) * len(DRIVE)


def test_a_folder_whose_recorder_was_killed_has_no_metadata_and_is_read(tmp_path: Path) -> None:
    folder = rosbag2(tmp_path / "drive", DRIVE)
    (folder / "metadata.yaml").unlink()
    file = folder / "drive.mcap"
    file.write_bytes(file.read_bytes()[:-5000])
    assert is_bag(folder)
    bag = Bag(folder, TYPES)
    assert bag.problems and 0 < len(list(bag.messages(bag.topics))) <= len(DRIVE)


def test_a_damaged_piece_costs_only_itself(tmp_path: Path) -> None:
    path = mcap(tmp_path / "drive.mcap", DRIVE, CompressionType.ZSTD)
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 50] = bytes(50)
    path.write_bytes(data)
    bag = Bag(path, TYPES)
    read = list(bag.messages(bag.topics))
    assert "is damaged" in bag.problems[0]
    assert 0.9 * len(DRIVE) < len(read) < len(DRIVE)
    assert read[-1].time == pytest.approx(DRIVE[-1].time, abs=1e-6)


@pytest.mark.parametrize(
    "format", ["mcap file, zstd", "mcap file, lz4", "mcap file without chunks", "db3 file", "ROS 1"]
)
def test_whatever_is_damaged_bags_are_read_or_refused(format: str, tmp_path: Path) -> None:
    path = FORMATS[format](tmp_path, DRIVE[:120])
    whole, random = path.read_bytes(), np.random.default_rng(7)
    read = 0
    for _ in range(40):
        data = bytearray(whole)
        for _ in range(random.integers(1, 6)):
            at = int(random.integers(len(data)))
            change = random.integers(3)
            if change == 0:
                data[at : at + 8] = random.bytes(8)
            elif change == 1:
                del data[at : at + int(random.integers(1, 200))]
            else:
                data[at:at] = random.bytes(int(random.integers(1, 100)))
        path.write_bytes(data)
        with contextlib.suppress(RecordingError):
            bag = Bag(path, TYPES)
            read += bool(sum(1 for _ in bag.messages(bag.topics)))
            ReplayedGraph(path).at(1.0)
    assert read or not format.startswith("mcap")


@pytest.mark.parametrize(
    ("format", "said"),
    [("ROS 1", "rosbag reindex"), ("db3 file", "cannot be read as a bag"), ("mcap file, zstd", "without messages")],
)
def test_what_is_cut_too_early_is_told(format: str, said: str, tmp_path: Path) -> None:
    path = FORMATS[format](tmp_path, DRIVE)
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(RecordingError, match=said):
        Bag(path, TYPES)


PACKED = {
    "zstd": (unpacking.from_zstd, zstandard.compress),
    "zstd without its size": (
        unpacking.from_zstd, lambda data: zstandard.ZstdCompressor(write_content_size=False).compress(data)
    ),
    "zstd in two frames": (
        unpacking.from_zstd, lambda data: zstandard.compress(data[:10]) + zstandard.compress(data[10:])
    ),
    "lz4": (unpacking.from_lz4, lz4.frame.compress),
    "bz2": (unpacking.from_bz2, bz2.compress),
}  # fmt: skip


@pytest.mark.parametrize("name", PACKED)
def test_no_more_is_unpacked_than_is_allowed(name: str) -> None:
    unpack, pack = PACKED[name]
    data = bytes(5_000_000)
    packed = pack(data)
    assert len(packed) < len(data) / 100 and unpack(packed, len(data)) == data
    with pytest.raises(RecordingError, match="more than 4999999 bytes is not unpacked"):
        unpack(packed, len(data) - 1)


@pytest.mark.parametrize("name", ["zstd", "lz4", "bz2"])
def test_what_is_cut_off_is_refused(name: str) -> None:
    unpack, pack = PACKED[name]
    with pytest.raises(RecordingError, match="cut off"):
        unpack(pack(np.random.default_rng(1).bytes(300_000))[:-1000], 300_000)


@pytest.mark.parametrize("format", [name for name in FORMATS if any(part in name for part in ("zstd", "lz4", "bz2"))])
def test_a_bag_that_would_unpack_to_too_much_is_told(
    format: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`rosbags` itself has no bound: a few kB of zeros fill any memory, or a disk."""
    path = FORMATS[format](tmp_path, DRIVE)
    for module in (unpacking, mcap_file):
        monkeypatch.setattr(module, "LARGEST_CHUNK", 100)
    monkeypatch.setattr(unpacking, "_DISK_SHARE", 1e-9)
    try:
        bag = Bag(path, TYPES)
        list(bag.messages(bag.topics))
        said = "; ".join(bag.problems)
    except RecordingError as error:
        said = str(error)
    assert re.search("not unpacked|at most 100|half of the free space", said), said


def test_there_is_no_bag(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no such file"):
        Bag(tmp_path / "nothing.mcap", TYPES)
    assert not is_bag(tmp_path / "nothing.mcap") and not is_bag(tmp_path)


def test_topics_that_are_not_there_or_cannot_be_read_are_told(tmp_path: Path) -> None:
    strange = [
        Message(BEGIN, "/strange", "my_msgs/msg/Own", b"\0\1\0\0" + bytes(4)),
        Message(BEGIN, "/note", "std_msgs/msg/String", DRIVE[-1].cdr),
    ]
    bag = Bag(mcap(tmp_path / "a.mcap", strange, CompressionType.NONE), TYPES)
    with pytest.raises(ConfigError, match="no topic /nots; there are /note, /strange"):
        bag.topic("/nots")
    with pytest.raises(ConfigError, match=r"/strange \(my_msgs/msg/Own\) cannot be read: its type is not known"):
        bag.topic("/strange")
    assert bag.topic("/note").messages == 1


def test_a_type_of_the_same_name_with_other_fields_is_not_taken_for_ours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(TYPES, "definition", lambda type: "float64 degrees\nstring who\n")
    message = Message(BEGIN, "/joints", "sensor_msgs/msg/JointState", b"")
    path = mcap(tmp_path / "a.mcap", [message], CompressionType.NONE)
    monkeypatch.undo()
    assert Bag(path, TYPES).topics["/joints"].complaint == "its type has other fields than ours"
