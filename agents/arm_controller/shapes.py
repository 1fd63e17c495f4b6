"""The collision shapes of a robot description (URDF), each as the box around it.

https://wiki.ros.org/urdf/XML/link. SI units. The shapes are boxes, cylinders and spheres. Any other, such as a mesh, is
refused: the arm would be planned for as if there were nothing.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from agents.urdf_elements import attribute, number, origin, vector
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
    geometry = collision.find("geometry")
    shapes = [] if geometry is None else list(geometry)
    if len(shapes) != 1:
        raise ValueError(f"link {link!r}: expected <collision> with one <geometry> of one shape, got {len(shapes)}")
    half = _half_edges(link, shapes[0])
    if min(half) <= 0.0:
        raise ValueError(f"link {link!r}: its collision <{shapes[0].tag}> has no volume; expected lengths above 0 m")
    return half


def _half_edges(link: str, shape: ET.Element) -> Vector3:
    if shape.tag == "box":
        x, y, z = vector(shape, "size", (0.0, 0.0, 0.0))
        return x / 2, y / 2, z / 2
    radius = number(shape, "radius", 0.0)
    if shape.tag == "cylinder":
        return radius, radius, number(shape, "length", 0.0) / 2
    if shape.tag == "sphere":
        return radius, radius, radius
    mesh = f" {shape.get('filename')!r}" if shape.get("filename") else ""
    raise ValueError(
        f"link {link!r}: its collision shape is a <{shape.tag}>{mesh}, which is not supported; "
        "expected <box>, <cylinder> or <sphere> around it"
    )
