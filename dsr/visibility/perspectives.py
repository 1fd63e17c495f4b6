"""Perspectives: nodes from which a world is seen, which are cameras and persons, and the lens of a picture from there.

A camera's frame is the optical one (z forward, x right, y down). A person's is between the eyes: x along the gaze, y to
the left, z up; it is posed by `RT` edges like any other. Both may tell their field of view (`fov`).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable
from typing import NamedTuple

from dsr.errors import ConfigError, suggest
from dsr.frames.tree import BELIEVED, WORLD
from dsr.graph.elements import Node
from dsr.graph.shares import shared_out
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.vocabulary.intrinsics import Intrinsics, read_intrinsics
from dsr.vocabulary.perceived import MOST_PERSONS, is_perceived
from dsr.vocabulary.relations import nodes_by_name

_log = logging.getLogger("dsr.visibility")

CAMERA, PERSON = "camera", "person"
PERSPECTIVES = (CAMERA, PERSON)
"""Node types of perspectives."""
PERSON_FOV = (math.radians(100.0), math.radians(80.0))
"""rad, horizontal and vertical: what a person sees who does not move the head, and no tag says otherwise"""
CAMERA_FOV = (math.radians(60.0), math.radians(46.8))
"""rad, field of view of a camera that tells neither intrinsics nor a field of view"""
WIDTH = 320
"""px, of the pictures that are drawn"""
MOST_WIDTH = 4096
"""px, of a picture"""
_WIDEST = math.radians(170.0)
_MOST_ROWS = 4  # times the columns
_MOST_TOLD = 256
_told: set[str] = set()  # nodes whose field of view was warned of
GAZE = Pose((0.0, 0.0, 0.0), (-0.5, 0.5, -0.5, 0.5))
"""person_from_optical: z of the optical frame is x of the person's, and its x is minus the person's y."""


def persons_there(memory: Memory, now: float) -> list[Node]:
    """Nodes of persons whom somebody perceives at `now` (s), by name; of too many as many of each agent's."""
    there = [node for node in nodes_by_name(memory, PERSON) if is_perceived(node, now)]
    return shared_out(there, MOST_PERSONS)


class Perspective(NamedTuple):
    """A camera or person that looks: the pose in the world, and the picture that is drawn."""

    name: str
    """Name of the perspective's node."""
    world_from_view: Pose
    """Pose of the optical frame in the world: z along the view, x to the right, y down."""
    intrinsics: Intrinsics
    """Intrinsics (px) of the picture that is drawn."""


def read_perspectives(memory: Memory, names: Iterable[str] | None = None, width: int = WIDTH) -> list[Perspective]:
    """The cameras and persons whose place is known, by name; a person only while somebody perceives where they are.

    Args:
        memory: the world.
        names: of those that are wanted; all by default.
        width: px, of the pictures that are drawn, 1 to `MOST_WIDTH`.

    Raises:
        ConfigError: for a name of no perspective, or a width that no picture has.
    """
    if not 1 <= width <= MOST_WIDTH:
        raise ConfigError(f"width {width}: expected 1 to {MOST_WIDTH} px")
    nodes = {node.name: node for node in memory.nodes(PERSPECTIVES)}
    wanted = sorted(nodes) if names is None else list(names)
    for name in wanted:
        if name not in nodes:
            raise ConfigError(f"no camera or person {name!r}; {suggest(name, nodes)}")
    found = (_perspective(memory, nodes[name], width) for name in wanted)
    return [perspective for perspective in found if perspective is not None]


def _perspective(memory: Memory, node: Node, width: int) -> Perspective | None:
    if node.type == PERSON and not is_perceived(node, memory.clock.now()):
        return None
    pose = memory.get_transform(WORLD, node.name, types=BELIEVED)
    if pose is None:
        return None
    view = pose @ GAZE if node.type == PERSON else pose
    return Perspective(node.name, view, intrinsics_of(node, width))


def intrinsics_of(node: Node, width: int = WIDTH) -> Intrinsics:
    """The lens through which a perspective is drawn, by its intrinsics or its field of view, `width` px wide."""
    known = read_intrinsics(node)
    if known is not None:
        scale = width / known.width
        rows = max(1, min(round(known.height * scale), _MOST_ROWS * width))
        cx, cy = (known.cx + 0.5) * scale - 0.5, (known.cy + 0.5) * scale - 0.5
        return Intrinsics(known.fx * scale, known.fy * scale, cx, cy, width, rows)
    across, down = (min(angle, _WIDEST) for angle in _field(node))
    intrinsics = Intrinsics.from_fov(width, 1, across)
    rows = max(1, min(round(2.0 * intrinsics.fx * math.tan(down / 2.0)), _MOST_ROWS * width))
    return Intrinsics.from_fov(width, rows, across)


def _field(node: Node) -> tuple[float, float]:
    """rad, horizontal and vertical field of view."""
    usual = PERSON_FOV if node.type == PERSON else CAMERA_FOV
    given = node.get("fov")
    if given is None:
        return usual
    if not isinstance(given, tuple) or len(given) != 2 or not min(given) > 0.0:
        _warn(node, f"fov {given}: expected two positive angles; drawn with {usual[0]:.2f} by {usual[1]:.2f} rad")
        return usual
    if max(given) > _WIDEST:
        _warn(node, f"fov {given}: drawn with at most {_WIDEST:.2f} rad, in which what is far away takes few pixels")
    return given[0], given[1]


def _warn(node: Node, text: str) -> None:
    """Log, once for each node."""
    if node.name not in _told and len(_told) < _MOST_TOLD:
        _told.add(node.name)
        _log.warning("%s %s", node.name, text)
