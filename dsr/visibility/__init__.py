"""Visibility: perspectives (cameras, persons), pictures drawn from there, and how much of each thing they show.

shares = visibility(memory)
monitor = VisibilityMonitor(memory, ["human_1"])
came_into_sight = [change.thing for change in monitor.update() if change.seen]
"""

from dsr.visibility.bodies import Posed, bodies_of, body_at, placed, read_posed, shape_of_thing
from dsr.visibility.looking import BAND, LEAST_PIXELS, LEAST_SHARE, VisibleScene, is_enough, is_seen, visibility
from dsr.visibility.monitor import SightChange, VisibilityMonitor
from dsr.visibility.perspectives import (
    CAMERA,
    PERSON,
    PERSON_FOV,
    PERSPECTIVES,
    WIDTH,
    Perspective,
    intrinsics_of,
    read_perspectives,
)
from dsr.visibility.picture import Body, Picture, VisibleFraction

__all__ = [
    "BAND",
    "CAMERA",
    "LEAST_PIXELS",
    "LEAST_SHARE",
    "PERSON",
    "PERSON_FOV",
    "PERSPECTIVES",
    "WIDTH",
    "Body",
    "Perspective",
    "Picture",
    "Posed",
    "SightChange",
    "VisibilityMonitor",
    "VisibleFraction",
    "VisibleScene",
    "bodies_of",
    "body_at",
    "intrinsics_of",
    "is_enough",
    "is_seen",
    "placed",
    "read_perspectives",
    "read_posed",
    "shape_of_thing",
    "visibility",
]
