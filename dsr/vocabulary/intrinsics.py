"""Intrinsics of a camera: how points before it come into its image, and back."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from dsr.graph.elements import Node
from dsr.math3d.transforms import Array

INTRINSICS = ("fx", "fy", "cx", "cy", "width", "height")
"""Attributes of a camera's node that tell them."""
DISTORTION = ("distortion_model", "distortion")
"""Attributes of a camera's node that tell how its lens distorts."""
_MOST_PIXELS = 1e5
"""px, no focal length or principal point is beyond."""


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

    @staticmethod
    def from_meta(meta: Mapping[str, float | int | str], shape: tuple[int, ...]) -> Intrinsics:
        """Those that a frame with images of `shape` (height, width, ...) tells beside them: fx, fy, cx, cy in px.

        Raises:
            ValueError: if one is missing, or no camera has such ones.
        """
        missing = [name for name in INTRINSICS[:4] if not isinstance(meta.get(name), (int, float))]
        if missing:
            raise ValueError(f"intrinsics {', '.join(missing)} missing; expected numbers fx, fy, cx, cy in px")
        fx, fy, cx, cy = values = tuple(float(meta[name]) for name in INTRINSICS[:4])
        if not (min(fx, fy) >= 1.0 and all(abs(value) <= _MOST_PIXELS for value in values)):
            raise ValueError(f"intrinsics {values}: expected fx, fy >= 1 px and none beyond {_MOST_PIXELS} px")
        return Intrinsics(fx, fy, cx, cy, shape[1], shape[0])

    @property
    def matrix(self) -> Array:
        """(3, 3) camera matrix, px."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def project(self, points: Array) -> Array:
        """Pixels (..., 2) of points (..., 3) m in the optical frame (z forward, x right, y down), with z > 0."""
        pixels: Array = points[..., :2] / points[..., 2:] * (self.fx, self.fy) + (self.cx, self.cy)
        return pixels

    def rays(self, pixels: Array) -> Array:
        """Viewing rays (..., 3) with z = 1 through pixels (..., 2)."""
        xy = (pixels - (self.cx, self.cy)) / (self.fx, self.fy)
        return np.concatenate([xy, np.ones((*xy.shape[:-1], 1))], axis=-1)

    def slopes(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The x (width,) of the viewing rays with z = 1 of all columns, and the y (height,) of all rows."""
        x = (np.arange(self.width, dtype=np.float32) - self.cx) / self.fx
        y = (np.arange(self.height, dtype=np.float32) - self.cy) / self.fy
        return x, y


class Distortion(msgspec.Struct, frozen=True):
    """How a lens distorts images; agents take images as they come, and correct nothing by this."""

    model: str
    """`plumb_bob`, `rational_polynomial` or `equidistant`, as in `sensor_msgs/CameraInfo`; or another one's name"""
    coefficients: tuple[float, ...]
    """Without unit, in the order of OpenCV: k1, k2, p1, p2, k3, ...; of `equidistant` k1 to k4"""

    @staticmethod
    def of(model: str, coefficients: Sequence[float]) -> Distortion:
        """Raise `ValueError` for a model without a name, or coefficients that no model has."""
        if not model or len(model) > _LONGEST_MODEL:
            raise ValueError(f"distortion model {model[:80]!r}: expected a name")
        if len(coefficients) > _MOST_COEFFICIENTS or not all(map(math.isfinite, coefficients)):
            raise ValueError(f"distortion of {len(coefficients)} coefficients: expected {_MOST_COEFFICIENTS} at most")
        return Distortion(model, tuple(map(float, coefficients)))


_MOST_COEFFICIENTS = 14
"""of OpenCV's largest model: rational, thin prism and tilt"""
_LONGEST_MODEL = 64
"""characters of a model's name"""


def read_distortion(camera: Node) -> Distortion | None:
    """Read the distortion of a camera's node; None if it tells none, or one that no lens has."""
    model, coefficients = (camera.get(name) for name in DISTORTION)
    if model is None or coefficients is None:
        return None
    try:
        return Distortion.of(model, coefficients)
    except ValueError:
        return None


def read_intrinsics(camera: Node) -> Intrinsics | None:
    """Read the intrinsics of a camera's node; None if a value is missing, or no camera can have it."""
    values = [camera.get(name) for name in INTRINSICS]
    if None in values:
        return None
    found = Intrinsics(*values)
    return found if min(found.fx, found.fy, found.width, found.height) > 0 else None
