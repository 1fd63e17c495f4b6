"""The window of one camera: what it is sent, and that it says so where there is no display."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rerun as rr

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
