"""Tells what is behind, in front of, left or right of a thing, as the robot's camera or somebody else sees it."""

from __future__ import annotations

from collections.abc import Iterable

from dsr.errors import ConfigError
from dsr.frames.tree import BELIEVED, WORLD
from dsr.graph.elements import Node
from dsr.math3d.transforms import Pose
from dsr.narration.naming import is_robot, node_of
from dsr.narration.statements import Moment
from dsr.spatial import Box, Fact, Scene, View, read_scene, read_view
from dsr.visibility import CAMERA, PERSON

SIDES = {"behind": "behind", "front": "in_front_of", "left": "left_of", "right": "right_of"}
"""Relations of questions that depend on who looks, with their names in `dsr.spatial`."""
SIDE_WORDS = {"behind": "behind", "front": "in front of", "left": "left of", "right": "right of"}
"""The same in words."""
_IN_DEPTH = ("behind", "front")
_POINT = (1e-3, 1e-3, 1e-3)
"""m, size of a body of which only the place is known"""
_BODIES = (PERSON, "hand")


def at_side(
    moment: Moment, node: Node, relation: str, view: str, *, bodies: bool = False, only: Iterable[str] = ()
) -> tuple[list[str], str]:
    """Names of what is at a side of a thing, and of who looks.

    Behind and in front of a thing is only what overlaps it sideways, as it does when people say so.

    Args:
        moment: the graph, and now.
        node: of the thing.
        relation: one of `SIDES`.
        view: words for who looks; of a camera of the robot if empty.
        bodies: whether persons and hands are asked for instead of things.
        only: names that count; all if there are none.

    Raises:
        ConfigError: if nobody knows where the thing or the viewer is, or no camera is there.
    """
    viewer = _viewer(moment, node, view)
    look = read_view(moment.memory, viewer)
    boxes = dict(read_scene(moment.memory).boxes)
    here = boxes.get(node.name)
    if here is None:
        raise ConfigError(f"nobody knows where {node.name} is, or how large")
    if bodies:
        boxes = {node.name: here, **_points(moment)}
    wanted = set(only)
    scene = Scene(boxes)
    found = [
        name for name, box in sorted(boxes.items())
        if name not in (node.name, viewer) and (not wanted or name in wanted)
        and scene.margin(Fact(SIDES[relation], name, node.name), look) >= 0.0
        and (relation not in _IN_DEPTH or _overlap(box, here, look))
    ]  # fmt: skip
    return found, viewer


def _viewer(moment: Moment, node: Node, asked: str) -> str:
    """Who looks: whom the words mean, or of the robot's cameras one that has the thing in view, by name."""
    if asked and not is_robot(asked):
        return node_of(moment, asked).name
    cameras = sorted(camera.name for camera in moment.memory.nodes(CAMERA))
    if not cameras:
        raise ConfigError("no camera is there from which to tell: name who looks, as in: seen from sally")
    looking = {edge.src for edge in moment.memory.edges("sees", dst=node.name) if edge.get("visible") is True}
    return next((name for name in cameras if name in looking), cameras[0])


def _overlap(one: Box, other: Box, look: View) -> bool:
    """Whether two boxes share a part of the line across the view."""
    (low, high), (least, most) = one.extent(look.left), other.extent(look.left)
    return min(high, most) > max(low, least)


def _points(moment: Moment) -> dict[str, Box]:
    """Persons and hands that are there, each as a point."""
    poses: dict[str, Pose | None] = {
        node.name: moment.memory.get_transform(WORLD, node.name, types=BELIEVED)
        for node in moment.memory.nodes(_BODIES) if node.get("perceived") is not False
    }  # fmt: skip
    return {name: Box(pose, _POINT) for name, pose in poses.items() if pose is not None}
