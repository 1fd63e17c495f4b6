"""Which nodes are which true objects, where nobody could know their names: those that were found by depth."""

from __future__ import annotations

import math
from collections.abc import Mapping

from agents.scenario.format.model import Scenario
from agents.scenario.format.units import Size
from agents.scenario.judge.found_forms import alike
from dsr.frames.tree import WORLD
from dsr.graph.elements import Node
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.vocabulary.perceived import BY_DEPTH
from dsr.vocabulary.relations import THINGS

NEAREST = 0.05
"""m from the true object, within which a node must first be seen to be this object: less than blocks are apart"""


class FoundNames:
    """The names of nodes for those of a scenario's objects.

    A node that was found by depth is, from when it first has a place, the object that truly is there. It stays that
    object: a node that goes over to another object is wrong from then on.

    Args:
        scenario: with the true objects.
        memory: only read.
    """

    def __init__(self, scenario: Scenario, memory: Memory) -> None:
        self._memory = memory
        self._specs = {spec.name: spec for spec in scenario.objects if spec.by_depth}
        self._free = set(self._specs)
        self._objects: dict[str, str] = {}
        self._nodes: dict[str, str] = {}

    def node(self, name: str) -> str:
        """The node of an object: of its own name, unless another one was found to be it."""
        return self._nodes.get(name, name)

    def object(self, node: str) -> str:
        """The object of a node: of its own name, unless it was found to be another one."""
        return self._objects.get(node, node)

    def as_true(
        self, poses: Mapping[str, Pose], nodes: Mapping[str, Node], truth: Mapping[str, Pose]
    ) -> tuple[dict[str, Pose], dict[str, Size]]:
        """Poses by object with the axes of found blocks named as those of the true objects, and the blocks' extents.

        Args:
            poses: of the objects, percepts or beliefs.
            nodes: theirs.
            truth: where the objects truly are.
        """
        named, sizes = dict(poses), dict[str, Size]()
        for name in self._nodes.keys() & poses.keys() & truth.keys():
            if (size := nodes[name].get("size")) is not None:
                named[name], sizes[name] = alike(self._specs[name], size, poses[name], truth[name])
        return named, sizes

    def update(self, truth: Mapping[str, Pose]) -> None:
        """Look for nodes of objects that have none, given where the objects truly are."""
        nodes = self._memory.nodes(THINGS) if self._free else []
        for node in nodes:
            if node.name in self._objects or node.get("source") != BY_DEPTH:
                continue
            pose = self._memory.get_transform(WORLD, node.name)
            apart = {
                name: math.inf if pose is None else pose.distance(truth[name])[0] for name in self._free & set(truth)
            }
            best = min(sorted(apart), key=lambda name: apart[name], default=None)
            if best is not None and apart[best] < NEAREST:
                self._objects[node.name], self._nodes[best] = best, node.name
                self._free.remove(best)
