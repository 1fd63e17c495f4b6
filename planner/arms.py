"""The arms that a plan can use: where they stand, which of them work, and which one does what."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from dsr.frames.tree import BELIEVED, WORLD
from dsr.graph.elements import Node
from dsr.memory import Memory
from dsr.network.keys import agent_of
from dsr.vocabulary.arms import ARM, arm_nodes, controller_of, gripper_node_of, gripper_of
from dsr.vocabulary.halting import order_about
from dsr.vocabulary.relations import Relations, read_relations
from planner.config import PlannerConfig

Place = tuple[float, float]
"""Position (x, y) in the world, m."""


@dataclass(frozen=True)
class PlannedArm:
    """An arm as the planner knows it."""

    name: str
    agent: str
    """Name of its controller."""
    gripper: str
    """Name of its gripper's node."""
    base: Place = (0.0, 0.0)
    """Where its base stands."""
    trouble: str = ""
    """Why it cannot be used, in words; empty if it can."""

    def reaches(self, place: Place, config: PlannerConfig) -> bool:
        """Whether it can put something there."""
        return config.least_reach <= math.dist(self.base, place) <= config.most_reach


class Arms:
    """The arms of a graph; each call reads them anew.

    A graph with one arm, or with none that is known, has one arm whose controller the configuration names. It is always
    used: whoever plans waits for it.
    """

    def __init__(self, memory: Memory, config: PlannerConfig) -> None:
        self._memory, self._config = memory, config

    def all(self) -> list[PlannedArm]:
        """All arms, the first one first."""
        nodes = arm_nodes(self._memory)
        if len(nodes) < 2:
            name = nodes[0].name if nodes else ARM
            gripper = gripper_node_of(nodes[0]) if nodes else gripper_of(ARM)
            return [PlannedArm(name, self._config.arm_agent, gripper, self._base(self._config.robot))]
        return [self._known(node) for node in nodes]

    def usable(self) -> list[PlannedArm]:
        """Those whose controllers run, and which nobody has halted; all of several arms if that is none."""
        arms = self.all()
        return [arm for arm in arms if not arm.trouble] or arms

    def named(self, name: str) -> PlannedArm:
        """The arm of that name; the first one for an empty name, or for one that is gone."""
        arms = self.all()
        return next((arm for arm in arms if arm.name == name), arms[0])

    def runs(self, arm: PlannedArm) -> bool:
        """Whether its controller runs."""
        return any(agent_of(rid) == arm.agent for rid in self._memory.peers)

    @property
    def is_any_there(self) -> bool:
        """Whether the controller of some arm runs."""
        return any(map(self.runs, self.all()))

    def relations(self) -> Relations:
        """The present relations; what a gripper holds whose arm cannot be used is taken, and not at hand."""
        relations, arms = read_relations(self._memory), self.all()
        if all(arm.trouble for arm in arms):
            return relations
        lost = {arm.gripper for arm in arms if arm.trouble}
        taken = {thing for gripper, thing in relations.grasping if gripper in lost}
        grasping = frozenset(pair for pair in relations.grasping if pair[0] not in lost)
        return replace(relations, grasping=grasping, taken=relations.taken | taken)

    def _known(self, node: Node) -> PlannedArm:
        arm = PlannedArm(node.name, controller_of(node), gripper_node_of(node), self._base(node.name))
        order = order_about(self._memory, node.name)
        if order is not None and order.halted:
            return replace(arm, trouble=order.reason)
        return arm if self.runs(arm) else replace(arm, trouble=f"agent {arm.agent!r} does not run")

    def _base(self, node: str) -> Place:
        pose = self._memory.get_transform(WORLD, node, types=BELIEVED) if node in self._memory else None
        return (0.0, 0.0) if pose is None else (pose.t[0], pose.t[1])


def chosen(arms: Iterable[PlannedArm], places: Sequence[Place], config: PlannerConfig) -> PlannedArm | None:
    """The nearest of several arms to all places of those that reach each; among equally near ones the first by name.

    None if no arm reaches all places.
    """
    able = [arm for arm in arms if all(arm.reaches(place, config) for place in places)]
    ways = [(round(sum(math.dist(arm.base, place) for place in places), 3), arm.name) for arm in able]
    return able[ways.index(min(ways))] if able else None
