"""A running graph in which all names are long, for commands to look into, and commands run in this process."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

import dsr
from dsr import Memory, Pose
from dsr.cli.main import app

CUBE, TABLE = "cube_of_many_colours_that_nobody_has_ever_seen_before_3", "the_table_on_the_left_side_of_the_room"
CAMERA = "camera_above_the_table_on_the_left_side_of_the_room"
WORLD = "what_would_be_if_the_cube_of_many_colours_were_gone"
AGENT = "the_estimator_of_everything_on_the_left_table"


@pytest.fixture(autouse=True)
def private_runtime_dir(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Tests meet nobody but themselves, and leave nothing elsewhere."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))
    monkeypatch.chdir(tmp_path)
    for name in ("DSR_SECURITY", "DSR_GRAPH", "COLUMNS", "NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    return tmp_path


@pytest.fixture
def memory() -> Iterator[Memory]:
    """A cube on a table below a camera; another world in which it is elsewhere."""
    with dsr.connect("graph_of_the_whole_room_with_everything_in_it", agent=AGENT) as memory:
        memory.add_node("world", "world")
        memory.add_node(TABLE, "table", size=(1.2, 1.2, 0.04))
        memory.add_node(CAMERA, "camera", fx=600.0, fy=600.0, cx=320.0, cy=240.0, width=640, height=480)
        memory.add_node(CUBE, "cube", perceived=True, surprising=True, size=(0.04, 0.04, 0.04), explanation="käse ☃")
        memory.add_edge("world", TABLE, "RT", pose=Pose((0.0, 0.0, -0.02)))
        memory.add_edge("world", CAMERA, "RT", pose=Pose((0.4, 0.0, 0.7), (1.0, 0.0, 0.0, 0.0)))
        memory.add_edge(CAMERA, CUBE, "RT", pose=Pose((0.0, 0.0, 0.67)))
        memory.add_edge("world", CUBE, "Virtual_RT", pose=Pose((0.4, 0.0, 0.02)))
        memory.add_edge(CUBE, TABLE, "on", source="contact")
        idea = memory.fork(WORLD)
        idea.update_edge("world", CUBE, "Virtual_RT", pose=Pose((0.4, 0.3, 0.02)))
        idea.update_node(CUBE, mass=0.1)
        yield memory


@pytest.fixture
def cli() -> Callable[..., str]:
    """Runs a command in this process; returns what it printed. The exit code may be 1: what was asked does not hold."""

    def run(*arguments: str) -> str:
        result = CliRunner().invoke(app, list(arguments), catch_exceptions=False)
        assert result.exit_code in (0, 1), result.output
        return result.output

    return run
