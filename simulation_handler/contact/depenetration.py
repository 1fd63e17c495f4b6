"""How far a body must go until it no longer reaches into another one, turned as they may be."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from dsr.math3d import quaternions
from simulation_handler.shapes.geometry import Solid

Array = NDArray[np.float64]

_ROUNDS = 3  # what leads out of one may lead into another
_GAP = 5e-5  # m that are left between the two
_PARALLEL = 1e-6  # sine of an angle, or cosine, from which two directions count as parallel, or as perpendicular


def depenetrated(solid: Solid, others: Iterable[Solid], direction: Array) -> Solid:
    """The solid, moved along a unit vector (3,) until it reaches into none of the others.

    Of bodies of several pieces these count; round ones as the boxes around them.
    """
    obstacles = [part for other in others if other.name != solid.name for part in other.parts]
    for _ in range(_ROUNDS):
        depth = max((_depth_along(*pair, direction) for pair in product(solid.parts, obstacles)), default=0.0)
        if depth <= 0.0:
            break
        x, y, z = (np.array(solid.position) + (depth + _GAP) * direction).tolist()
        solid = solid.moved((x, y, z))
    return solid


def _depth_along(solid: Solid, other: Solid, direction: Array) -> float:
    """How far (m) one box must go along a unit vector (3,) to leave another one; 0 if they are apart.

    By separating axes (Gottschalk et al., "OBBTree", SIGGRAPH 1996): two boxes are apart if they are along a face
    normal of either, or along the cross product of two edges. On its way out, it leaves along the first of those.
    """
    between = np.array(solid.position) - np.array(other.position)
    if math.hypot(*between) >= solid.radius + other.radius:
        return 0.0
    first, second = (np.array(quaternions.to_matrix(box.rotation)) for box in (solid, other))
    axes = np.array(list(_axes(first, second)))
    reach = 0.5 * (np.abs(axes @ first) @ np.array(solid.size) + np.abs(axes @ second) @ np.array(other.size))
    apart = axes @ between
    if np.any(np.abs(apart) >= reach):
        return 0.0
    speed = axes @ direction
    leaving = np.abs(speed) > _PARALLEL
    depths = (reach[leaving] - np.sign(speed[leaving]) * apart[leaving]) / np.abs(speed[leaving])
    return float(depths.min())


def _axes(first: Array, second: Array) -> Iterator[Array]:
    yield from first.T
    yield from second.T
    for a in first.T:
        for b in second.T:
            cross = np.cross(a, b)
            length = float(np.linalg.norm(cross))
            if length > _PARALLEL:
                yield cross / length
