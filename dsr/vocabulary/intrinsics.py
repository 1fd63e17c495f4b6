"""Intrinsics of a camera: how points before it come into its image."""

from __future__ import annotations

import msgspec
import numpy as np

from dsr.graph.elements import Node
from dsr.math3d.transforms import Array

INTRINSICS = ("fx", "fy", "cx", "cy", "width", "height")
"""Attributes of a camera's node that tell them."""


class Intrinsics(msgspec.Struct, frozen=True):
    """A pinhole camera without distortion; pixel (0, 0) is centred on the upper left one."""

    fx: float
    fy: float
    """px, focal lengths"""
    cx: float
    cy: float
    """px, principal point"""
    width: int
    height: int
    """px, of the image"""

    @staticmethod
    def from_fov(width: int, height: int, fov: float) -> Intrinsics:
        """Square pixels, the axis through the middle; `fov` is the horizontal field of view in rad."""
        focal = width / 2 / float(np.tan(fov / 2))
        return Intrinsics(focal, focal, (width - 1) / 2, (height - 1) / 2, width, height)

    def project(self, points: Array) -> Array:
        """Pixels (n, 2) of points (n, 3) m in the optical frame (z forward, x right, y down), with z > 0."""
        pixels: Array = points[:, :2] / points[:, 2:] * np.array([self.fx, self.fy]) + np.array([self.cx, self.cy])
        return pixels


def read_intrinsics(camera: Node) -> Intrinsics | None:
    """Read the intrinsics of a camera's node; None if a value is missing, or no camera can have it."""
    values = [camera.get(name) for name in INTRINSICS]
    if None in values:
        return None
    found = Intrinsics(*values)
    return found if min(found.fx, found.fy, found.width, found.height) > 0 else None
