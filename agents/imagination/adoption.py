"""Makes the plan that was adopted in a world beside the base what the robot intends."""

from __future__ import annotations

from agents.imagination.agent import ADOPTED, PREFIX
from dsr.agent import Access, Agent
from dsr.errors import DsrError
from dsr.vocabulary.intentions import add_intention
from dsr.worlds import ROOT


class Adoption(Agent):
    """Writes an intention with the `goal` of each world `plan_<name>` that is marked as adopted, once."""

    name = "adoption"
    rate_hz = 5.0
    reads = Access(nodes=(ROOT, "intention"), attributes=("status", "goal"))
    writes = Access(nodes=("mind", "intention"), edges=("has",), attributes=("goal", "maintain", "priority", "status"))

    def setup(self) -> None:
        """Nothing was adopted yet."""
        self._taken: set[str] = set()

    def tick(self, now: float) -> None:
        """Look at the worlds of plans."""
        for info in self.memory.worlds():
            if info.name.startswith(PREFIX) and info.name not in self._taken:
                self._look(info.name)

    def _look(self, name: str) -> None:
        try:
            root = self.memory.world(name).get_node(ROOT)
        except DsrError:  # it is gone at this moment, or not complete yet
            return
        if root is None or root.get("status") != ADOPTED:
            return
        self._taken.add(name)
        goal = root.get("goal", "")
        if goal and all(node.get("goal") != goal for node in self.memory.nodes("intention")):
            self.log.info("%s: %s", add_intention(self.memory, goal), goal)
