"""Which pixels show an object of a known colour, whatever light falls on it."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.colors import DARKEST, TOLERANCE
from dsr.math3d.quaternions import Vector3

Mask = NDArray[np.bool_]

_SMALLEST_SPOT = 12  # px
_KERNEL = np.ones((3, 3), np.uint8)


class ColorImage:
    """An image in which `mask` finds the pixels of a colour, however bright the light on them is.

    Args:
        color: RGB image (h, w, 3), 0 to 255.
    """

    def __init__(self, color: NDArray[np.uint8]) -> None:
        values = color.astype(np.float32)
        length = np.sqrt(np.einsum("hwc,hwc->hw", values, values))
        self._directions = values / np.maximum(length, 1.0)[..., None]
        self._is_dark = length < 255.0 * DARKEST

    def mask(self, color: Vector3) -> Mask:
        """(h, w) the pixels of a colour, without specks."""
        direction = np.array(color, np.float32) / np.float32(max(math.hypot(*color), 1e-9))
        alike = (self._directions @ direction > math.cos(TOLERANCE)) & ~self._is_dark
        opened = cv2.morphologyEx(alike.astype(np.uint8), cv2.MORPH_OPEN, _KERNEL)
        count, labels, statistics, _ = cv2.connectedComponentsWithStats(opened, connectivity=8)
        large = statistics[:, cv2.CC_STAT_AREA] >= _SMALLEST_SPOT
        large[0] = False  # the background
        return np.asarray(large[labels] if count > 1 else np.zeros(alike.shape, bool))
