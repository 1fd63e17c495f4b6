"""One colour for one meaning, in all views."""

from __future__ import annotations

from dsr.vocabulary.relations import THINGS

Color = tuple[int, int, int]
"""Red, green, blue from 0 to 255"""

PERCEPT: Color = (255, 176, 0)
UNSEEN_PERCEPT: Color = (110, 90, 50)
"""The last percept of what is not perceived any more."""
BELIEF: Color = (64, 156, 255)
ALTERNATIVE: Color = (150, 120, 255)
"""Colour of a place where something could be otherwise."""
HELD: Color = (110, 230, 130)
"""A belief that the gripper holds."""
SURPRISE: Color = (255, 64, 96)
"""Colour of objects about which percepts and belief disagree."""
NAME: Color = (235, 235, 235)
ROBOT: Color = (205, 210, 216)
JOINT: Color = (90, 96, 104)
TABLE: Color = (122, 100, 78)
CAMERA: Color = (197, 150, 255)
GREY: Color = (150, 150, 150)
AXES: tuple[Color, Color, Color] = ((230, 70, 70), (90, 200, 90), (80, 120, 255))

_STRUCTURE: Color = (160, 190, 230)
_OBJECT: Color = (120, 230, 200)
_HUMAN: Color = (255, 140, 170)
_PLAN: Color = (225, 225, 110)

NODE_TYPES: dict[str, Color] = {
    "world": (240, 240, 240),
    **dict.fromkeys(("robot", "body", "arm", "gripper"), _STRUCTURE),
    "camera": CAMERA,
    "table": (215, 175, 130),
    **dict.fromkeys(THINGS, _OBJECT),
    **dict.fromkeys(("hand", "finger", "person"), _HUMAN),
    **dict.fromkeys(("mind", "intention", "action"), _PLAN),
    "event": SURPRISE,
}
EDGE_TYPES: dict[str, Color] = {
    "RT": PERCEPT,
    "Virtual_RT": BELIEF,
    "on": (170, 215, 60),
    "in": (90, 200, 160),
    "grasping": HELD,
    "sees": CAMERA,
    "next": _PLAN,
}


def of_node(type: str) -> Color:
    """Colour of nodes of this type; grey for a user's own."""
    return NODE_TYPES.get(type, GREY)


def of_edge(type: str) -> Color:
    """Colour of edges of this type; grey for structure and a user's own."""
    return EDGE_TYPES.get(type, GREY)
