"""Draws what the model found into an image, for people to look at."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.frame_images import Color
from agents.hand_tracker.model.found import FoundHand
from agents.hand_tracker.sighting import TIPS

_BONES = ((0, 1), (0, 5), (5, 9), (9, 13), (13, 17), (0, 17), *((k, k + 1) for k in range(20) if k % 4))
_COLORS = {"right": (40, 200, 40), "left": (60, 90, 240), "unknown": (160, 160, 160)}
"""RGB by the hand's side."""
_PER_PIXEL = 1 / 400  # thickness of lines, by the image's longer side


def drawn(color: Color, hands: Iterable[FoundHand]) -> NDArray[np.uint8]:
    """(h, w, 3) the image with the bones of the hands: green right ones, blue left ones; fingertips as circles."""
    image = np.array(color)
    thickness = max(1, round(max(image.shape) * _PER_PIXEL))
    for hand in hands:
        tint = _COLORS[hand.side]
        points = [(round(float(x)), round(float(y))) for x, y in np.clip(hand.landmarks[:, :2], -1e4, 1e4)]
        for a, b in _BONES:
            cv2.line(image, points[a], points[b], tint, thickness, cv2.LINE_AA)
        for tip in TIPS:
            cv2.circle(image, points[tip], 3 * thickness, tint, -1, cv2.LINE_AA)
    return image
