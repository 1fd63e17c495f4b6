"""Writes one intention, once the things that it is about are believed to be somewhere."""

from __future__ import annotations

import msgspec

from dsr.agent import Access, Agent
from dsr.goals import parse_goal
from dsr.intentions import add_intention
from dsr.relations import SURFACES, THINGS, read_relations


class MissionConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is wanted."""

    goal: str = ""
    """Relations, as docs/planning.md describes them; nothing is wanted if empty."""
    maintain: bool = False
    """Whether the goal is watched after it was reached, and pursued again when it no longer holds."""
    priority: int = 0
    """Greater is more urgent."""
    delay: float = 0.0
    """s between everything being believed and the intention"""


class Mission(Agent):
    """Says what is wanted. How that goes is the planner's: see the intention's `status`.

    After a restart it finds its intention by the goal's text, and does not write it again.
    """

    name = "mission"
    rate_hz = 5.0
    reads = Access(
        nodes=("intention", *THINGS, *SURFACES),
        edges=("Virtual_RT", "on", "grasping"),
        attributes=("goal", "present"),
    )
    writes = Access(nodes=("mind", "intention"), edges=("has",), attributes=("goal", "maintain", "priority", "status"))
    Config = MissionConfig
    config: MissionConfig

    def setup(self) -> None:
        """Read the goal. Raises `GoalError` for a text that is none."""
        self._goal = parse_goal(self.config.goal) if self.config.goal.strip() else None
        self._told = self._goal is None
        self._since: float | None = None

    def tick(self, now: float) -> None:
        """Write the intention when it is time."""
        if self._told or self._goal is None:
            return
        relations = read_relations(self.memory)
        if not relations.things | relations.tables >= set(self._goal.things):
            self._since = None
            return
        self._since = now if self._since is None else self._since
        if now - self._since >= self.config.delay:
            self._tell()

    def _tell(self) -> None:
        self._told = True
        config, memory = self.config, self.memory
        if any(node.get("goal") == config.goal for node in memory.nodes("intention")):
            return
        name = add_intention(memory, config.goal, maintain=config.maintain, priority=config.priority)
        self.log.info("%s: %s", name, config.goal)
