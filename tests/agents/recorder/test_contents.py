"""`dsr record info`: messages and bytes by channel, duration, and whether a recording was cut."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from agents.recorder import RecordingError
from agents.recorder.cli import app
from agents.recorder.contents import contents_of
from agents.recorder.mcap_file import RecordedMessage, RecordingWriter

NOISE = np.random.default_rng(0).bytes(20_000)


def write(path: Path, begin: float = 1e9) -> None:
    """20 s: a large channel that cannot be compressed, small ones that can, and an agent that was restarted."""
    writer = RecordingWriter(path, {"graph": "tabletop"})
    for index in range(21):
        stamp = begin + index
        writer.write(RecordedMessage(stamp, "blob/camera", NOISE))
        for topic in ("d/planner-1", "d/planner-2", "truth"):
            writer.write(RecordedMessage(stamp, topic, bytes(1000)))
        writer.flush()
    writer.close()


def test_channels_are_summed_up(tmp_path: Path) -> None:
    write(tmp_path / "recording.mcap")
    contents = contents_of(tmp_path)
    assert contents.channels[0].channel == "blob/camera"
    found = {channel.channel: channel for channel in contents.channels}
    assert set(found) == {"blob/camera", "d/planner", "truth"}
    assert found["blob/camera"].messages == 21 and found["blob/camera"].bytes == 21 * len(NOISE)
    assert found["d/planner"].messages == 42 and found["d/planner"].bytes == 42_000
    assert found["blob/camera"].packed > 50 * found["d/planner"].packed
    size = (tmp_path / "recording.mcap").stat().st_size
    assert 0.9 * size < sum(channel.packed for channel in contents.channels) <= size == contents.size
    assert contents.seconds == pytest.approx(20.0)
    assert contents.mb_per_minute == pytest.approx(3 * size / 1e6)
    assert contents.files[0].complete and contents.metadata["graph"] == "tabletop"


def test_several_files_are_one_recording(tmp_path: Path) -> None:
    write(tmp_path / "recording.mcap")
    write(tmp_path / "recording-2.mcap", 1e9 + 30)
    contents = contents_of(tmp_path)
    assert contents.seconds == pytest.approx(50.0)
    assert [report.messages for report in contents.files] == [84, 84]
    assert contents.size == sum(file.stat().st_size for file in tmp_path.iterdir())


def test_a_cut_is_told(tmp_path: Path) -> None:
    write(tmp_path / "recording.mcap")
    data = (tmp_path / "recording.mcap").read_bytes()
    (tmp_path / "recording.mcap").write_bytes(data[: len(data) // 2])
    contents = contents_of(tmp_path)
    assert not contents.files[0].complete and 0 < contents.channels[0].messages < 21
    shown = CliRunner().invoke(app, ["info", str(tmp_path)])
    assert shown.exit_code == 0 and "cut off" in shown.output


def test_the_command_tells_people_and_programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    write(tmp_path / "recording.mcap")
    shown = CliRunner().invoke(app, ["info", str(tmp_path)])
    assert "graph tabletop" in shown.output and "MB a minute" in shown.output
    assert any(line.split()[:2] == ["d/planner", "42"] for line in shown.output.splitlines())
    told = json.loads(CliRunner().invoke(app, ["info", str(tmp_path / "recording.mcap"), "--json"]).output)
    assert told["mb_per_minute"] > 0 and told["channels"][0]["channel"] == "blob/camera"
    assert told["files"][0]["path"].endswith("recording.mcap")


def test_nothing_to_tell_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no recording"):
        contents_of(tmp_path)
    RecordingWriter(tmp_path / "recording.mcap", {}).close()
    with pytest.raises(RecordingError, match="without messages"):
        contents_of(tmp_path)
