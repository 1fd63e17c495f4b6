"""The viewer: shows the graph, the scene, images, numbers and events in rerun, and records them."""

from __future__ import annotations

import contextlib
import math
import threading
from pathlib import Path
from typing import ClassVar

import msgspec
import rerun as rr

from agents.inbox import Inbox
from agents.segments import next_segment
from agents.viewer.blueprint import APPLICATION, make_blueprint
from agents.viewer.calibrations import CalibrationView
from agents.viewer.chronicle import ChronicleView
from agents.viewer.elapsed import Elapsed
from agents.viewer.events import EventView
from agents.viewer.framing import Focus, Framing
from agents.viewer.graph_view import GraphView
from agents.viewer.images import ImageView
from agents.viewer.mind import MindView
from agents.viewer.model import read_scene
from agents.viewer.scene import MeshView, PersonView, SceneView
from agents.viewer.series import SeriesView
from agents.viewer.topology_view import TopologyView
from agents.viewer.window import LOOPBACK, ServedView, ViewerWindow, WindowError
from dsr.agent import Access, Agent
from dsr.files.private_files import FOLDER_MODE
from dsr.vocabulary.replayed import replayed_key
from dsr.vocabulary.scenario_start import start_key

FILE_NAME = "recording.rrd"
_MOST_WAITING = 2_000
_LAST_PORT = 65_535
_PATIENCE = 2.0  # s for the end of the recording to reach the window or the server


class ViewerConfig(msgspec.Struct, frozen=True):
    """Which data the viewer shows, and where."""

    folder: str = "runs/viewer"
    """Gets `recording.rrd`, or `recording-2.rrd` if that exists, and so on."""
    record: bool = True
    """Write the file; without it, nothing is left when the window or the server ends."""
    spawn: bool = False
    """Open the rerun window as well."""
    serve: bool = False
    """Serve the view to browsers and to rerun viewers elsewhere."""
    bind: str = LOOPBACK
    """Address of this machine at which the view is served; `0.0.0.0` for all, which others can reach, too."""
    port: int = 9876
    """TCP port of the served data: the one that rerun's viewers try by themselves."""
    web_port: int = 9090
    """TCP port of the served page: the one that rerun takes by itself."""
    awaits_start: bool = False
    """A scenario will start, from which seconds count. Otherwise they count from the first look."""
    listens: float = 0.0
    """Seconds before the first look, if nobody tells a time 0: for a view of what may run already."""
    images_hz: float = 5.0
    """Camera images a second and camera."""
    jpeg_quality: int = 80
    """JPEG quality of camera images, 1 to 100."""
    memory_limit: str = "1GB"
    """Memory that the window may use until it forgets the oldest data."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.images_hz) and self.images_hz > 0):
            raise ValueError(f"images_hz {self.images_hz}: expected a positive number")
        if not (math.isfinite(self.listens) and self.listens >= 0):
            raise ValueError(f"listens {self.listens}: expected a finite number of seconds, at least 0")
        if not 1 <= self.jpeg_quality <= 100:
            raise ValueError(f"jpeg_quality {self.jpeg_quality}: expected 1 to 100")
        for name in ("port", "web_port"):
            if not 1 <= getattr(self, name) <= _LAST_PORT:
                raise ValueError(f"{name} {getattr(self, name)}: expected 1 to {_LAST_PORT}")
        if self.port == self.web_port:
            raise ValueError(f"port {self.port}: expected another one than web_port")
        if not (self.record or self.spawn or self.serve):
            raise ValueError("record, spawn and serve are all false: nothing would be shown anywhere")


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
        self._window: ViewerWindow | ServedView | None = None
        recording = self._recording = self._open()
        self._elapsed = Elapsed(recording, self.config.awaits_start, self.log)
        self._graph = GraphView(recording)
        self._topology = TopologyView(recording)
        self._scene = SceneView(recording)
        self._meshes = MeshView(recording, self.memory)
        self._persons = PersonView(recording)
        self._mind = MindView(recording, self._elapsed)
        self._chronicle = ChronicleView(recording, self._elapsed)
        self._calibrations = CalibrationView(recording)
        self._images = ImageView(recording, self.memory, self.config.images_hz, self.config.jpeg_quality, self.log)
        self._series = SeriesView(recording, self.log)
        self._events = EventView(recording, self._elapsed, self.log)
        self._resources.callback(self._events.close)
        self._framing = Framing()
        self._looks_from: float | None = None
        self._arranged: tuple[list[str], bool, Focus] | None = None
        self._watch = self.memory.watch()
        keys = (self.keys.log(), self.keys.status(), self.keys.truth(), start_key(self.keys), replayed_key(self.keys))
        self._inboxes = [Inbox(self.bus, key, self.clock, _MOST_WAITING) for key in keys]
        self._logs, self._statuses, self._truths, self._starts, self._replayed = self._inboxes
        for close in (self._images.close, self._watch.close, *(inbox.close for inbox in self._inboxes)):
            self._resources.callback(close)

    def tick(self, now: float) -> None:
        """Show what is new."""
        for message in self._starts.take():
            self._elapsed.note_start(message)
        for message in self._replayed.take()[-1:]:
            self._elapsed.note_replayed(message)
        if not self._looks(now):
            return
        now = self._elapsed.now(now)
        self._elapsed.set(now)
        self._arrange()
        self._draw_messages()
        changes = self._watch.poll()
        self._chronicle.draw(changes, self.memory, now)
        self._events.draw_changes(changes, self.memory, now)
        self._graph.draw(self.memory, changes, now)
        self._topology.draw(self.memory)
        self._mind.draw(self.memory)
        scene = read_scene(self.memory)
        self._framing.note(scene.beliefs, scene.tables)
        self._scene.draw(scene, now, self._meshes.draw(changes))
        self._persons.draw(self.memory)
        self._calibrations.draw(changes, self.memory, scene.cameras, now)
        self._images.draw(scene.cameras, now)
        self._series.draw_distances(scene)
        self._check_window()

    def _looks(self, now: float) -> bool:
        """Whether it is known what the seconds of the view count from, or was listened for long enough."""
        if self._looks_from is None:
            self._looks_from = now + self.config.listens
        return self._elapsed.is_told or now >= self._looks_from

    def teardown(self) -> None:
        """Finish the file and close the window."""
        self._resources.close()

    def _open(self) -> rr.RecordingStream:
        """A recording that goes to the file, the window and the server, as wanted; a restart goes on under its id."""
        config, folder = self.config, Path(self.config.folder)
        folder.mkdir(mode=FOLDER_MODE, parents=True, exist_ok=True)
        recording = rr.RecordingStream(APPLICATION, recording_id=f"{self.keys.graph} {folder.resolve().name}")
        sinks: list[rr.FileSink | rr.GrpcSink] = []
        if config.record:
            path = next_segment(folder, FILE_NAME)
            sinks.append(rr.FileSink(path))
            self.log.info("recording to %s", path)
        ending = threading.Thread(target=recording.disconnect, daemon=True)
        self._resources.callback(_await, ending)  # after the end of a window that held it up
        try:
            self._window = self._open_window(folder / "window.log")
        except WindowError as error:
            if not config.record:
                raise
            self.log.warning("no window (%s); recording to %s only", error, path)
        self._resources.callback(_end_soon, ending)
        if self._window is not None:
            sinks.append(rr.GrpcSink(self._window.url))
        recording.set_sinks(*sinks)
        return recording

    def _open_window(self, log_file: Path) -> ViewerWindow | ServedView | None:
        config = self.config
        if config.serve:
            served = ServedView(
                log_file, config.memory_limit, bind=config.bind, port=config.port, web_port=config.web_port
            )
            return self._resources.enter_context(served)
        if config.spawn:
            return self._resources.enter_context(ViewerWindow(log_file, config.memory_limit))
        return None

    def _arrange(self) -> None:
        """Send the blueprint: at first, and when there is more to arrange."""
        content = (self._images.cameras, self._series.knows_truth, self._framing.focus)
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
            log_file, self._window = self._window.log_file, None
            self.window_closed(log_file)

    def window_closed(self, log_file: Path) -> None:
        """Say that the window or the server ended, whose output is in `log_file`; the recording goes on."""
        self.log.info("the window was closed (see %s); the file goes on", log_file)


def _end_soon(ending: threading.Thread) -> None:
    """Let the window or the server have the end of the recording, but wait for none that hangs."""
    ending.start()
    ending.join(_PATIENCE)


def _await(ending: threading.Thread) -> None:
    """Wait until the file is complete; without a window that was wanted, nothing began."""
    if ending.ident is not None:
        ending.join()
