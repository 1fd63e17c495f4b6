"""A writer and a viewer on one network in memory, and the recording read back."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from rerun.chunk import RrdReader

from agents.viewer.agent import Viewer
from dsr import LocalNetwork, ManualClock, Memory, Pose
from dsr.agent import make_agent
from dsr.network.keys import Keys


class Stage:
    """Steps a writer and a viewer together on a manual clock."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.keys = Keys("tabletop")
        self.clock = ManualClock()
        self.network = LocalNetwork(self.clock)
        self.memory = self._connect("writer")
        self.viewer: Viewer | None = None

    def _connect(self, name: str) -> Memory:
        return Memory("tabletop", name, transport=self.network.connect(name), clock=self.clock)

    def start_viewer(self, **config: Any) -> Viewer:
        memory = self._connect("viewer")
        viewer = make_agent(
            Viewer,
            name="viewer",
            config={"folder": str(self.folder), **config},
            bus=memory.transport,
            keys=self.keys,
            clock=self.clock,
            memory=memory,
        )
        assert isinstance(viewer, Viewer)
        viewer.setup()
        self.viewer = viewer
        return viewer

    def run(self, seconds: float = 1.0) -> None:
        memories = [self.memory] + ([self.viewer.memory] if self.viewer else [])
        for _ in range(round(seconds * 10)):
            for memory in memories:
                memory.poll()
                memory.flush()
            self.network.deliver()
            for memory in memories:
                memory.poll()
            if self.viewer:
                self.viewer.tick(self.clock.now())
            self.clock.advance(0.1)

    def finish(self) -> Shown:
        assert self.viewer is not None
        self.viewer.teardown()
        return Shown(self.folder / "recording.rrd")

    def build_table(self, *cubes: str) -> None:
        """A world with a table, a camera and cubes that are perceived 10 mm too high and believed to rest."""
        memory = self.memory
        for name, kind in (("world", "world"), ("table", "table"), ("camera", "camera")):
            memory.add_node(name, kind)
        memory.update_node("table", size=(1.0, 0.8, 0.04))
        memory.update_node("camera", fx=600.0, fy=600.0, cx=319.5, cy=239.5, width=640, height=480)
        memory.add_edge("world", "table", "RT", pose=Pose())
        memory.add_edge("world", "camera", "RT", pose=Pose((0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0)))
        for index, name in enumerate(cubes):
            memory.add_node(name, "cube", size=(0.04, 0.04, 0.04), perceived=True)
            memory.add_edge("camera", name, "RT", pose=Pose((0.1 * index, 0.0, 0.97), (1.0, 0.0, 0.0, 0.0)))
            memory.add_edge("world", name, "Virtual_RT", pose=Pose((0.1 * index, 0.0, 0.02)))


class Shown:
    """What a recording shows."""

    def __init__(self, path: Path) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a file that was not finished has no index
            reader = RrdReader(path)
            self.blueprints = len(reader.blueprints())
            self._chunks = list(reader.stream())

    @property
    def entities(self) -> set[str]:
        return {chunk.entity_path for chunk in self._chunks}

    def values(self, entity: str, component: str) -> list[Any]:
        """The logged values of a component, in the order of time."""
        rows = []
        for chunk in self._chunks:
            batch = chunk.to_record_batch()
            if chunk.entity_path == entity and component in batch.schema.names:
                times = [0] * chunk.num_rows if chunk.is_static else batch.column("stamp").cast("int64").to_pylist()
                rows += zip(times, batch.column(component).to_pylist(), strict=True)
        return [value for _, value in sorted(rows, key=lambda row: row[0]) if value is not None]

    def times(self, entity: str) -> list[float]:
        """Seconds of the rows of an entity in their order, as the story of the run counts them."""
        chunks = [chunk.to_record_batch() for chunk in self._chunks if chunk.entity_path == entity]
        return sorted(time / 1e9 for chunk in chunks for time in chunk.column("elapsed").cast("int64").to_pylist())

    def texts(self, entity: str = "/log/graph") -> list[str]:
        """Lines of the event log without their times."""
        return [value[0].strip().partition("  ")[2] for value in self.values(entity, "TextLog:text")]


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[Stage]:
    stage = Stage(tmp_path)
    yield stage
    if stage.viewer is not None:
        stage.viewer.teardown()


@pytest.fixture
def shown() -> Callable[[Path], Shown]:
    return Shown
