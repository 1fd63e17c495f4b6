"""From the belief to the graph: believed poses, relations from contact, plausibility; only what changed."""

from __future__ import annotations

import contextlib

from dsr.errors import GraphError
from dsr.memory import Memory
from dsr.transforms import Pose
from simulation_handler.belief import Belief
from simulation_handler.reading import CONTACT, WORLD

_REFRESH = 1.0  # s after which a pose is written again, unchanged
_SHIFT = 5e-5  # m that a body must have moved since its pose was written
_TURN = 5e-4  # rad, likewise


class Writing:
    """Keeps the graph in step with a belief."""

    def __init__(self, memory: Memory, belief: Belief) -> None:
        self._memory = memory
        self._belief = belief
        self._written: dict[str, Pose] = {}

    def update(self, now: float) -> None:
        """Write what changed up to time `now` (s). A node that is gone meanwhile is left out."""
        if WORLD not in self._memory:
            return
        self._written = {name: pose for name, pose in self._written.items() if name in self._belief}
        for name in self._belief.names:
            with contextlib.suppress(GraphError):
                self._write_pose(name, now)
                self._write_plausible(name)
        self._write_supports()

    def _write_pose(self, name: str, now: float) -> None:
        pose = self._belief.pose(name)
        if pose is not None and self._is_news(name, pose, now):
            self._memory.add_edge(WORLD, name, "Virtual_RT", pose=pose)
            self._written[name] = pose

    def _is_news(self, name: str, pose: Pose, now: float) -> bool:
        written = self._written.get(name)
        if written is None or now - written.stamp >= _REFRESH:
            return True
        metres, radians = written.distance(pose)
        return metres > _SHIFT or radians > _TURN

    def _write_plausible(self, name: str) -> None:
        plausible = self._belief.plausible(name)
        if self._belief.pose(name) is not None and self._memory.node(name).get("plausible") is not plausible:
            self._memory.update_node(name, plausible=plausible)

    def _write_supports(self) -> None:
        """Let the relations `on` whose source is contact be those of the belief."""
        supports = self._belief.supports()
        for edge in self._memory.edges("on"):
            if edge.get("source") == CONTACT and (edge.src, edge.dst) not in supports:
                self._memory.remove_edge(edge.src, edge.dst, "on")
        for (name, support), since in supports.items():
            written = self._memory.get_edge(name, support, "on")
            if written is None or written.get("source") != CONTACT or written.get("since") != since:
                with contextlib.suppress(GraphError):
                    self._memory.add_edge(name, support, "on", source=CONTACT, since=since)
