"""Nodes of frames that ROS names: how many are made, and which nodes of the memory no frame may be."""

from __future__ import annotations

from agents.ros_bridge.errors import RosMessageError
from dsr.frames.tree import WORLD
from dsr.graph.schema import SCHEMA_RECORD, WORLD_RECORD
from dsr.memory import Memory

MOST_FRAMES = 4000
"""Frames of ROS: more than any robot has; a node that makes up names does not fill the graph"""
_NOWHERE = (
    "mind", "intention", "action", "agent", "timeline", "event", "situation", "summary", "query",
    "calibration", WORLD_RECORD, SCHEMA_RECORD,
)  # fmt: skip
"""Types of nodes that are nowhere in space"""


class FrameNodes:
    """Makes the nodes of frames in a memory."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._made = 0

    def ensure(self, name: str, type: str = "body") -> None:
        """Let there be a node of this name.

        Raises:
            RosMessageError: for a node that is nowhere in space, or if there are too many frames.
        """
        node = self._memory.get_node(name)
        if node is not None:
            if node.type in _NOWHERE:
                raise RosMessageError(f"the node {name!r} is of type {node.type!r}, which is nowhere in space")
            return
        if self._made >= MOST_FRAMES:
            raise RosMessageError(f"more than {MOST_FRAMES} frames: no node is made for {name!r}")
        self._memory.add_node(name, "world" if name == WORLD else type)
        self._made += 1
