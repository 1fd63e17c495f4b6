"""How far a body must go until it no longer reaches into another one, turned as they may be."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import product

import numpy as np

from dsr.math3d.boxes import Array, depths_along, stacked
from simulation_handler.scales import GAP
from simulation_handler.shapes.geometry import Solid


def depenetrated(solid: Solid, others: Iterable[Solid], direction: Array) -> Solid:
    """The solid, moved along a unit vector (3,) until it reaches into none of the others.

    Of bodies of several pieces these count; round ones as the boxes around them. What leads out of one may lead into
    another one, but never into one that was left: all are convex.
    """
    obstacles = [part for other in others if other.name != solid.name for part in other.parts]
    for _ in product(solid.parts, obstacles):
        pairs = [pair for pair in product(solid.parts, obstacles) if _are_near(*pair)]
        if not pairs:
            break
        these, those = (stacked((part.pose, part.size) for part in side) for side in zip(*pairs, strict=True))
        depth = float(depths_along(these, those, direction).max())
        if depth <= 0.0:
            break
        x, y, z = (np.array(solid.position) + (depth + GAP) * direction).tolist()
        solid = solid.moved((x, y, z))
    return solid


def _are_near(a: Solid, b: Solid) -> bool:
    """Whether the spheres around two bodies meet."""
    return math.dist(a.position, b.position) < a.radius + b.radius
