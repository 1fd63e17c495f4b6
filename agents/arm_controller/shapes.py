"""The collision shapes of a robot description (URDF), each as the box around it.

https://wiki.ros.org/urdf/XML/link. SI units. Meshes are left out: a description for this system draws its links
from boxes, cylinders and spheres.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.urdf_elements import attribute, number, origin, vector
from dsr.quaternions import Vector3
from dsr.transforms import Pose

Array = NDArray[np.float64]
_CORNERS = np.array(np.meshgrid((-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0))).reshape(3, 8).T


@dataclass(frozen=True)
class Box:
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
        return self.pose.apply(_CORNERS * self.half)

    def seen_from(self, frame_from_link: Pose) -> Box:
        """The same box in another frame."""
        return Box(frame_from_link @ self.pose, self.half)


def read_boxes(link: ET.Element) -> tuple[Box, ...]:
    """The boxes around the collision shapes of a <link>. Raises ValueError for numbers that are none."""
    boxes = []
    for shape in link.findall("collision"):
        half = _half_extent(link, shape.find("geometry"))
        if half is not None:
            boxes.append(Box(origin(shape.find("origin")), half))
    return tuple(boxes)


def bounds(boxes: Iterable[Box]) -> tuple[float, ...] | None:
    """The least, then the greatest x, y, z (m) that the boxes reach in their common frame; None without any."""
    corners = [box.corners for box in boxes]
    if not corners:
        return None
    points = np.vstack(corners)
    return (*points.min(axis=0).tolist(), *points.max(axis=0).tolist())


def _half_extent(link: ET.Element, geometry: ET.Element | None) -> Vector3 | None:
    if geometry is None:
        raise ValueError(f"link {attribute(link, 'name')!r}: a <collision> has no <geometry>")
    for shape in geometry:
        if shape.tag == "box":
            x, y, z = vector(shape, "size", (0.0, 0.0, 0.0))
            return x / 2, y / 2, z / 2
        if shape.tag == "cylinder":
            radius = number(shape, "radius", 0.0)
            return radius, radius, number(shape, "length", 0.0) / 2
        if shape.tag == "sphere":
            radius = number(shape, "radius", 0.0)
            return radius, radius, radius
    return None
