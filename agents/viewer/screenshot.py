"""Takes a picture of the rerun view of a recording, without a display.

    python -m agents.viewer.screenshot runs/.../recording.rrd docs/images/demo.png

It needs a Vulkan driver; the one of Mesa that runs on any CPU will do, on Debian and Ubuntu:
`apt-get install mesa-vulkan-drivers libvulkan1 libxkbcommon-x11-0 libegl1 libgl1-mesa-dri`.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from rerun.experimental import ViewerClient

from agents.viewer.blueprint import APPLICATION, make_graph_blueprint
from agents.viewer.elapsed import ELAPSED
from agents.viewer.window import free_port, native_viewer, private_environment, viewer_url
from dsr import DsrError
from dsr.clock import WALL_CLOCK

T = TypeVar("T")

_PATIENCE = 60.0  # s for each step
_PERIOD = 1.5  # s between two looks
_TOP_BAR = 36  # px, buttons and warnings of the viewer


class ScreenshotError(DsrError):
    """No picture could be taken."""


def take_screenshot(
    recording: Path, picture: Path, size: str = "1600x1000", seconds: float | None = None, *, graph: bool = False
) -> None:
    """Write what the viewer shows of `recording` to `picture`, once all of it is loaded and drawn.

    Args:
        recording: an `.rrd` file.
        picture: a `.png` file.
        size: of the viewer in px; the picture lacks its top bar.
        seconds: as the story of the run counts them; None for the end of the recording.
        graph: show nothing but the graph.

    Raises:
        ScreenshotError: if the viewer cannot show the recording, or the picture cannot be written.
    """
    if not recording.is_file():
        raise ScreenshotError(f"{recording}: no such file")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = [recording]
        if graph:
            files.append(folder / "graph.rbl")
            make_graph_blueprint().save(APPLICATION, files[-1])
        png = _draw(files, folder / "log", size, seconds)
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    if image is None or not cv2.imwrite(str(picture), image[_TOP_BAR:]):
        raise ScreenshotError(f"{picture}: cannot be written")


def _draw(files: Sequence[Path], log_file: Path, size: str, seconds: float | None) -> bytes:
    """The picture as PNG."""
    with _HeadlessViewer(files, size, log_file) as viewer:
        client = viewer.wait_for("it answers", lambda: _connect(viewer.url))
        viewer.wait_for("the recording is loaded", lambda: _is_loaded(client))
        if seconds is not None:
            client.set_time(ELAPSED, duration=seconds, play_state="paused")
        pictures = [b"", b""]

        def still() -> bytes | None:
            with contextlib.suppress(TimeoutError):  # on a busy machine, drawing takes longer than the client waits
                pictures[:] = pictures[1], client.take_screenshot()
            return pictures[1] if pictures[0] == pictures[1] != b"" else None

        return viewer.wait_for("the picture is still", still)


def _connect(url: str) -> ViewerClient | None:
    try:
        return ViewerClient.connect(url)
    except ConnectionError:
        return None


def _is_loaded(client: ViewerClient) -> bool | None:
    """True once there is something; None before."""
    timelines = [line for recording in client.get_state().recordings for line in recording.timelines]
    return any(line.name == ELAPSED and line.start is not None for line in timelines) or None


class _HeadlessViewer:
    """A viewer without a window that shows files; a context manager that ends it."""

    def __init__(self, files: Sequence[Path], size: str, log_file: Path) -> None:
        port = free_port()
        self.url = viewer_url(port)
        self._log_file = log_file
        where = ["--bind", "127.0.0.1", "--port", str(port)]
        with log_file.open("wb") as log:
            self._process = subprocess.Popen(
                [native_viewer(), *files, "--headless", *where, "--window-size", size],
                env={"WGPU_BACKEND": "vulkan", **private_environment(os.environ, log_file.parent)},
                stdout=log,
                stderr=subprocess.STDOUT,
            )

    def __enter__(self) -> _HeadlessViewer:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()

    def wait_for(self, what: str, look: Callable[[], T | None]) -> T:
        """Look now and then until something is there. Raises `ScreenshotError` if it never is."""
        for _ in range(int(_PATIENCE / _PERIOD)):
            WALL_CLOCK.wait(threading.Event(), _PERIOD)
            if self._process.poll() is not None:
                said = self._log_file.read_text(errors="replace")
                raise ScreenshotError(f"the viewer ended before {what}:\n{said[-2000:]}")
            found = look()
            if found is not None:
                return found
        raise ScreenshotError(f"the viewer was given up before {what}")


def run(arguments: Sequence[str] | None = None) -> int:
    """The command; returns its exit code."""
    parser = argparse.ArgumentParser("python -m agents.viewer.screenshot", description="Take a picture of a recording.")
    parser.add_argument("recording", type=Path, help="an .rrd file")
    parser.add_argument("picture", type=Path, help="the .png file to write")
    parser.add_argument("--size", default="1600x1000", help="of the viewer in px (default %(default)s)")
    parser.add_argument("--at", type=float, help="seconds, as the story of the run counts them (default: the end)")
    parser.add_argument("--graph", action="store_true", help="show nothing but the graph of the working memory")
    options = parser.parse_args(arguments)
    try:
        take_screenshot(options.recording, options.picture, options.size, options.at, graph=options.graph)
    except DsrError as error:
        parser.exit(1, f"{error}\n")
    return 0


if __name__ == "__main__":
    sys.exit(run())
