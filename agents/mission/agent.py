"""Writes one intention at the start of a run."""

from __future__ import annotations

import msgspec

from dsr.agent import Access, Agent
from dsr.vocabulary.goals import parse_goal
from dsr.vocabulary.intentions import ACTIVE, add_intention, nobody_pursues


class MissionConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The goal of the mission, and when it is written."""

    goal: str = ""
    """Relations, as docs/how-to/planning.md describes them; nothing is wanted if empty."""
    maintain: bool = False
    """Whether the goal is watched after it was reached, and pursued again when it no longer holds."""
    priority: int = 0
    """Greater is more urgent."""
    delay: float = 0.0
    """s between the first tick and the intention"""


class Mission(Agent):
    """Writes an intention. Its progress is the planner's: see the intention's `status`.

    After a restart it finds its intention by the goal's text, and does not write it again. Its own status says if
    there is no planner.
    """

    name = "mission"
    rate_hz = 5.0
    shares_process = True
    reads = Access(nodes=("intention",), attributes=("goal", "status"))
    writes = Access(nodes=("mind", "intention"), edges=("has",), attributes=("goal", "maintain", "priority", "status"))
    Config = MissionConfig
    config: MissionConfig

    def setup(self) -> None:
        """Read the goal. Raises `GoalError` for a text that is none."""
        if self.config.goal.strip():
            parse_goal(self.config.goal)
        self._told = not self.config.goal.strip()
        self._began: float | None = None

    def tick(self, now: float) -> None:
        """Write the intention when it is time, and look whether anybody pursues it."""
        self._began = now if self._began is None else self._began
        if not self._told and now - self._began >= self.config.delay:
            self._tell()
        self.degraded = nobody_pursues(self.memory) if self._is_wanted() else ""

    def _is_wanted(self) -> bool:
        nodes = self.memory.nodes("intention")
        return any(node.get("goal") == self.config.goal and node.get("status") in ACTIVE for node in nodes)

    def _tell(self) -> None:
        self._told = True
        config, memory = self.config, self.memory
        if any(node.get("goal") == config.goal for node in memory.nodes("intention")):
            return
        name = add_intention(memory, config.goal, maintain=config.maintain, priority=config.priority)
        self.log.info("%s: %s", name, config.goal)
