"""Whether somebody perceives a thing or a hand now, and whether a camera stands still enough for that.

What writes `perceived` may have died since, and then nobody takes it back.
"""

from __future__ import annotations

import math

from dsr.graph.elements import Node
from dsr.graph.shares import shared_out
from dsr.memory import Memory
from dsr.vocabulary.relations import nodes_by_name

BY_DEPTH = "depth"
"""Attribute `source` of things that were found by their shape alone, in depth images."""
MOST_SILENT = 1.0
"""s since `last_seen`, from which what a node says of being perceived counts no more: longer than writers wait."""
MOST_AHEAD = 0.5
"""s that a stamp may be ahead of this machine's clock: more than clocks in step differ by"""
MOST_CAMERAS = 64
"""Cameras at one time that are looked at: whoever may make their nodes could make any number."""
MOST_HANDS = 16
"""Human hands at one time that are looked at."""
MOST_PERSONS = 64
"""Persons at one time that are looked at."""

CAMERA_SPEED = 0.02
"""m/s up to which a camera counts as at rest: what it shows while it moves faster is not used."""
CAMERA_TURN = 0.05
"""rad/s likewise"""


def camera_nodes(memory: Memory) -> list[Node]:
    """The cameras of a graph, by name; of too many as many of each agent's."""
    return shared_out(nodes_by_name(memory, "camera"), MOST_CAMERAS)


def is_perceived(node: Node, now: float) -> bool:
    """Whether a node's `perceived` is not false, and its `last_seen`, if it has one, not too old at `now` (s)."""
    return node.get("perceived") is not False and seconds_unseen(node, now) <= MOST_SILENT


def seconds_unseen(node: Node, now: float) -> float:
    """S from `last_seen` to `now` (s); 0 if the node does not say when that was.

    What was last seen at a time to come, by a clock that was wrong, was never seen: it is unseen for an infinite time.
    """
    last_seen: float = node.get("last_seen", now)
    return now - last_seen if last_seen <= now + MOST_AHEAD else math.inf
