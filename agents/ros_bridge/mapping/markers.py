"""`visualization_msgs/MarkerArray`: beliefs as RViz and Foxglove draw them, with the ellipsoids of covariances."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

from agents.ros_bridge.mapping.detections import position_ellipsoid
from agents.ros_bridge.mapping.stamps import to_header
from agents.ros_bridge.mapping.transforms import to_pose, to_vector
from agents.ros_bridge.messages.types import RosTypes
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Part, PartKind, Shape
from dsr.math3d.transforms import Pose

MARKERS = "visualization_msgs/msg/MarkerArray"
_MARKER, _COLOR = "visualization_msgs/msg/Marker", "std_msgs/msg/ColorRGBA"
_KINDS: dict[PartKind, int] = {"box": 1, "sphere": 2, "cylinder": 3}
"""Constants CUBE, SPHERE and CYLINDER of Marker"""
_TEXT, _SPHERE = 9, 2
_ADD, _DELETE = 0, 2
GREY = (0.7, 0.7, 0.7)
"""Red, green, blue of what has no colour"""
_LETTERS = 0.03
"""m, height of names: to be read beside cubes of 4 cm"""
_DEVIATIONS = 2.0
"""Standard deviations that an ellipsoid shows"""
_SEEN_THROUGH = 0.35
"""Opacity of an ellipsoid, so that the object in it is seen"""
_LEAST = 1e-3
"""m, diameter below which an ellipsoid is drawn as that wide, so that it is a body"""


class Drawn(NamedTuple):
    """One object to be drawn."""

    name: str
    pose: Pose
    """frame_from_object"""
    shape: Shape
    """Parts in the object's frame"""
    color: tuple[float, float, float] = GREY
    """Red, green, blue, 0 to 1"""


class MarkerNumbers:
    """Numbers of markers: RViz knows each by its namespace and number, and keeps what is not deleted."""

    def __init__(self) -> None:
        self._shown: dict[tuple[str, int], None] = {}

    def message(self, types: RosTypes, stamp: float, frame: str, drawn: Iterable[Drawn]) -> Any:
        """A message that draws these, and deletes all that the last one drew and this one does not."""
        header = to_header(types, stamp, frame)
        markers = [marker for one in drawn for marker in _markers(types, header, one)]
        shown = {(marker.ns, marker.id): None for marker in markers}
        gone = [key for key in self._shown if key not in shown]
        self._shown = shown
        deleted = [types.new(_MARKER, header=header, ns=ns, id=number, action=_DELETE) for ns, number in gone]
        return types.new(MARKERS, markers=[*deleted, *markers])


def _markers(types: RosTypes, header: Any, drawn: Drawn) -> list[Any]:
    """Its parts, its name above it, and the ellipsoid of its position, in a namespace of its own."""
    solid = _color(types, drawn.color, 1.0)

    def marker(number: int, kind: int, pose: Pose, scale: Vector3, color: Any, text: str = "") -> Any:
        return types.new(
            _MARKER, header=header, ns=drawn.name, id=number, type=kind, action=_ADD, pose=to_pose(types, pose),
            scale=to_vector(types, scale), color=color, text=text,
        )  # fmt: skip

    found = [
        marker(number, _KINDS[part.kind], drawn.pose @ Pose(part.position, part.rotation), _scale(part), solid)
        for number, part in enumerate(drawn.shape)
    ]
    x, y, z = drawn.pose.t
    above = z + max((max(part.size) for part in drawn.shape), default=0.0)
    name = Pose((x, y, above))
    found.append(marker(len(found), _TEXT, name, (0.0, 0.0, _LETTERS), _color(types, (1.0, 1.0, 1.0), 1.0), drawn.name))
    ellipsoid = position_ellipsoid(drawn.pose, _DEVIATIONS)
    if ellipsoid is not None:
        axes, (a, b, c) = ellipsoid
        wide = (max(a, _LEAST), max(b, _LEAST), max(c, _LEAST))
        found.append(marker(len(found), _SPHERE, axes, wide, _color(types, drawn.color, _SEEN_THROUGH)))
    return found


def _scale(part: Part) -> Vector3:
    x, y, z = part.size
    return {"box": (x, y, z), "cylinder": (x, x, z), "sphere": (x, x, x)}[part.kind]


def _color(types: RosTypes, rgb: tuple[float, float, float], opacity: float) -> Any:
    r, g, b = rgb
    return types.new(_COLOR, r=float(r), g=float(g), b=float(b), a=opacity)
