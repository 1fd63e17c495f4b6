"""Tags on things: their size, and names of things of which the robot knows nothing but their tag."""

from __future__ import annotations

COUNT = 587
"""Ids of AprilTags of the family 36h11, from 0."""
TAG_RATIO = 0.8
"""Side of a tag (its black border) over the shorter side of the face (+z) that carries it, in its middle."""
_PREFIX = "cube_"


def name_of(marker_id: int) -> str:
    """The name of the node that is made for a tag which nobody knows, once it is seen steadily."""
    return f"{_PREFIX}{marker_id}"


def tag_of(name: str) -> int | None:
    """The tag whose first sight would make a node of this name; None if no tag would."""
    digits = name.removeprefix(_PREFIX)
    found = int(digits) if digits.isascii() and digits.isdigit() and len(digits) <= len(str(COUNT)) else COUNT
    return found if found < COUNT and name == name_of(found) else None
