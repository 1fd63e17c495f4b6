"""A table with a cube and a cup, a person on each side, and the perspective filter at work on it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from agents.perspectives import Perspectives, Visibility
from dsr import Memory, Pose
from dsr.math3d.shapes import Part, to_numbers
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec

TURNED = (0.0, 0.0, 1.0, 0.0)
COVER = to_numbers(
    (
        Part("box", (0.1, 0.1, 0.004), (0.0, 0.0, 0.038)),
        Part("box", (0.004, 0.1, 0.08), (0.048, 0.0, 0.0)),
        Part("box", (0.004, 0.1, 0.08), (-0.048, 0.0, 0.0)),
        Part("box", (0.1, 0.004, 0.08), (0.0, 0.048, 0.0)),
        Part("box", (0.1, 0.004, 0.08), (0.0, -0.048, 0.0)),
    )
)
"""An open box upside down."""


class Table:
    """The scene, which the test sets, and the worlds that come of it."""

    def __init__(self, **config: Any) -> None:
        agents = [AgentSpec("perspectives", Perspectives, config), AgentSpec("visibility", Visibility)]
        self.lockstep = Lockstep(agents, strict=True)
        self.memory: Memory = self.lockstep.memory
        self.memory.add_node("world", "world")
        self.memory.add_node("table", "table", size=(1.6, 1.2, 0.04))
        self.put("table", Pose())

    def add(self, name: str, kind: str, pose: Pose, **attributes: Any) -> None:
        """Something new, somewhere."""
        self.memory.add_node(name, kind, **attributes)
        self.put(name, pose)

    def put(self, name: str, pose: Pose) -> None:
        """Something elsewhere."""
        self.memory.add_edge("world", name, "RT", pose=pose)

    def come(self, name: str, pose: Pose) -> None:
        """A person."""
        if name not in self.memory:
            self.memory.add_node(name, "person")
        self.memory.update_node(name, perceived=True)
        self.put(name, pose)

    def leave(self, name: str) -> None:
        """A person is not there any more."""
        self.memory.update_node(name, perceived=False)

    def run(self, seconds: float = 0.6) -> None:
        """Let time pass."""
        self.lockstep.run_for(seconds)

    def view(self, person: str) -> Memory:
        """The world of a person."""
        return self.memory.world(f"view_of_{person}")

    def place(self, person: str, thing: str) -> tuple[float, ...] | None:
        """Where a person takes a thing to be, mm; None for nowhere."""
        edge = self.view(person).get_edge("world", thing, "RT")
        return None if edge is None else tuple(round(1e3 * number) for number in edge.pose.t)


@pytest.fixture
def table() -> Iterator[Table]:
    """Two persons, a cube and a high wall between the second one and the cube."""
    found = Table()
    found.add("cube", "cube", Pose((0.1, 0.0, 0.02)), size=(0.04, 0.04, 0.04))
    found.add("wall", "box", Pose((0.0, 0.0, 0.1)), size=(0.02, 0.3, 0.2))
    found.come("human_1", Pose((0.8, 0.0, 0.4), TURNED))
    found.come("human_2", Pose((-0.8, 0.0, 0.1)))
    yield found
    found.lockstep.close()
