"""Spatial relations between things, from oriented bounding boxes: as a pure library, and as edges on request.

scene = read_scene(memory)
scene.margins(("left_of", "above"), view=read_view(memory, "camera_overhead"))
request_relations(memory, "next_to", "cube_3")
"""

from dsr.spatial.boxes import Box
from dsr.spatial.definitions import (
    ALLOCENTRIC,
    EGOCENTRIC,
    EPSILON,
    MIRRORED,
    SPATIAL,
    View,
    above,
    behind,
    below,
    close_to,
    in_,
    in_front_of,
    left_of,
    margin,
    next_to,
    on_top,
    right_of,
)
from dsr.spatial.hysteresis import Hysteresis
from dsr.spatial.requests import EDGE_TYPES, QUERY, SOURCE, WRITTEN, request_relations
from dsr.spatial.scene import Fact, Scene, box_at, checked_relations, read_scene, read_view

__all__ = [
    "ALLOCENTRIC",
    "EDGE_TYPES",
    "EGOCENTRIC",
    "EPSILON",
    "MIRRORED",
    "QUERY",
    "SOURCE",
    "SPATIAL",
    "WRITTEN",
    "Box",
    "Fact",
    "Hysteresis",
    "Scene",
    "View",
    "above",
    "behind",
    "below",
    "box_at",
    "checked_relations",
    "close_to",
    "in_",
    "in_front_of",
    "left_of",
    "margin",
    "next_to",
    "on_top",
    "read_scene",
    "read_view",
    "request_relations",
    "right_of",
]
