"""Boxes on the links of a robot, which stand for its collision shapes. SI units."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

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
    filling: Array | None = field(default=None, compare=False, repr=False)
    """(k, 3) m in the box's frame, the outermost points of the mesh that it stands for; None for a solid box"""

    @property
    def size(self) -> Vector3:
        """m, its edges."""
        x, y, z = self.half
        return 2 * x, 2 * y, 2 * z

    @property
    def corners(self) -> Array:
        """(8, 3) in the link's frame, m."""
        return self.pose.apply(CORNERS * self.half)

    @property
    def outermost(self) -> Array:
        """(k, 3) in the link's frame, m: the outermost points of what the box stands for."""
        return self.corners if self.filling is None else self.pose.apply(self.filling)

    def seen_from(self, frame_from_link: Pose) -> LinkBox:
        """The same box in another frame."""
        return LinkBox(frame_from_link @ self.pose, self.half, self.filling)


def bounds(boxes: Iterable[LinkBox]) -> tuple[float, ...] | None:
    """The least, then the greatest x, y, z (m) that the boxes reach in their common frame; None without any."""
    corners = [box.corners for box in boxes]
    if not corners:
        return None
    points = np.vstack(corners)
    return (*points.min(axis=0).tolist(), *points.max(axis=0).tolist())
