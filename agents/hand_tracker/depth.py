"""From pixels and a depth image with holes to points in space."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dsr.errors import WireError
from dsr.images.blobs import Frame
from dsr.vocabulary.intrinsics import Intrinsics

Array = NDArray[np.float64]
Depth = NDArray[np.float32]
Color = NDArray[np.uint8]

_ALIKE = 0.015  # m, depths of one surface around a pixel
_NEAR_SHARE = 0.2  # quantile of the depths around a pixel that is on the nearest surface
_GROWTHS = 3  # how often the window grows where there is no depth


def images(frame: Frame) -> tuple[Color, Depth, Intrinsics]:
    """Colour, depth (0 where it is not known) and lens of a frame. Raises `WireError` if something is wrong."""
    color, depth = frame.arrays.get("color"), frame.arrays.get("depth")
    if color is None or color.ndim != 3 or color.shape[2] != 3 or color.dtype != np.uint8 or min(color.shape) < 1:
        raise WireError(f"frame at {frame.stamp}: expected a colour image (h, w, 3) of uint8")
    if depth is None or depth.shape != color.shape[:2] or depth.dtype != np.float32:
        raise WireError(f"frame at {frame.stamp}: expected a depth image {color.shape[:2]} of float32")
    numbers = [frame.meta.get(name) for name in ("fx", "fy", "cx", "cy")]
    if not all(isinstance(number, int | float) and np.isfinite(number) for number in numbers):
        raise WireError(f"frame at {frame.stamp}: expected intrinsics fx, fy, cx, cy in px")
    fx, fy, cx, cy = (float(number) for number in numbers)  # type: ignore[arg-type]
    if min(fx, fy) < 1.0:
        raise WireError(f"frame at {frame.stamp}: focal lengths {fx}, {fy}; expected 1 px or more")
    if not depth.min() >= 0.0 or not np.isfinite(depth.max()):
        depth = np.where(np.isfinite(depth) & (depth > 0.0), depth, np.float32(0.0))
    return color, depth, Intrinsics(fx, fy, cx, cy, color.shape[1], color.shape[0])


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
            near = float(np.quantile(found, _NEAR_SHARE))
            return float(np.median(found[np.abs(found - near) < _ALIKE]))
    return None


def rays(pixels: Array, lens: Intrinsics) -> Array:
    """(n, 3) viewing rays with z = 1 of pixels (n, 2)."""
    xy = (pixels - (lens.cx, lens.cy)) / (lens.fx, lens.fy)
    return np.column_stack([xy, np.ones(len(xy))])


def behind_surface(pixel: Array, depth: float, radius: float, lens: Intrinsics) -> Array:
    """(3,) the centre of a ball of `radius` m whose surface is seen at a pixel (2,), `depth` m along the axis."""
    ray = rays(pixel[None], lens)[0]
    return np.asarray(ray * depth + radius * ray / np.linalg.norm(ray))
