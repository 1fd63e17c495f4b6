"""All views of the viewer on one recording, and its arrangement. It loads rerun, which only who draws needs."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence

import rerun as rr

from agents.inbox import Message
from agents.viewer.blueprint import make_blueprint
from agents.viewer.calibrations import CalibrationView
from agents.viewer.chronicle import ChronicleView
from agents.viewer.config import ViewerConfig
from agents.viewer.elapsed import Elapsed
from agents.viewer.events import EventView
from agents.viewer.framing import Focus, Framing
from agents.viewer.graph_view import GraphView
from agents.viewer.images import ImageView
from agents.viewer.mind import MindView
from agents.viewer.model import read_scene
from agents.viewer.scene import MeshView, PersonView, SceneView
from agents.viewer.series import SeriesView
from agents.viewer.told import ToldView
from agents.viewer.topology_view import TopologyView
from dsr.graph.watch import Change
from dsr.memory import Memory


class AllViews:
    """Draws a working memory, and what agents say beside it.

    Args:
        recording: gets all that is drawn.
        memory: the world that is shown.
        config: of the viewer.
        log: of the viewer.
    """

    def __init__(
        self, recording: rr.RecordingStream, memory: Memory, config: ViewerConfig, log: logging.Logger
    ) -> None:
        self.elapsed = Elapsed(recording, config.awaits_start, log)
        self.images = ImageView(recording, memory, config.images_hz, config.jpeg_quality, log)
        self.series = SeriesView(recording, log)
        self.events = EventView(recording, self.elapsed, log)
        self._recording = recording
        self._memory = memory
        self._framing = Framing()
        self._known: list[Change] = []
        self._begin()

    def begin_anew(self) -> None:
        """Draw all that is there once more, as the next file needs it. Events are lines, and not told again."""
        self._begin()
        self.images.begin_anew()
        self.series.begin_anew()
        with self._memory.watch() as everything:
            self._known = everything.poll()

    def _begin(self) -> None:
        """Make the views that draw only what has changed."""
        recording, memory = self._recording, self._memory
        self._graph = GraphView(recording)
        self._topology = TopologyView(recording)
        self._scene = SceneView(recording)
        self._meshes = MeshView(recording, memory)
        self._persons = PersonView(recording)
        self._mind = MindView(recording, self.elapsed)
        self._told = ToldView(recording)
        self._chronicle = ChronicleView(recording, self.elapsed)
        self._calibrations = CalibrationView(recording)
        self._arranged: tuple[list[str], bool, Focus] | None = None

    def arrange(self) -> None:
        """Send the blueprint: at first, and when there is more to arrange."""
        content = (self.images.cameras, self.series.knows_truth, self._framing.focus)
        if content != self._arranged:
            self._arranged = content
            self._recording.send_blueprint(make_blueprint(*content))

    def draw_messages(self, truths: Sequence[Message], statuses: Iterable[Message], logs: Iterable[Message]) -> None:
        """Draw what was heard since the last time."""
        for message in truths[-1:]:
            self.series.note_truth(message)
        for message in statuses:
            self.series.draw_status(message)
            self._topology.note_status(message)
        for message in logs:
            self.events.draw_record(message)

    def draw(self, changes: Sequence[Change], now: float) -> None:
        """Draw the memory as it is at time `now` (s), after these changes."""
        memory = self._memory
        self.events.draw_changes(changes, memory, now)
        changes, self._known = [*self._known, *changes], []
        self._chronicle.draw(changes, memory, now)
        self._graph.draw(memory, changes, now)
        self._topology.draw(memory)
        self._mind.draw(memory)
        self._told.draw(memory, now)
        scene = read_scene(memory)
        self._framing.note(scene.beliefs, scene.tables)
        self._scene.draw(scene, now, self._meshes.draw(changes))
        self._persons.draw(memory)
        self._calibrations.draw(changes, memory, scene.cameras, now)
        self.images.draw(scene.cameras, now)
        self.series.draw_distances(scene)

    def close(self) -> None:
        """Listen to cameras no longer."""
        self.images.close()
        self.events.close()
