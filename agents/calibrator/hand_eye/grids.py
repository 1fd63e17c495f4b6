"""Grids of pixels: which of the two hands they have."""

from __future__ import annotations

import numpy as np

from dsr.math3d.transforms import Array


def upright(grid: Array) -> Array:
    """A grid (rows, columns, 2) px as it looks from the front: rows follow columns clockwise. NaN does not count."""
    along, down = np.nanmean(np.diff(grid, axis=1), axis=(0, 1)), np.nanmean(np.diff(grid, axis=0), axis=(0, 1))
    is_mirrored = along[0] * down[1] - along[1] * down[0] < 0.0
    return grid[::-1].copy() if is_mirrored else grid.copy()
