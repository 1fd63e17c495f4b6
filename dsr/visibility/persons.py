"""The body of a person, simple as it is: a head around the eyes, and an upright trunk with the legs below it."""

from __future__ import annotations

import math

import numpy as np

from dsr.math3d.shapes import Part, Shape
from dsr.math3d.transforms import Array

HEAD: Shape = (Part("box", (0.2, 0.16, 0.25), (-0.09, 0.0, 0.0)),)
"""Shape of the head in the person's frame, which is between the eyes."""
TRUNK: Shape = (Part("box", (0.24, 0.44, 1.3), (-0.09, 0.0, -0.87)),)
"""Shape of the body below the head in the frame `upright`.

Of a person who sits, the lower end is below the floor, which hides nothing.
"""


def upright(world_from_person: Array) -> Array:
    """(4, 4) the frame at a person's eyes with z up, turned as their shoulders are, wherever they look up or down."""
    x, y = world_from_person[1, 1], -world_from_person[0, 1]  # across what is on the left
    length = math.hypot(x, y)
    x, y = (x / length, y / length) if length > 1e-6 else (1.0, 0.0)
    matrix = np.eye(4)
    matrix[:2, :2] = (x, -y), (y, x)
    matrix[:3, 3] = world_from_person[:3, 3]
    return matrix
