"""Recordings survive what happens to files: cut anywhere, damaged, killed writers."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from agents.recorder.mcap_file import RecordedMessage, RecordingError, RecordingWriter
from agents.recorder.reader import FILE_NAME, read_recording

RECORDS = [RecordedMessage(1e9 + 0.01 * i, f"d/writer-{i % 3}", bytes([i % 256]) * (i % 50)) for i in range(200)]
FLUSH_EVERY = 20


def write(path: Path, records: list[RecordedMessage] = RECORDS) -> None:
    writer = RecordingWriter(path, {"graph": "tabletop"})
    for index, record in enumerate(records, start=1):
        writer.write(record)
        if index % FLUSH_EVERY == 0:
            writer.flush()
    writer.close()


def close(a: RecordedMessage, b: RecordedMessage) -> bool:
    return abs(a.stamp - b.stamp) < 1e-6 and a[1:] == b[1:]


def test_what_was_written_is_read(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap")
    recording = read_recording(tmp_path / "a.mcap")
    found = list(recording)
    assert len(found) == len(RECORDS)
    assert all(map(close, found, RECORDS))
    (report,) = recording.reports
    assert report.complete and report.messages == 200 and report.seconds == pytest.approx(1.99)
    assert recording.metadata["graph"] == "tabletop"


@pytest.mark.parametrize("seed", range(30))
def test_a_cut_file_gives_a_prefix_and_says_so(tmp_path: Path, seed: int) -> None:
    write(tmp_path / "a.mcap")
    data = (tmp_path / "a.mcap").read_bytes()
    cut = int(np.random.default_rng(seed).integers(0, len(data)))
    (tmp_path / "a.mcap").write_bytes(data[:cut])
    recording = read_recording(tmp_path / "a.mcap")
    found = list(recording)
    assert len(found) % FLUSH_EVERY == 0
    assert all(map(close, found, RECORDS))
    assert not recording.reports[0].complete
    assert "recovered; never closed or cut off" in str(recording.reports[0])


def test_a_cut_loses_only_what_was_not_flushed(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "a.mcap", {})
    for record in RECORDS[:100]:
        writer.write(record)
    writer.flush()
    flushed = (tmp_path / "a.mcap").read_bytes()
    for record in RECORDS[100:]:
        writer.write(record)
    writer.close()
    (tmp_path / "a.mcap").write_bytes(flushed)
    recording = read_recording(tmp_path / "a.mcap")
    assert len(list(recording)) == 100
    assert str(len(flushed)) in str(recording.reports[0])


@pytest.mark.parametrize("seed", range(40))
def test_a_flipped_bit_never_raises_and_never_changes_a_message(tmp_path: Path, seed: int) -> None:
    write(tmp_path / "a.mcap")
    data = bytearray((tmp_path / "a.mcap").read_bytes())
    position = int(np.random.default_rng(seed).integers(100, len(data)))
    data[position] ^= 1 << seed % 8
    (tmp_path / "a.mcap").write_bytes(data)
    known = {record.payload + record.topic.encode() for record in RECORDS}
    found = list(read_recording(tmp_path / "a.mcap"))
    assert all(record.payload + record.topic.encode() in known for record in found)


def test_a_damaged_chunk_costs_only_itself(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap")
    data = (tmp_path / "a.mcap").read_bytes()
    magic = b"\x28\xb5\x2f\xfd"  # zstd frames, one a chunk
    third = data.index(magic, data.index(magic, data.index(magic) + 1) + 1)
    (tmp_path / "a.mcap").write_bytes(data[: third + 20] + bytes([data[third + 20] ^ 255]) + data[third + 21 :])
    recording = read_recording(tmp_path / "a.mcap")
    assert len(list(recording)) == len(RECORDS) - FLUSH_EVERY
    assert "damaged" in str(recording.reports[0])


@pytest.mark.parametrize("content", [b"PK\x03\x04 a zip", b"hello", b"\x89MCAP1\r\n" + bytes(50)])
def test_another_file_is_refused_by_name(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "photo.zip").write_bytes(content)
    with pytest.raises(RecordingError, match=r"photo\.zip: no MCAP file"):
        read_recording(tmp_path / "photo.zip")


def test_an_mcap_file_of_somebody_else_is_refused(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap")
    data = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "a.mcap").write_bytes(data.replace(b"\x03\x00\x00\x00dsr\x03", b"\x03\x00\x00\x00ros\x03", 1))
    with pytest.raises(RecordingError, match="profile 'ros'"):
        list(read_recording(tmp_path / "a.mcap"))


def test_what_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot be read"):
        read_recording(tmp_path / "none.mcap")
    with pytest.raises(RecordingError, match=FILE_NAME):
        read_recording(tmp_path)


def test_segments_of_a_folder_are_read_in_order(tmp_path: Path) -> None:
    for number, part in enumerate(("", "-2", "-10"), start=1):
        record = RecordedMessage(float(number), "truth", bytes([number]))
        write(tmp_path / f"recording{part}.mcap", [record])
    (tmp_path / "recording-old.mcap").write_bytes(b"not one of them")
    recording = read_recording(tmp_path)
    assert [record.payload for record in recording] == [b"\1", b"\2", b"\3"]
    assert [record.payload for record in recording] == [b"\1", b"\2", b"\3"]
    assert [report.path.name for report in recording.reports] == [
        "recording.mcap",
        "recording-2.mcap",
        "recording-10.mcap",
    ]


def test_a_killed_writer_leaves_what_it_flushed(tmp_path: Path) -> None:
    script = textwrap.dedent("""
        import pathlib, sys
        from agents.recorder.mcap_file import RecordedMessage, RecordingWriter
        writer = RecordingWriter(pathlib.Path(sys.argv[1]), {})
        number = 0
        while True:
            writer.write(RecordedMessage(float(number), "d/x", str(number).encode() * 100))
            number += 1
            if number % 50 == 0:
                writer.flush()
                print(number, flush=True)
    """)
    command = [sys.executable, "-c", script, str(tmp_path / "a.mcap")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[3]) as process:
        assert process.stdout is not None
        flushed = [int(process.stdout.readline()) for _ in range(20)][-1]
        os.kill(process.pid, signal.SIGKILL)
    recording = read_recording(tmp_path / "a.mcap")
    found = list(recording)
    assert len(found) >= flushed
    assert [record.payload for record in found] == [str(number).encode() * 100 for number in range(len(found))]
    assert not recording.reports[0].complete
    assert recording.reports[0].problems


def test_an_unknown_topic_is_refused(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "a.mcap", {})
    with pytest.raises(ValueError, match="'nonsense/arm'"):
        writer.write(RecordedMessage(0.0, "nonsense/arm", b""))
    writer.close()
