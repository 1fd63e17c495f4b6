"""Reads the content of the 3D view from the working memory as plain values."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from agents.viewer.folding import MOST_NODES
from dsr import Memory, Node, Pose
from dsr.believing.distribution import are_at_one_place, whereabouts_of
from dsr.believing.worlds import LEAST
from dsr.frames.tree import BELIEVED, WORLD
from dsr.graph.shares import makers, shared_out
from dsr.math3d.tolerance import PoseTolerance
from dsr.vocabulary.intrinsics import Intrinsics, read_intrinsics
from dsr.vocabulary.relations import THINGS, nodes_by_name

OBJECT_TYPES = (*THINGS, "hand", "finger")
_BODY_TYPES = ("robot", "arm", "body", "gripper")
_FRAME_TYPES = (WORLD, "robot", "gripper", "camera", "table")
_DEFAULT_SIZE = {"table": (1.0, 1.0, 0.02), "hand": (0.08, 0.08, 0.08), "finger": (0.016, 0.016, 0.016)}
_ALIKE = PoseTolerance(0.002, 0.05)  # m, rad up to which percept and belief are drawn as one
_OTHER_SIZE = (0.04, 0.04, 0.04)

Vector = tuple[float, float, float]


class DrawnPlace(msgspec.Struct, frozen=True):
    """A pose in the world, comparable by its numbers."""

    translation: Vector
    """m, position in the world"""
    rotation: tuple[float, float, float, float]
    """Quaternion (x, y, z, w)"""


class DrawnSolid(msgspec.Struct, frozen=True):
    """An object at a place."""

    name: str
    type: str
    place: DrawnPlace
    size: Vector
    """m, extent along its own x, y, z"""
    seen: bool = True
    """Whether a camera perceives the object now."""
    held: bool = False
    """Whether the gripper holds the object, as far as is known."""
    opacity: float = 1.0
    """1 for what is believed most; of an alternative, its probability."""


class DrawnCamera(msgspec.Struct, frozen=True):
    """A camera at a place, with its lens."""

    name: str
    stream: str
    place: DrawnPlace | None
    intrinsics: Intrinsics | None
    makers: frozenset[str]
    """Agents that made its node"""


class Gripper(msgspec.Struct, frozen=True):
    """A gripper and how far it is open."""

    place: DrawnPlace
    opening: float
    """m between the pads"""


class DrawnScene(msgspec.Struct, frozen=True):
    """Everything at one instant."""

    tables: list[DrawnSolid]
    percepts: list[DrawnSolid]
    ghosts: list[DrawnSolid]
    """Percepts of which the belief differs, or is missing"""
    beliefs: list[DrawnSolid]
    alternatives: list[DrawnSolid]
    """Where objects could be otherwise"""
    surprising: list[DrawnSolid]
    """Objects that are marked so, where they are believed to be, or perceived"""
    parts: list[DrawnSolid]
    """Boxes around the parts of robots, by which views are known to be hidden"""
    frames: list[DrawnPlace]
    links: list[tuple[Vector, Vector]]
    """Segments of robots, from joint to joint"""
    grippers: list[Gripper]
    cameras: list[DrawnCamera]


def read_scene(memory: Memory) -> DrawnScene:
    """The scene as the memory has it now; what is not connected to the world is left out.

    Of each kind at most `MOST_NODES` are drawn.
    """
    objects = _drawn(memory, OBJECT_TYPES)
    percepts = [solid for node in objects if (solid := _solid(memory, node, ("RT",)))]
    believed = [node for node in objects if memory.edges("Virtual_RT", dst=node.name)]
    beliefs = [solid for node in believed if (solid := _solid(memory, node, BELIEVED))]
    known = {solid.name: solid for solid in [*percepts, *beliefs]}
    return DrawnScene(
        tables=[solid for node in _drawn(memory, ("table",)) if (solid := _solid(memory, node, BELIEVED))],
        percepts=percepts,
        ghosts=[percept for percept in percepts if _differs(percept, known[percept.name])],
        beliefs=beliefs,
        alternatives=[solid for node in objects for solid in _alternatives(memory, node)],
        surprising=[known[node.name] for node in objects if node.get("surprising", False) and node.name in known],
        parts=[part for node in _drawn(memory, _BODY_TYPES) if (part := _part(memory, node))],
        frames=[place for node in _drawn(memory, _FRAME_TYPES) if (place := _place(memory, node.name))],
        links=_links(memory),
        grippers=[gripper for node in _drawn(memory, ("gripper",)) if (gripper := _gripper(memory, node))],
        cameras=[_camera(memory, node) for node in nodes_by_name(memory, ("camera",))],
    )


def _drawn(memory: Memory, types: tuple[str, ...]) -> list[Node]:
    """The nodes of these types that are drawn, by name: of more than `MOST_NODES` as many of each agent's."""
    return shared_out(nodes_by_name(memory, types), MOST_NODES)


def place_of(pose: Pose) -> DrawnPlace:
    """The place of a world_from_something."""
    return DrawnPlace(pose.t, pose.q)


def _place(memory: Memory, name: str, types: tuple[str, ...] = ("RT",)) -> DrawnPlace | None:
    pose = memory.get_transform(WORLD, name, types=types)
    return None if pose is None else place_of(pose)


def _solid(memory: Memory, node: Node, types: tuple[str, ...]) -> DrawnSolid | None:
    place = _place(memory, node.name, types)
    if place is None:
        return None
    held = bool(memory.edges("grasping", dst=node.name))
    return DrawnSolid(node.name, node.type, place, _size(node), bool(node.get("perceived", True)), held)


def _size(node: Node) -> Vector:
    x, y, z = node.get("size", _DEFAULT_SIZE.get(node.type, _OTHER_SIZE))
    return x, y, z


def _alternatives(memory: Memory, node: Node) -> Iterator[DrawnSolid]:
    """Where else an object could be, by the weighted worlds of the belief."""
    where = whereabouts_of(node, memory.get_edge(WORLD, node.name, "Virtual_RT"))
    if where is None:
        return
    for one in where.alternatives[1:]:
        if one.pose is not None and one.weight >= LEAST and not are_at_one_place(one, where.best):
            opacity = round(one.weight, 2)
            yield DrawnSolid(node.name, node.type, place_of(one.pose), _size(node), seen=False, opacity=opacity)


def _differs(percept: DrawnSolid, known: DrawnSolid) -> bool:
    """Whether a percept is elsewhere than what is believed, or nothing is believed."""
    if known is percept:
        return True
    return not _ALIKE.covers(_pose(percept.place), _pose(known.place))


def _pose(place: DrawnPlace) -> Pose:
    return Pose.unchecked(place.translation, place.rotation)


def moved(place: DrawnPlace, offset: Vector) -> DrawnPlace:
    """The place at `offset` (m) in the frame of `place`."""
    return place_of(_pose(place) @ Pose(offset))


def _part(memory: Memory, node: Node) -> DrawnSolid | None:
    """The box around a part of the robot."""
    bounds = node.get("bounds")
    place = None if bounds is None else _place(memory, node.name)
    if bounds is None or place is None:
        return None
    (x, y, z), (x_end, y_end, z_end) = bounds[:3], bounds[3:]
    centre = ((x + x_end) / 2, (y + y_end) / 2, (z + z_end) / 2)
    return DrawnSolid(node.name, node.type, moved(place, centre), (abs(x_end - x), abs(y_end - y), abs(z_end - z)))


def _links(memory: Memory) -> list[tuple[Vector, Vector]]:
    """From frame to frame along the RT edges between parts of a robot."""
    links = []
    drawn = {node.name for node in _drawn(memory, _BODY_TYPES)}
    for dst in sorted(drawn):
        for edge in memory.edges("RT", dst=dst):
            if edge.src in drawn:
                ends = _place(memory, edge.src), _place(memory, dst)
                if ends[0] and ends[1]:
                    links.append((ends[0].translation, ends[1].translation))
    return links


def _gripper(memory: Memory, node: Node) -> Gripper | None:
    place = _place(memory, node.name)
    return None if place is None else Gripper(place, float(node.get("opening", 0.0)))


def _camera(memory: Memory, node: Node) -> DrawnCamera:
    stream = node.get("stream") or node.name
    return DrawnCamera(node.name, stream, _place(memory, node.name), read_intrinsics(node), makers(node))
