"""Colours of the plant's world, and how far two are apart for who recognises objects by them, whatever light there is.

Light scales red, green and blue alike, so a colour is a direction, and the angle between two is their distance: the
spectral angle (F. A. Kruse et al., "The spectral image processing system", Remote Sensing of Environment 44, 1993).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

TOLERANCE = math.radians(6.0)
"""rad of hue by which an object's pixels may differ from its colour"""
APART = 2.0 * TOLERANCE
"""rad, how far the colours of two objects must be apart to tell them by"""
DARKEST = 40.0 / 255.0
"""Length of (red, green, blue), each 0 to 1, of a pixel, below which noise is all the colour there is."""
SHADE = 0.45
"""Share of an object's colour that the plant's image shows where least light falls on it."""

Color = tuple[float, float, float]
TABLE: Color = (0.62, 0.52, 0.40)
FLOOR: Color = (0.45, 0.45, 0.47)
SKIN: Color = (0.88, 0.65, 0.54)
SLEEVE: Color = (0.25, 0.27, 0.33)
GREY: Color = (1.0, 1.0, 1.0)
"""Colour of tags, and nearly of arms and the surroundings of the table."""
PALETTE: tuple[Color, ...] = (
    (0.80, 0.32, 0.28), (0.30, 0.52, 0.80), (0.36, 0.66, 0.36), (0.85, 0.66, 0.24), (0.56, 0.40, 0.72),
)  # fmt: skip
"""Colours, in turn, of objects for which nobody chose one."""


def spectral_angle(a: Sequence[float], b: Sequence[float]) -> float:
    """The angle between two colours (red, green, blue), rad; black is at a right angle to all."""
    lengths = math.hypot(*a) * math.hypot(*b)
    if lengths == 0.0:
        return 0.5 * math.pi
    return math.acos(min(1.0, sum(x * y for x, y in zip(a, b, strict=True)) / lengths))
