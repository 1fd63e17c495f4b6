"""Turned squares of an image: where the model looks for a hand's landmarks, and the pictures cut out of them.

As MediaPipe's published graph `hand_landmark_tracking` cuts them: about the palm that its detector found, or about the
landmarks of the frame before. Places are in pixels from the image's upper left corner.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.frame_images import Color

Array = NDArray[np.float64]

_PALM_SCALE, _PALM_SHIFT = 2.6, 0.5
"""Sides of the square by sides of the palm's box, and how far, in sides of that box, it is moved to the fingers; as in
the graph, on whose squares the model was trained."""
_HAND_SCALE, _HAND_SHIFT = 2.0, 0.1
"""Likewise, by the box around the landmarks of `_INNER`."""
_INNER = (0, 1, 2, 3, 5, 6, 9, 10, 13, 14, 17, 18)
"""Landmarks that fingers move little: wrist, thumb without its tip, and the two nearest joints of each finger."""
_WRIST, _INDEX, _MIDDLE, _RING = 0, 5, 9, 13  # landmarks: the wrist and three knuckles


class Region(NamedTuple):
    """A square of an image."""

    centre: tuple[float, float]
    """px"""
    side: float
    """px"""
    turn: float
    """rad, clockwise as one looks at the image; at 0 the fingers point up"""

    def in_image(self, points: Array) -> Array:
        """Places (n, 2) px of points given in sides of the square, (0, 0) its upper left corner."""
        cosine, sine = math.cos(self.turn), math.sin(self.turn)
        turned = (points - 0.5) @ np.array([[cosine, sine], [-sine, cosine]])
        return np.asarray(turned * self.side + self.centre)


def cut_out(color: Color, region: Region, pixels: int, border: int) -> NDArray[np.float32]:
    """(1, pixels, pixels, 3) the picture of a region, 0 to 1; `border` is OpenCV's way to go on outside the image.

    As in MediaPipe, the centres of the upper left pixels are laid on the region's corner, not half a pixel inside:
    where pixels are shrunk that is another picture, and landmarks differ by 2 % of a palm's length.
    """
    first, right, below = region.in_image(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]) / pixels)
    matrix = np.column_stack([right - first, below - first, first])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    picture = cv2.warpAffine(color, matrix, (pixels, pixels), flags=flags, borderMode=border)
    return np.asarray(picture[None], np.float32) / np.float32(255.0)


def whole_image(color: Color) -> Region:
    """The least square about all of an image."""
    height, width = color.shape[:2]
    return Region((width / 2, height / 2), float(max(width, height)), 0.0)


def about_palm(box: Array, wrist: Array, middle: Array) -> Region:
    """The square for a palm's box (4,), left, top, right, bottom, whose wrist and middle knuckle are at points (2,)."""
    size = box[2:] - box[:2]
    turn = _turn(middle - wrist)
    return _moved((box[:2] + box[2:]) / 2, size, turn, _PALM_SCALE, _PALM_SHIFT)


def about_hand(pixels: Array) -> Region:
    """The square for a hand whose landmarks (21, 2) were found in the frame before."""
    knuckles = 0.25 * (pixels[_INDEX] + pixels[_RING]) + 0.5 * pixels[_MIDDLE]
    turn = _turn(knuckles - pixels[_WRIST])
    cosine, sine = math.cos(turn), math.sin(turn)
    upright = np.array([[cosine, -sine], [sine, cosine]])
    inner = pixels[list(_INNER)] @ upright
    low, high = inner.min(axis=0), inner.max(axis=0)
    return _moved(upright @ ((low + high) / 2), high - low, turn, _HAND_SCALE, _HAND_SHIFT)


def overlap(a: Region, b: Region) -> float:
    """Intersection over union of two squares as if neither were turned."""
    across = [min(a.side, b.side, (a.side + b.side) / 2 - abs(x - y)) for x, y in zip(a.centre, b.centre, strict=True)]
    common = max(across[0], 0.0) * max(across[1], 0.0)
    return common / max(a.side**2 + b.side**2 - common, 1e-9)


def _turn(up: Array) -> float:
    """rad, by which an image is turned clockwise in which `up` (2,) points to the fingers."""
    return math.atan2(float(up[0]), float(-up[1]))


def _moved(middle: Array, size: Array, turn: float, scale: float, shift: float) -> Region:
    """The square for a box of a size (2,) about a point (2,)."""
    far = shift * float(size[1])
    x, y = float(middle[0]) + far * math.sin(turn), float(middle[1]) - far * math.cos(turn)
    return Region((x, y), scale * float(size.max()), turn)
