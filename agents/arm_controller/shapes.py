"""The collision shapes of a robot description (URDF), each as the box around it.

https://wiki.ros.org/urdf/XML/link. SI units. The shapes are boxes, cylinders and spheres. Any other, such as a mesh, is
refused: the arm would be planned for as if there were nothing.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from agents.urdf_elements import attribute, collision_solid, origin
from dsr.math3d.boxes import CORNERS, Array
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose


@dataclass(frozen=True)
class LinkBox:
    """A box on a link."""

    pose: Pose
    """link_from_box, at its centre"""
    half: Vector3
    """m, half its edges"""

    @property
    def size(self) -> Vector3:
        """m, its edges."""
        x, y, z = self.half
        return 2 * x, 2 * y, 2 * z

    @property
    def corners(self) -> Array:
        """(8, 3) in the link's frame, m."""
        return self.pose.apply(CORNERS * self.half)

    def seen_from(self, frame_from_link: Pose) -> LinkBox:
        """The same box in another frame."""
        return LinkBox(frame_from_link @ self.pose, self.half)


def read_boxes(link: ET.Element) -> tuple[LinkBox, ...]:
    """The boxes around the collision shapes of a <link>; ValueError for a shape that is not known or has no volume."""
    return tuple(
        LinkBox(origin(shape.find("origin")), _half_extent(attribute(link, "name"), shape))
        for shape in link.findall("collision")
    )


def bounds(boxes: Iterable[LinkBox]) -> tuple[float, ...] | None:
    """The least, then the greatest x, y, z (m) that the boxes reach in their common frame; None without any."""
    corners = [box.corners for box in boxes]
    if not corners:
        return None
    points = np.vstack(corners)
    return (*points.min(axis=0).tolist(), *points.max(axis=0).tolist())


def _half_extent(link: str, collision: ET.Element) -> Vector3:
    """Half the edges (m) of the box around a <collision> of the link of that name."""
    try:
        kind, (x, y, z) = collision_solid(collision)
    except ValueError as error:
        raise ValueError(f"link {link!r}: {error}") from error
    if min(x, y, z) <= 0.0:
        raise ValueError(f"link {link!r}: its collision <{kind}> has no volume; expected lengths above 0 m")
    return x / 2, y / 2, z / 2
