"""The viewer: shows the graph, the scene, images, numbers and events in rerun, and records them."""

from __future__ import annotations

import contextlib
import threading
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from agents.inbox import Inbox
from agents.viewer.config import ViewerConfig
from agents.viewer.files import ViewFiles
from agents.viewer.window import ServedView, ViewerWindow, WindowError
from dsr.agent import Access, Agent
from dsr.files.private_files import FOLDER_MODE
from dsr.network.keys import ALL
from dsr.vocabulary.replayed import replayed_key
from dsr.vocabulary.scenario_start import start_key

if TYPE_CHECKING:
    import rerun as rr

_MOST_WAITING = 2_000
_PATIENCE = 2.0  # s for the end of the recording to reach the window or the server
_PIECES = 1.0
"""s of the view that are written together where nobody looks: a file takes half as much as with rerun's 0.2 s"""
_PAUSE = 0.05  # s, half a tick, in which the next file has begun unless a window hangs


class Viewer(Agent):
    """Shows the content of the working memory; writes nothing to it, and holds nobody up."""

    name = "viewer"
    rate_hz = 10.0
    libraries = ("rerun",)
    reads: ClassVar[Access] = Access(nodes=("*",), edges=("*",), attributes=("*",))
    interest = (ALL,)
    Config = ViewerConfig
    config: ViewerConfig

    def setup(self) -> None:
        """Open the file, and the window if one is wanted, and begin to listen."""
        self._resources = contextlib.ExitStack()
        self._window: ViewerWindow | ServedView | None = None
        self._files = ViewFiles(Path(self.config.folder), self.config.keep_mb)
        from agents.viewer.views import AllViews  # takes half a second, for which a launcher need not wait

        self._recording = self._open()
        self._views = AllViews(self._recording, self.memory, self.config, self.log)
        self._elapsed = self._views.elapsed
        self._switching: threading.Thread | None = None
        self._looks_from: float | None = None
        self._watch = self.memory.watch()
        keys = (self.keys.log(), self.keys.status(), self.keys.truth(), start_key(self.keys), replayed_key(self.keys))
        self._inboxes = [Inbox(self.bus, key, self.clock, _MOST_WAITING) for key in keys]
        self._logs, self._statuses, self._truths, self._starts, self._replayed = self._inboxes
        for close in (self._views.close, self._watch.close, *(inbox.close for inbox in self._inboxes)):
            self._resources.callback(close)

    def tick(self, now: float) -> None:
        """Show what is new."""
        for message in self._starts.take():
            self._elapsed.note_start(message)
        for message in self._replayed.take()[-1:]:
            self._elapsed.note_replayed(message)
        if not self._looks(now):
            return
        is_another = self._begins_file(now)
        now = self._elapsed.now(now)
        self._elapsed.set(now)
        if is_another:
            self._views.begin_anew()
        self._views.arrange()
        self._views.draw_messages(self._truths.take(), self._statuses.take(), self._logs.take())
        self._views.draw(self._watch.poll(), now)
        self._check_window()

    def _begins_file(self, now: float) -> bool:
        """Whether the next file has begun, since the one before is full.

        A window that hangs must have all that went before: until then, the full file goes on, and so does the agent.
        """
        if self._switching is None:
            if not self._files.is_full(now):
                return False
            sinks = self._sinks()
            self._switching = threading.Thread(target=self._recording.set_sinks, args=sinks, daemon=True)
            self._switching.start()
        self._switching.join(_PAUSE)
        if self._switching.is_alive():
            return False
        self._switching = None
        return True

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
        import rerun as rr

        from agents.viewer.blueprint import APPLICATION

        config, folder = self.config, Path(self.config.folder)
        folder.mkdir(mode=FOLDER_MODE, parents=True, exist_ok=True)
        is_watched = config.spawn or config.serve
        recording = rr.RecordingStream(
            APPLICATION,
            recording_id=f"{self.keys.graph} {folder.resolve().name}",
            batcher_config=None if is_watched else rr.ChunkBatcherConfig(flush_tick=_PIECES),
        )
        ending = threading.Thread(target=recording.disconnect, daemon=True)
        self._resources.callback(_await, ending)  # after the end of a window that held it up
        try:
            self._window = self._open_window(folder / "window.log")
        except WindowError as error:
            if not config.record:
                raise
            self.log.warning("no window (%s); only the file is written", error)
        self._resources.callback(_end_soon, ending)
        recording.set_sinks(*self._sinks())
        return recording

    def _sinks(self) -> list[rr.FileSink | rr.GrpcSink]:
        """Where the recording goes from now on: the next file, and the window or the server, as wanted."""
        import rerun as rr

        sinks: list[rr.FileSink | rr.GrpcSink] = []
        if self.config.record:
            path = self._files.begin()
            sinks.append(rr.FileSink(path))
            self.log.info("recording to %s", path)
        if self._window is not None:
            sinks.append(rr.GrpcSink(self._window.url))
        return sinks

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
