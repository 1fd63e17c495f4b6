"""From the graph to the input of `rays`: the poses of the cameras, and the bodies that stand in their way."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from dsr.errors import DsrError
from dsr.frames.tree import WORLD
from dsr.graph.elements import Node
from dsr.graph.shares import shared_out
from dsr.math3d import quaternions
from dsr.math3d.transforms import Array, Pose
from dsr.memory import Memory
from dsr.perception.consensus import tells_rotation
from dsr.visibility import PERSON
from dsr.visibility.persons import HEAD, TRUNK, upright
from dsr.visibility.perspectives import persons_there
from dsr.vocabulary.bodies import MOST_PARTS, bodies_by_name
from dsr.vocabulary.calibration import pose_of, provisional
from dsr.vocabulary.intrinsics import Intrinsics, read_intrinsics
from dsr.vocabulary.perceived import MOST_SILENT, camera_nodes, is_perceived, seconds_unseen
from dsr.vocabulary.relations import SURFACES, THINGS
from simulation_handler.graph_io.hand_nodes import hand_nodes
from simulation_handler.graph_io.reading import FIXTURES, MODELLED
from simulation_handler.hands.figures import hand_solid
from simulation_handler.perception.visibility import CameraView
from simulation_handler.shapes.geometry import Solid
from simulation_handler.shapes.meshes import Forms

PARTS = ("robot", "body", "arm", "gripper", "hand", "finger", PERSON)
"""Node types of parts of bodies; those with the attribute `bounds` hide things behind them."""
_FINGER = re.compile(r"_finger_([0-4])$")


def views(memory: Memory) -> list[CameraView]:
    """All cameras whose place and intrinsics are known, by name; now, or when their chains were last known."""
    nodes = camera_nodes(memory)
    return [
        _view(memory, node.name, pose, intrinsics)
        for node, pose in zip(nodes, _places(memory, nodes), strict=True)
        if pose is not None and (intrinsics := read_intrinsics(node)) is not None
    ]


def _view(memory: Memory, camera: str, pose: Pose, intrinsics: Intrinsics) -> CameraView:
    known = pose.with_covariance(_mount_covariance(memory, camera))
    return CameraView(camera, known, intrinsics, tuple(_displaced(memory, camera, pose)))


def _mount_covariance(memory: Memory, camera: str) -> Array | None:
    """(6, 6) of where a camera is on what carries it, m and rad; None if that is not known."""
    poses = (edge.get("pose") for edge in memory.edges("RT", dst=camera))
    return next((pose.covariance for pose in poses if pose is not None), None)


def obstacles(memory: Memory) -> list[Solid]:
    """Boxes around parts of bodies (`bounds`), and tables, where they are now. What cannot be used is left out."""
    tables = [node for node in bodies_by_name(memory, FIXTURES) if node.type in SURFACES]
    return _boxes(memory, [*_parts(memory), *tables])


def _parts(memory: Memory) -> list[Node]:
    """Parts of bodies that hide what is behind them, by name, at most `MOST_PARTS`; of persons, those who are there."""
    now = memory.clock.now()
    found = (node for node in memory.nodes(PARTS) if "bounds" in node)
    there = (node for node in found if node.type != PERSON or is_perceived(node, now))
    return shared_out(sorted(there, key=lambda node: node.name), MOST_PARTS)


def _boxes(memory: Memory, nodes: list[Node]) -> list[Solid]:
    """Those of parts, and of tables, whose place is known."""
    boxes = [_bounds(node) if "bounds" in node else _below_its_top(node) for node in nodes]
    found = []
    for node, box, pose in zip(nodes, boxes, _places(memory, nodes), strict=True):
        if box is not None and pose is not None:
            least, size = box
            centre = pose @ Pose.unchecked(_middle(least, size), (0.0, 0.0, 0.0, 1.0))
            found.append(Solid(node.name, (size[0], size[1], size[2]), centre.t, centre.q, fixed=True))
    return found


def _displaced(memory: Memory, camera: str, world_from_camera: Pose) -> Iterator[Solid]:
    """What the robot hides if not a camera moved, whose pose is provisional, but all that it sees, alike.

    The objects are where they are seen then, too; but how the robot's parts are to them is known from its joints.
    """
    if (told := provisional(memory, camera)) is None:
        return
    _, report = told
    with contextlib.suppress(DsrError):
        before = memory.transform(WORLD, report.parent) @ pose_of(report.before)
        shift = world_from_camera @ before.inverse()
        for part in _boxes(memory, _parts(memory)):
            pose = shift @ part.pose
            yield replace(part, position=pose.t, rotation=pose.q)


def modelled(memory: Memory, forms: Forms) -> list[Solid]:
    """List the static objects whose mesh is here, as boxes around its parts; objects that such boxes would fill are
    left out.
    """
    found = []
    for node in [node for node in bodies_by_name(memory, FIXTURES) if node.type == MODELLED]:
        with contextlib.suppress(DsrError):
            form = forms.of(node)
            if form is not None and form.is_true:
                pose = memory.transform(WORLD, node.name) @ Pose(form.centre)
                found.append(Solid(node.name, form.size, pose.t, pose.q, fixed=True, shape=form.shape))
    return found


def hands(memory: Memory, now: float) -> list[Solid]:
    """Human hands that are in sight, or were until just before `now` (s): they may still hide something."""
    found = []
    for node, fingers in hand_nodes(memory, now):
        pose = _measured(memory, node)
        if pose is not None and seconds_unseen(node, now) <= MOST_SILENT:
            tips = {
                int(match[1]): tip.t
                for finger in fingers
                if (match := _FINGER.search(finger.name)) and (tip := _measured(memory, finger)) is not None
            }
            found.append(hand_solid(node.name, pose, tips, is_left=node.get("side") == "left"))
    return found


def persons(memory: Memory, now: float) -> list[Solid]:
    """Heads and trunks, as boxes, of those who are there at `now` (s); who has `bounds` is among the `obstacles`."""
    there = [node for node in persons_there(memory, now) if "bounds" not in node]
    return [
        Solid(node.name, part.size, placed.t, placed.q, fixed=True)
        for node, pose in zip(there, _places(memory, there), strict=True)
        if pose is not None
        for shape, stance in ((HEAD, pose), (TRUNK, _pose(upright(pose.matrix))))
        for part in shape
        if stance is not None
        for placed in (stance @ Pose(part.position, part.rotation),)
    ]


def _measured(memory: Memory, node: Node) -> Pose | None:
    """Where a part of a human hand was when it was last seen; None if that is not known."""
    edge = memory.get_edge(WORLD, node.name, "RT")
    return None if edge is None else edge.get("pose")


def by_color(memory: Memory) -> frozenset[str]:
    """Names of the things that are recognised by their colour.

    They have one, and no tag, or a tag that the camera did not read which saw them last.
    """
    colored = (node for node in memory.nodes(THINGS) if "color" in node)
    return frozenset(node.name for node in colored if "marker_id" not in node or _is_seen_by_color(memory, node.name))


def _is_seen_by_color(memory: Memory, name: str) -> bool:
    """Whether the newest percept of a thing with a tag is by its colour: a tag would tell how the thing is turned."""
    poses = (edge.get("pose") for edge in memory.edges("RT", dst=name))
    newest = max((pose for pose in poses if pose is not None), key=lambda pose: pose.stamp, default=None)
    covariance = None if newest is None else newest.covariance
    return covariance is not None and not tells_rotation(covariance[3:, 3:])


def _places(memory: Memory, nodes: list[Node]) -> Iterator[Pose | None]:
    """world_from_node of each; None where there is no chain."""
    if not nodes:
        return iter(())
    return map(_pose, memory.transforms(WORLD, [node.name for node in nodes]))


def _pose(matrix: Array) -> Pose | None:
    if not math.isfinite(float(matrix.sum())):
        return None
    x, y, z = matrix[:3, 3].tolist()
    return Pose.unchecked((x, y, z), quaternions.normalised(quaternions.from_matrix(matrix[:3, :3].tolist())))


def _bounds(node: Node) -> tuple[Array, Array] | None:
    """Least corner and edge lengths (3,) of a part's box in its own frame, m; None if it is none."""
    values = np.array(node.get("bounds", ()))
    if values.shape != (6,) or not (values[:3] < values[3:]).all():
        return None
    return values[:3], values[3:] - values[:3]


def _below_its_top(node: Node) -> tuple[Array, Array] | None:
    """Likewise of a table, whose frame is at the centre of its top."""
    size = np.array(node.get("size", ()))
    if size.shape != (3,) or not (size > 0.0).all():
        return None
    return size * (-0.5, -0.5, -1.0), size


def _middle(least: Array, size: Array) -> tuple[float, float, float]:
    x, y, z = (least + 0.5 * size).tolist()
    return x, y, z
