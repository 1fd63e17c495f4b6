"""Colours of objects that are recognised by them: how far two are apart, whatever light falls on them.

Light scales red, green and blue alike, so a colour is a direction, and the angle between two is their distance: the
spectral angle (F. A. Kruse et al., "The spectral image processing system", Remote Sensing of Environment 44, 1993).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

TOLERANCE = math.radians(6.0)
"""rad, how far what is seen of an object may be from its colour"""
APART = 2.0 * TOLERANCE
"""rad, how far the colours of two objects must be apart to tell them by"""


def spectral_angle(a: Sequence[float], b: Sequence[float]) -> float:
    """The angle between two colours (red, green, blue), rad; black is at a right angle to all."""
    lengths = math.hypot(*a) * math.hypot(*b)
    if lengths == 0.0:
        return 0.5 * math.pi
    return math.acos(min(1.0, sum(x * y for x, y in zip(a, b, strict=True)) / lengths))
