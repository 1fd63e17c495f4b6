"""Missions that came from ROS and have ended: removed after a while, so that the graph does not grow with them."""

from __future__ import annotations

import math

from agents.ros_bridge.bridge.core import BridgeCore
from dsr.vocabulary.intentions import GIVEN_UP, REACHED

_LOOK = 1.0
"""s between two looks"""
_OVER = (REACHED, *GIVEN_UP)
"""Statuses after which nothing follows by itself; the planner removes what was reached sooner, if it runs"""


class EndedMissions:
    """Removes intentions that a bridge of this name has written, now or in an earlier life.

    Args:
        core: of the bridge.
        keep: s for which one stays after its end.
    """

    def __init__(self, core: BridgeCore, keep: float) -> None:
        self._core, self._keep = core, keep
        self._since: dict[str, float] = {}
        """s, our monotonic time when each was first seen at its end"""
        self._looked = -math.inf

    def update(self) -> None:
        """Look once a second."""
        now, memory = self._core.clock.monotonic(), self._core.memory
        if now - self._looked < _LOOK:
            return
        self._looked = now
        over = [
            node.name
            for node in memory.nodes("intention")
            if node.get("status") in _OVER and self._core.came_from_ros(node, "goal")
        ]
        self._since = {name: self._since.get(name, now) for name in over}
        for name, since in self._since.items():
            if now - since > self._keep:
                memory.remove_node(name)
                self._core.tally.count("missions removed")
