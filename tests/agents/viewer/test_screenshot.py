"""Pictures of recordings: what cannot be shown is said."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

from agents.viewer import screenshot


@pytest.fixture
def recording(stage: Any, tmp_path: Path) -> Path:
    stage.start_viewer()
    stage.run(0.5)
    stage.finish()
    return tmp_path / "recording.rrd"


def test_a_missing_recording_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        screenshot.run([str(tmp_path / "none.rrd"), str(tmp_path / "a.png")])
    assert ended.value.code == 1
    assert "none.rrd: no such file" in capsys.readouterr().err


def test_a_viewer_that_fails_is_quoted(recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake = tmp_path / "rerun"
    fake.write_text(f"#!{sys.executable}\nraise SystemExit('no graphics adapter')")
    fake.chmod(0o755)
    monkeypatch.setattr(screenshot, "native_viewer", lambda: fake)
    monkeypatch.setattr(screenshot, "_PERIOD", 0.2)
    with pytest.raises(screenshot.ScreenshotError, match="no graphics adapter"):
        screenshot.take_screenshot(recording, tmp_path / "a.png")
    assert not (tmp_path / "a.png").exists()


def test_a_viewer_that_hangs_is_given_up(recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake = tmp_path / "rerun"
    fake.write_text("#!/bin/sh\nexec sleep 1000")
    fake.chmod(0o755)
    monkeypatch.setattr(screenshot, "native_viewer", lambda: fake)
    monkeypatch.setattr(screenshot, "_PERIOD", 0.2)
    monkeypatch.setattr(screenshot, "_PATIENCE", 0.6)
    with pytest.raises(screenshot.ScreenshotError, match="before it answers"):
        screenshot.take_screenshot(recording, tmp_path / "a.png")
