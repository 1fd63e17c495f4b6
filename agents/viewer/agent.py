"""The viewer: shows the graph, the scene, images, numbers and events in rerun, and records them."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from typing import ClassVar

import msgspec
import rerun as rr

from agents.inbox import Inbox
from agents.segments import next_segment
from agents.viewer.blueprint import TIMELINE, make_blueprint
from agents.viewer.calibrations import CalibrationView
from agents.viewer.chronicle import ChronicleView
from agents.viewer.events import EventView
from agents.viewer.graph_view import GraphView
from agents.viewer.images import ImageView
from agents.viewer.mind import MindView
from agents.viewer.model import read_scene
from agents.viewer.scene import MeshView, PersonView, SceneView
from agents.viewer.series import SeriesView
from agents.viewer.topology_view import TopologyView
from agents.viewer.window import ViewerWindow, WindowError
from dsr.agent import Access, Agent

FILE_NAME = "recording.rrd"
_APPLICATION = "dsr"
_MOST_WAITING = 2_000


class ViewerConfig(msgspec.Struct, frozen=True):
    """Which data the viewer shows, and where."""

    folder: str = "runs/viewer"
    """Gets `recording.rrd`, or `recording-2.rrd` if that exists, and so on."""
    spawn: bool = False
    """Open the rerun window as well."""
    images_hz: float = 5.0
    """Camera images a second and camera."""
    jpeg_quality: int = 80
    """JPEG quality of camera images, 1 to 100."""
    memory_limit: str = "1GB"
    """Memory that the window may use until it forgets the oldest data."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.images_hz) and self.images_hz > 0):
            raise ValueError(f"images_hz {self.images_hz}: expected a positive number")
        if not 1 <= self.jpeg_quality <= 100:
            raise ValueError(f"jpeg_quality {self.jpeg_quality}: expected 1 to 100")


class Viewer(Agent):
    """Shows the content of the working memory; writes nothing to it, and holds nobody up."""

    name = "viewer"
    rate_hz = 10.0
    reads: ClassVar[Access] = Access(nodes=("*",), edges=("*",), attributes=("*",))
    Config = ViewerConfig
    config: ViewerConfig

    def setup(self) -> None:
        """Open the file, and the window if one is wanted, and begin to listen."""
        self._resources = contextlib.ExitStack()
        self._window: ViewerWindow | None = None
        recording = self._recording = self._open()
        self._graph = GraphView(recording)
        self._topology = TopologyView(recording)
        self._scene = SceneView(recording)
        self._meshes = MeshView(recording, self.memory)
        self._persons = PersonView(recording)
        self._mind = MindView(recording)
        self._chronicle = ChronicleView(recording, TIMELINE)
        self._calibrations = CalibrationView(recording)
        self._images = ImageView(recording, self.memory, self.config.images_hz, self.config.jpeg_quality, self.log)
        self._series = SeriesView(recording, self.log)
        self._events = EventView(recording, self.log)
        self._arranged: tuple[list[str], bool] | None = None
        self._watch = self.memory.watch()
        keys = (self.keys.log(), self.keys.status(), self.keys.truth())
        self._logs, self._statuses, self._truths = (Inbox(self.bus, key, self.clock, _MOST_WAITING) for key in keys)
        for part in (self._images, self._watch, self._logs, self._statuses, self._truths):
            self._resources.callback(part.close)

    def tick(self, now: float) -> None:
        """Show what is new."""
        self._recording.set_time(TIMELINE, timestamp=now)
        self._arrange()
        self._draw_messages()
        changes = self._watch.poll()
        self._chronicle.draw(changes, self.memory, now)
        self._events.draw_changes(changes, self.memory, now)
        if any(change.kind != "updated" for change in changes):
            self._graph.draw(self.memory)
        self._topology.draw(self.memory)
        self._mind.draw(self.memory)
        scene = read_scene(self.memory)
        self._scene.draw(scene, now, self._meshes.draw(changes))
        self._persons.draw(self.memory)
        self._calibrations.draw(changes, self.memory, scene.cameras, now)
        self._images.draw(scene.cameras, now)
        self._series.draw_distances(scene)
        self._check_window()

    def teardown(self) -> None:
        """Finish the file and close the window."""
        self._resources.close()

    def _open(self) -> rr.RecordingStream:
        """A recording that goes to the file, and to the window if one opens; a restart goes on under the same id."""
        folder = Path(self.config.folder)
        path = next_segment(folder, FILE_NAME)
        recording = rr.RecordingStream(_APPLICATION, recording_id=f"{self.keys.graph} {folder.resolve().name}")
        self._resources.callback(recording.disconnect)  # after the window is closed: one that hangs would hold it up
        sinks: list[rr.FileSink | rr.GrpcSink] = [rr.FileSink(path)]
        if self.config.spawn:
            try:
                self._window = self._resources.enter_context(
                    ViewerWindow(folder / "window.log", self.config.memory_limit)
                )
                sinks.append(rr.GrpcSink(self._window.url))
            except WindowError as error:
                self.log.warning("no window (%s); recording to %s only", error, path)
        recording.set_sinks(*sinks)
        self.log.info("recording to %s", path)
        return recording

    def _arrange(self) -> None:
        """Send the blueprint: at first, and when there is more to arrange."""
        content = (self._images.cameras, self._series.knows_truth)
        if content != self._arranged:
            self._arranged = content
            self._recording.send_blueprint(make_blueprint(*content))

    def _draw_messages(self) -> None:
        for message in self._truths.take()[-1:]:
            self._series.note_truth(message)
        for message in self._statuses.take():
            self._series.draw_status(message)
            self._topology.note_status(message)
        for message in self._logs.take():
            self._events.draw_record(message)

    def _check_window(self) -> None:
        if self._window is not None and self._window.exit_code is not None:
            self.log.info("the window was closed (see %s); the file goes on", self._window.log_file)
            self._window = None
