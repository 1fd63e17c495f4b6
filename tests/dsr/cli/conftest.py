"""A running graph for the commands to look into."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from typer.testing import CliRunner

import dsr
from dsr import Memory, Pose
from dsr.cli.common import console
from dsr.cli.main import app


@pytest.fixture
def memory() -> Iterator[Memory]:
    """A graph "scene": a camera sees a cube that is believed to lie 10 mm lower, on a table."""
    with dsr.connect("scene", agent="owner") as memory:
        memory.add_node("world", "world")
        memory.add_node("table", "table", size=(1.2, 1.2, 0.04))
        memory.add_node("camera_overhead", "camera", fx=600.0)
        memory.add_node("cube_3", "cube", perceived=True, size=(0.04, 0.04, 0.04))
        memory.add_edge("world", "table", "RT", pose=Pose())
        memory.add_edge("world", "camera_overhead", "RT", pose=Pose((0.4, 0.0, 0.7), (1.0, 0.0, 0.0, 0.0)))
        memory.add_edge("camera_overhead", "cube_3", "RT", pose=Pose((0.0, 0.0, 0.67)))
        memory.add_edge("world", "cube_3", "Virtual_RT", pose=Pose((0.4, 0.0, 0.02)))
        memory.add_edge("cube_3", "table", "on", source="contact")
        yield memory


@pytest.fixture
def cli(monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """Runs a command in this process; returns what it printed."""
    monkeypatch.setattr(console, "width", 160)

    def run(*arguments: str) -> str:
        result = CliRunner().invoke(app, list(arguments), catch_exceptions=False)
        assert result.exit_code == 0, result.output
        return result.output

    return run


@pytest.fixture
def cli_json(cli: Callable[..., str]) -> Callable[..., Any]:
    """Runs a command with --json; returns what it printed, parsed."""
    return lambda *arguments: json.loads(cli(*arguments, "--json"))
