"""Shows what one camera sees in a window of rerun, without a working memory."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Self

import rerun as rr

from agents.viewer.blueprint import APPLICATION
from agents.viewer.window import ViewerWindow
from dsr.images.blobs import Frame

_MEMORY = "500MB"
"""What the window may use until it forgets the oldest pictures: some seconds of colour and depth"""
_QUALITY = 80
"""Of JPEG, 1 to 100, as the viewer's own images"""


class CameraWindow:
    """A window, a context manager that closes it; also without one, for a recording of somebody's.

    Args:
        name: of the camera.
        recording: where pictures go to; None for a window on this machine.

    Raises:
        WindowError: if there is no display, or no viewer.
    """

    def __init__(self, name: str, recording: rr.RecordingStream | None = None) -> None:
        self._name = name
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._window: ViewerWindow | None = None
        if recording is None:
            self._folder = tempfile.TemporaryDirectory(prefix="dsr-drivers-", ignore_cleanup_errors=True)
            recording = rr.RecordingStream(APPLICATION)
            try:
                self._window = ViewerWindow(Path(self._folder.name) / "window.log", _MEMORY)
            except BaseException:
                self._folder.cleanup()
                raise
            recording.connect_grpc(self._window.url)
        self._recording = recording

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def closed(self) -> bool:
        """Whether somebody has closed the window."""
        return self._window is not None and self._window.exit_code is not None

    def show(self, frame: Frame) -> None:
        """Show the images of a frame; other arrays are left out."""
        self._recording.set_time("stamp", timestamp=frame.stamp)
        color, depth = frame.arrays.get("color"), frame.arrays.get("depth")
        if color is not None and color.ndim == 3:
            self._recording.log(f"{self._name}/color", rr.Image(color).compress(jpeg_quality=_QUALITY))
        if depth is not None and depth.ndim == 2:
            self._recording.log(f"{self._name}/depth", rr.DepthImage(depth, meter=1.0))

    def close(self) -> None:
        """Close the window; harmless when repeated."""
        if self._window is not None:
            self._recording.disconnect()
            self._window.close()
        if self._folder is not None:
            self._folder.cleanup()
