"""Infers for a person which unseen thing is in which seen container, and moves it along with that."""

from __future__ import annotations

from dsr.graph.elements import Node
from dsr.math3d.surfaces import Solids
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.spatial import Box, box_at
from dsr.visibility import shape_of_thing

_HOLLOW = ("container", "cup")
"""Types of nodes that are hollow if they do not tell their parts."""


def covers(memory: Memory, container: Node, there: Pose, thing: Node, where: Pose) -> bool:
    """Whether the middle of a thing that is `where` is within a larger, hollow one that is `there`, either way up."""
    if not _is_hollow(container):
        return False
    around, inner = box_at(memory, container, there), box_at(memory, thing, where)
    if around is None or inner is None or inner.diagonal >= around.diagonal:
        return False
    middle = around.pose.inverse().apply(inner.pose.translation)
    return all(abs(along) <= 0.5 * edge for along, edge in zip(middle, around.size, strict=True))


def carried(container: Node, before: Pose, after: Pose, content: Pose) -> Pose | None:
    """Where something comes to be that is in a container which moves from one pose (in the world) to another.

    On the bottom of the container it goes along as it is. What is only covered is pushed over its support, and None
    once the cover is above its middle: then it has stayed behind.
    """
    shape, size = shape_of_thing(container), container.get("size")
    goal = after @ before.inverse() @ content
    if not shape or size is None:
        return goal
    below = content.translation - (0.0, 0.0, Box(before, size).diagonal)
    inside = before.inverse()
    if Solids.of(shape).cut_off(inside.apply(content.translation), inside.apply(below)[None]).any():
        return goal
    if Box(after, size).bottom > content.t[2]:
        return None
    return Pose((goal.t[0], goal.t[1], content.t[2]), goal.q)


def _is_hollow(container: Node) -> bool:
    """Whether there is room in its middle."""
    if "shape" not in container:
        return container.type in _HOLLOW
    shape = shape_of_thing(container) or ()
    return shape != () and not any(part.contains((0.0, 0.0, 0.0)) for part in shape)
