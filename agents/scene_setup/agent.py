"""Tells the working memory the robot's prior knowledge: the table, and given objects."""

from __future__ import annotations

from typing import Any

import msgspec

from agents.scenario.format.scenario import ObjectSpec, TableSpec, load_scenario
from dsr.agent import Access, Agent
from dsr.math3d.shapes import to_numbers
from dsr.math3d.transforms import Pose
from dsr.vocabulary.relations import THINGS


class SceneSetupConfig(msgspec.Struct, frozen=True):
    """The scene that is put into the graph."""

    scenario: str = ""
    """Name or file of the scenario that describes it; empty for a table of the usual size with nothing on it."""
    untagged: bool = False
    """Whether it is played without the tags of its boxes and cylinders, of which nothing is known then."""


class SceneSetup(Agent):
    """Adds the table with its pose, and a node for each object marked `known`, without a pose: that is perceived.

    What is there already stays as it is, so that starting again changes nothing.
    """

    name = "scene_setup"
    rate_hz = 1.0
    shares_process = True
    writes = Access(
        nodes=("world", "table", *THINGS),
        edges=("RT",),
        attributes=("size", "shape", "mass", "friction", "rolling_friction", "marker_id", "color", "model"),
    )
    Config = SceneSetupConfig
    config: SceneSetupConfig

    def setup(self) -> None:
        """Write the scene. Raises `ConfigError` for a scenario that cannot be used."""
        table, objects = TableSpec(), list[ObjectSpec]()
        if self.config.scenario:
            scenario = load_scenario(self.config.scenario, without_tags=self.config.untagged)
            table, objects = scenario.table, scenario.objects
        with self.memory.batch():
            self._add("world", "world")
            self._add("table", "table", size=table.size, friction=table.friction)
            if self.memory.get_edge("world", "table", "RT") is None:
                self.memory.add_edge("world", "table", "RT", pose=Pose(table.position))
            for spec in objects:
                if spec.known:
                    self._add(spec.name, spec.type, **_properties(spec))

    def _add(self, name: str, kind: str, **attributes: Any) -> None:
        if name not in self.memory:
            self.memory.add_node(name, kind, **attributes)


def _properties(spec: ObjectSpec) -> dict[str, Any]:
    """Attributes of an object that can be known without seeing it."""
    known: dict[str, Any] = {"size": spec.size, "mass": spec.mass, "friction": spec.friction}
    optional = {"marker_id": spec.marker_id, "color": spec.color, "model": spec.model}
    if spec.rolling_friction:
        known["rolling_friction"] = spec.rolling_friction
    if spec.shape:
        known["shape"] = to_numbers(spec.shape)
    return {**known, **{name: value for name, value in optional.items() if value is not None}}
