"""Checks the images of a camera's frame, for every agent that looks at frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dsr.errors import WireError
from dsr.images.blobs import Frame
from dsr.vocabulary.intrinsics import Intrinsics

FARTHEST = 65.535
"""m, that 16 bits of millimetres can tell: a median beyond is in another unit"""
_EVERY = 8
"""Each of so many rows and columns is looked at for that"""

Color = NDArray[np.uint8]
Depth = NDArray[np.float32]


def images(frame: Frame) -> tuple[Color, Depth | None, Intrinsics]:
    """Colour (h, w, 3), depth (h, w) in m if there is any, and intrinsics of a frame.

    Raises:
        WireError: for an unusable one.
    """
    color, depth = frame.arrays.get("color"), frame.arrays.get("depth")
    if color is None or color.ndim != 3 or color.shape[2] != 3 or color.dtype != np.uint8 or min(color.shape) < 1:
        raise WireError(f"frame at {frame.stamp}: expected a colour image (h, w, 3) of uint8")
    if depth is not None and (depth.shape != color.shape[:2] or depth.dtype != np.float32):
        raise WireError(f"frame at {frame.stamp}: depth {depth.shape} {depth.dtype}, colour {color.shape}")
    if depth is not None and (middle := _middle(depth)) > FARTHEST:
        raise WireError(f"frame at {frame.stamp}: depths of {middle:.0f} m: are they in millimetres? Expected metres")
    try:
        return color, depth, Intrinsics.from_meta(frame.meta, color.shape)
    except ValueError as error:
        raise WireError(f"frame at {frame.stamp}: {error}") from error


def _middle(depth: Depth) -> float:
    """m, the median of the known depths; 0 without any."""
    looked = depth[::_EVERY, ::_EVERY]
    known = looked[np.isfinite(looked) & (looked > 0.0)]
    return float(np.median(known.astype(np.float64))) if known.size else 0.0
