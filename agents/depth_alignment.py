"""Shows the depth that one camera measures in the image of another one beside it, pixel by pixel."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from agents.frame_images import Depth
from agents.packed_images import MOST_PIXELS
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics

_NEAREST = 1e-3
"""m before the colour camera; nothing nearer is seen"""
_Index = NDArray[np.int32]
_Mask = NDArray[np.bool_]


class DepthAlignment:
    """Aligns depth images to colour images. Where several surfaces come to one pixel, the nearest is seen.

    A pixel of depth covers as many pixels of colour as it is wide there. What only the colour camera sees stays
    unknown: the edge behind which the depth camera does not look.

    Args:
        depth: intrinsics of the depth camera.
        color: intrinsics of the colour camera.
        color_from_depth: pose of the depth camera in the optical frame of the colour camera.

    Raises:
        ValueError: if an image has more pixels than any has, or all that a depth image covers has.
    """

    def __init__(self, depth: Intrinsics, color: Intrinsics, color_from_depth: Pose) -> None:
        self._half = 0.5 * color.fx / depth.fx, 0.5 * color.fy / depth.fy
        """Pixels of colour, half the width and the height of a pixel of depth"""
        self._margin = math.ceil(2.0 * max(self._half)) + 1
        """Pixels around the ideal picture, for what is partly in it"""
        across, down = (math.ceil(2.0 * half) + 1 for half in self._half)
        _check_pixels("the image of colour", color.width, color.height)
        _check_pixels("what depth covers in it", depth.width * across, depth.height * down)
        self._depth, self._ideal = depth, color.pinhole()
        _check_pixels("its ideal picture", self._ideal.width + 2 * self._margin, self._ideal.height + 2 * self._margin)
        self._places = _places(color, self._ideal, self._margin)
        """(height, width) of colour: where in the ideal picture each pixel is seen"""
        x, y = depth.slopes()
        rotation = color_from_depth.rotation_matrix.astype(np.float32)
        shape = depth.height, depth.width
        self._rays = [np.broadcast_to(row[0] * x + row[1] * y + row[2], shape).ravel() for row in rotation]
        """For each axis of the colour camera, (pixels,) of the depth camera's viewing rays with z = 1"""
        self._shift = color_from_depth.translation.astype(np.float32)

    def align(self, depth: Depth) -> Depth:
        """(height, width) of colour, m along its optical axis, 0 where unknown, of such a depth image (m, 0 unknown).

        Raises `ValueError` for an image of another size than the depth camera's.
        """
        shape = self._depth.height, self._depth.width
        if depth.shape != shape:
            raise ValueError(f"a depth image of {depth.shape}; its intrinsics are about {shape}")
        flat = depth.ravel()
        known = np.flatnonzero(np.isfinite(flat) & (flat > 0.0))
        x, y, z = (flat[known] * ray[known] + shift for ray, shift in zip(self._rays, self._shift, strict=True))
        ahead = z > _NEAREST
        x, y, z = x[ahead], y[ahead], z[ahead]
        ideal = self._ideal
        u = x / z * np.float32(ideal.fx) + np.float32(ideal.cx)
        v = y / z * np.float32(ideal.fy) + np.float32(ideal.cy)
        drawn = self._drawn(u, v, z)
        return drawn[self._places]

    def _drawn(self, u: Depth, v: Depth, z: Depth) -> Depth:
        """The ideal picture with its margin, row by row, of pixels (n,) of depth whose middles are at `u`, `v`."""
        height, width, margin = self._ideal.height, self._ideal.width, self._margin
        seen = (u > -1.0) & (u < width) & (v > -1.0) & (v < height)
        u, v, z = u[seen], v[seen], z[seen]
        left, more_columns, most_columns = _covered(u, self._half[0])
        top, more_rows, most_rows = _covered(v, self._half[1])
        stride = width + 2 * margin
        first = (top + margin) * stride + left + margin
        nearest = np.full((height + 2 * margin) * stride, np.inf, np.float32)
        for down, across in itertools.product(range(most_rows + 1), range(most_columns + 1)):
            drawn = _all_of(more_rows if down == most_rows else None, more_columns if across == most_columns else None)
            np.minimum.at(nearest, first[drawn] + (down * stride + across), z[drawn])
        nearest[np.isinf(nearest)] = 0.0
        return nearest


def _check_pixels(what: str, width: int, height: int) -> None:
    if width * height > MOST_PIXELS:
        raise ValueError(f"{what} has {width} x {height} px; expected {MOST_PIXELS} at most")


def _covered(middle: Depth, half: float) -> tuple[_Index, _Mask, int]:
    """Which pixels are covered from `half` before a `middle` (n,) to as much behind it.

    The first (n,), how many more at most, and which (n,) cover as many: the others cover one less.
    """
    first, last = (np.rint(middle + np.float32(side)).astype(np.int32) for side in (-half, half))
    most = math.ceil(2.0 * half)
    return first, last - first >= most, most


def _all_of(some: _Mask | None, others: _Mask | None) -> _Mask | slice:
    """Those of both masks (n,); None is for all."""
    if some is None or others is None:
        chosen = others if some is None else some
        return slice(None) if chosen is None else chosen
    return some & others


def _places(color: Intrinsics, ideal: Intrinsics, margin: int) -> NDArray[np.intp]:
    """Indexes (height, width) into the ideal picture with its margin of what the pixels of a lens see.

    What is outside, nobody draws: the first pixel of the margin.
    """
    x, y = color.slopes()
    columns, rows = x * ideal.fx + ideal.cx, y * ideal.fy + ideal.cy
    inside = (columns > -0.5) & (columns < ideal.width - 0.5) & (rows > -0.5) & (rows < ideal.height - 0.5)
    column, row = (np.rint(np.where(inside, one, -margin)).astype(np.intp) + margin for one in (columns, rows))
    return row * (ideal.width + 2 * margin) + column
