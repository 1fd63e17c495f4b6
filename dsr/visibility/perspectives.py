"""Perspectives: nodes from which a world is seen, which are cameras and persons, and the lens of a picture from there.

A camera's frame is the optical one (z forward, x right, y down). A person's is between the eyes: x along the gaze, y to
the left, z up; it is posed by `RT` edges like any other. Both may tell their field of view (`fov`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from dsr.elements import Node
from dsr.errors import ConfigError, TransformError, suggest
from dsr.intrinsics import Intrinsics, read_intrinsics
from dsr.memory import Memory
from dsr.perceived import is_perceived
from dsr.transforms import Pose

CAMERA, PERSON = "camera", "person"
PERSPECTIVES = (CAMERA, PERSON)
"""Node types."""
PERSON_FOV = (math.radians(100.0), math.radians(80.0))
"""rad, horizontal and vertical: what a person sees who does not move the head, and no tag says otherwise"""
CAMERA_FOV = (math.radians(60.0), math.radians(46.8))
"""rad, of a camera that tells neither intrinsics nor a field of view"""
WIDTH = 320
"""px, of the pictures that are drawn"""
BELIEVED = ("Virtual_RT", "RT")
_WIDEST = math.radians(170.0)
_MOST_ROWS = 4  # times the columns
_WORLD = "world"
GAZE = Pose((0.0, 0.0, 0.0), (-0.5, 0.5, -0.5, 0.5))
"""person_from_optical: z of the optical frame is x of the person's, and its x is minus the person's y."""


class Perspective(NamedTuple):
    """Who looks, from where, and how much of the world that shows."""

    name: str
    """Of its node."""
    world_from_view: Pose
    """Of the optical frame."""
    lens: Intrinsics
    """Of the picture that is drawn."""


def read_perspectives(memory: Memory, names: Iterable[str] | None = None, width: int = WIDTH) -> list[Perspective]:
    """The cameras and persons whose place is known, by name; a person only while somebody perceives where they are.

    Args:
        memory: the world.
        names: of those that are wanted; all by default.
        width: px, of the pictures that are drawn.

    Raises:
        ConfigError: for a name of no perspective.
    """
    nodes = {node.name: node for kind in PERSPECTIVES for node in memory.nodes(kind)}
    wanted = sorted(nodes) if names is None else list(names)
    for name in wanted:
        if name not in nodes:
            raise ConfigError(f"no camera or person {name!r}; {suggest(name, nodes)}")
    found = (_perspective(memory, nodes[name], width) for name in wanted)
    return [perspective for perspective in found if perspective is not None]


def _perspective(memory: Memory, node: Node, width: int) -> Perspective | None:
    if node.type == PERSON and not is_perceived(node, memory.clock.now()):
        return None
    try:
        pose = memory.transform(_WORLD, node.name, types=BELIEVED)
    except TransformError:
        return None
    view = pose @ GAZE if node.type == PERSON else pose
    return Perspective(node.name, view, lens_of(node, width))


def lens_of(node: Node, width: int = WIDTH) -> Intrinsics:
    """The lens through which a perspective is drawn, by its intrinsics or its field of view, `width` px wide."""
    known = read_intrinsics(node)
    if known is not None:
        scale = width / known.width
        rows = max(1, min(round(known.height * scale), _MOST_ROWS * width))
        cx, cy = (known.cx + 0.5) * scale - 0.5, (known.cy + 0.5) * scale - 0.5
        return Intrinsics(known.fx * scale, known.fy * scale, cx, cy, width, rows)
    across, down = (min(angle, _WIDEST) for angle in _field(node))
    lens = Intrinsics.from_fov(width, 1, across)
    rows = max(1, min(round(2.0 * lens.fx * math.tan(down / 2.0)), _MOST_ROWS * width))
    return Intrinsics.from_fov(width, rows, across)


def _field(node: Node) -> tuple[float, float]:
    """rad, horizontal and vertical field of view."""
    given = node.get("fov")
    if isinstance(given, tuple) and len(given) == 2 and min(given) > 0.0:
        return given[0], given[1]
    return PERSON_FOV if node.type == PERSON else CAMERA_FOV
