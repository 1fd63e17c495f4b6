"""Reports the motion of a node: `status` and, where something is wrong, `explanation`."""

from __future__ import annotations

import logging
import math

from dsr import Memory

IDLE = "idle"
MOVING = "moving"
REACHED = "reached"
UNREACHABLE = "unreachable"
STOPPED = "stopped"
NO_DRIVER = "no_driver"
ACTING = "acting"
REFUSED = "refused"
FORBIDDEN = "halted"

PATIENCE = 1.0
"""s that something may stand still short of its target before it counts as stopped"""


class NodeReport:
    """Writes the status of one node when it changes; failures are logged, too."""

    def __init__(self, memory: Memory, node: str, log: logging.Logger) -> None:
        self._memory = memory
        self._node = node
        self._log = log
        self.status = ""

    def say(self, status: str, explanation: str = "") -> None:
        """The node's condition from now on."""
        self.status = status
        node = self._memory.get_node(self._node)
        if node is None:
            return
        if explanation:
            self._log.warning("%s %s: %s", self._node, status, explanation)
        wanted = {"status": status, "explanation": explanation}
        if changed := {name: text for name, text in wanted.items() if node.get(name, "") != text}:
            self._memory.update_node(self._node, **changed)


class StallDetector:
    """Notices when something that should move has stood still for `PATIENCE` s."""

    def __init__(self) -> None:
        self._since = math.inf

    def reset(self) -> None:
        """Forget the progress of the last motion, because a new one begins."""
        self._since = math.inf

    def is_stalled(self, moving: bool, now: float) -> bool:
        """Tell whether it is `moving` at time `now` (s)."""
        self._since = math.inf if moving else min(self._since, now)
        return now - self._since > PATIENCE
