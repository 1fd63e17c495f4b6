"""The window of one camera: what it is sent, and that it says so where there is no display."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr

from agents.viewer import window as viewer_window
from agents.viewer.camera_window import CameraWindow
from agents.viewer.window import WindowError
from dsr import Frame


def test_color_and_depth_are_sent(tmp_path: Path) -> None:
    file = tmp_path / "seen.rrd"
    recording = rr.RecordingStream("test")
    recording.save(file)
    with CameraWindow("cam", recording) as window:
        window.show(Frame(1.0, {"color": np.zeros((4, 6, 3), np.uint8), "depth": np.ones((4, 6), np.float32)}, {}))
        window.show(Frame(2.0, {"color": np.zeros((4, 6, 3), np.uint8)}, {}))
        window.show(Frame(3.0, {"strange": np.zeros(4, np.uint8)}, {}))
        assert not window.closed
    recording.disconnect()
    data = file.read_bytes()
    assert b"/cam/color" in data and b"/cam/depth" in data


def test_without_a_display_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(WindowError, match="no display"):
        CameraWindow("cam")


def test_a_window_takes_pictures_and_leaves_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The viewer itself, without a display."""
    monkeypatch.setattr(viewer_window, "has_display", lambda *_: True)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    start = viewer_window._RerunProcess.__init__

    def headless(self: Any, options: list[str], log_file: Path, listens: Any) -> None:
        start(self, [*options, "--headless"], log_file, listens)

    monkeypatch.setattr(viewer_window._RerunProcess, "__init__", headless)
    with CameraWindow("cam") as window:
        for number in range(5):
            window.show(Frame(float(number), {"color": np.full((48, 64, 3), 40 * number, np.uint8)}, {}))
        assert not window.closed and list(tmp_path.iterdir())
    assert window.closed and list(tmp_path.iterdir()) == []
