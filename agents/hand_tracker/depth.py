"""From pixels and a depth image with holes to points in space."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.frame_images import Color, Depth, images
from dsr.errors import WireError
from dsr.images.blobs import Frame
from dsr.vocabulary.intrinsics import Intrinsics

Array = NDArray[np.float64]

_ALIKE = 0.015  # m, depths of one surface around a pixel
_NEAR_SHARE = 0.2  # quantile of the depths around a pixel that is on the nearest surface
_GROWTHS = 3  # how often the window grows where there is no depth


def images_with_depth(frame: Frame) -> tuple[Color, Depth, Intrinsics]:
    """Colour, depth (0 where it is not known, or the lens shows nothing) and lens of a frame. Raises `WireError`."""
    color, depth, intrinsics = images(frame)
    if depth is None:
        raise WireError(f"frame at {frame.stamp}: the camera gives no depth, without which hands have no place")
    if not depth.min() >= 0.0 or not np.isfinite(depth.max()):
        depth = np.where(np.isfinite(depth) & (depth > 0.0), depth, np.float32(0.0))
    if intrinsics.distortion is not None:
        x, y = intrinsics.slopes()
        depth = np.where(np.isfinite(x) & np.isfinite(y), depth, np.float32(0.0))
    return color, depth, intrinsics


def depth_at(depth: Depth, pixel: Array, radius: float, mask: NDArray[np.bool_] | None = None) -> float | None:
    """Depth (m, along the optical axis) of the nearest surface within `radius` px of a pixel (2,).

    Only pixels of `mask` (h, w) count, if it is given. In a hole it looks further; None if there is no depth around.
    """
    height, width = depth.shape
    u, v = (round(float(part)) for part in pixel)
    for growth in range(_GROWTHS):
        reach = max(1, round(radius * 2**growth))
        window = np.s_[max(v - reach, 0) : min(v + reach + 1, height), max(u - reach, 0) : min(u + reach + 1, width)]
        values = depth[window]
        valid = np.isfinite(values) & (values > 0.0)
        if mask is not None:
            valid &= mask[window]
        found = values[valid]
        if found.size:
            near = float(np.quantile(found, _NEAR_SHARE, method="lower"))  # of a pixel, not between two surfaces
            return float(np.median(found[np.abs(found - near) < _ALIKE]))
    return None


def behind_surface(pixel: Array, depth: float, radius: float, intrinsics: Intrinsics) -> Array:
    """(3,) the centre of a ball of `radius` m whose surface is seen at a pixel (2,), `depth` m along the axis.

    NaN at a pixel where a distorting lens shows nothing.
    """
    ray = intrinsics.rays(pixel)
    return np.asarray(ray * depth + radius * ray / np.linalg.norm(ray))
