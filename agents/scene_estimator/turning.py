"""Which turns about its own z axis a shape shows: none if it is round, and only some of them if it is symmetric."""

from __future__ import annotations

import functools
import math

import numpy as np

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.math3d.shapes import Shape
from dsr.math3d.surfaces import distances, surface

ROUND = 0
"""The order of shapes that look alike however they are turned"""

_MOST = 6  # equal turns of what is not round, as far as anybody could tell
_ALIKE = 5e-4  # m, between surfaces that look alike
_ODD = 1.0  # rad, no fraction of a turn


@functools.lru_cache(maxsize=256)
def order(shape: Shape, size: Vector3) -> int:
    """Count the equal turns about its z axis after which a shape looks as before; `ROUND` if any turn does.

    Args:
        shape: without parts, a box of `size` m.
        size: edge lengths of its bounding box, m.
    """
    if _is_alike(shape, size, _ODD):
        return ROUND
    return next(count for count in range(_MOST, 0, -1) if _is_alike(shape, size, 2.0 * math.pi / count))


def nearest_alike(yaw: float, before: float, count: int) -> float:
    """Choose the yaw (rad) nearest to the one before, of those that look like `yaw` with a shape of order `count`."""
    if count == ROUND:
        return before
    apart = 2.0 * math.pi / count
    return yaw + apart * round((before - yaw) / apart)


def nearest_turn(rotation: Quaternion, before: Quaternion, count: int) -> Quaternion:
    """Choose the rotation nearest to the one before, of the turns about the own z axis after which an object looks the
    same.

    Args:
        rotation: world_from_object, as it is seen to be, with a shape of order `count`.
        before: world_from_object
        count: not `ROUND`.
    """
    alike = [
        quaternions.product(rotation, quaternions.from_rotvec((0.0, 0.0, 2.0 * math.pi * k / count)))
        for k in range(count)
    ]
    return max(alike, key=lambda one: abs(sum(a * b for a, b in zip(one, before, strict=True))))


def _is_alike(shape: Shape, size: Vector3, angle: float) -> bool:
    c, s = math.cos(angle), math.sin(angle)
    turned = surface(shape, size).points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return bool(distances(shape, size, turned).max(initial=0.0) < _ALIKE)
