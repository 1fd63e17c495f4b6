"""The pinhole camera: pixels to rays and back (optical frame: x right, y down, z forward)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_MAX_PIXELS = 1e5
"""px, no focal length or principal point is beyond."""


class Intrinsics(NamedTuple):
    """Focal lengths and principal point of a rectified camera, px."""

    fx: float
    fy: float
    cx: float
    cy: float

    @classmethod
    def from_meta(cls, meta: Mapping[str, float | int | str]) -> Intrinsics:
        """Read the intrinsics of a frame. Raises `ValueError` if one is missing or no camera has such ones."""
        missing = [name for name in cls._fields if not isinstance(meta.get(name), (int, float))]
        if missing:
            raise ValueError(f"intrinsics {', '.join(missing)} missing; expected numbers fx, fy, cx, cy in px")
        values = cls(*(float(meta[name]) for name in cls._fields))
        if not (min(values.fx, values.fy) >= 1.0 and all(abs(value) <= _MAX_PIXELS for value in values)):
            raise ValueError(f"intrinsics {tuple(values)}: expected fx, fy >= 1 px and none beyond {_MAX_PIXELS} px")
        return values

    @property
    def matrix(self) -> Array:
        """(3, 3) camera matrix."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def rays(self, pixels: Array) -> Array:
        """(n, 3) viewing rays with z = 1 of pixels (n, 2)."""
        xy = (pixels - (self.cx, self.cy)) / (self.fx, self.fy)
        return np.column_stack([xy, np.ones(len(xy))])

    def pixels(self, points: Array) -> Array:
        """(n, 2) pixels of points (n, 3) in front of the camera, m."""
        return np.asarray(points[:, :2] / points[:, 2:] * (self.fx, self.fy) + (self.cx, self.cy))


def skew(vectors: Array) -> Array:
    """(..., 3, 3) matrices with `skew(a) @ b = a x b` of vectors (..., 3)."""
    return np.cross(vectors[..., None, :], -np.eye(3))


def tag_corners(tag_size: float) -> Array:
    """(4, 3) corners in the tag frame (x right, y up, z off the face), in the detector's order, m."""
    return 0.5 * tag_size * np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]])
