"""Where something comes to rest that falls straight down, by the forms of what somebody takes to lie beneath."""

from __future__ import annotations

import math

import numpy as np

from dsr.elements import Node
from dsr.memory import Memory
from dsr.surfaces import Solids, crossings, surface
from dsr.transforms import Array, Pose
from dsr.visibility import bodies_of, read_posed, shape_of_thing

_DEEPEST = 10.0
"""m that something falls at most: no table or floor of a room is farther below."""
_SPACING = 3e-3
"""m between points of the underside: the thinnest walls that scenes may have are not missed."""
_MOST = 20_000
"""Points of the underside: more would take longer than a look may."""
_FACING = -0.1
"""Upward part of an outward normal, below which a face looks down. Side walls slide past what they touch."""


def fallen(world: Memory, thing: Node, where: Pose) -> Pose | None:
    """Where a thing comes to lie that falls straight down, without turning.

    Args:
        world: what somebody believes to be around, and where.
        thing: a node of that world with a shape or a size.
        where: world_from_thing before it falls.

    Returns:
        world_from_thing at the first contact, or None if nothing is beneath or nothing tells the form of the thing.
    """
    points = _underside(thing, where)
    posed = [one for one in read_posed(world) if one.name != thing.name]
    if not len(points) or not posed:
        return None
    deepest = min((_depth(body.solids, points) for body in bodies_of(world, posed)), default=_DEEPEST)
    return None if deepest >= _DEEPEST else Pose(tuple(where.translation - (0.0, 0.0, deepest)), where.q)


def _underside(thing: Node, where: Pose) -> Array:
    """Points (n, 3) m, in the world, on those faces of a thing that look down."""
    shape, size = shape_of_thing(thing), thing.get("size")
    if not shape:
        return np.empty((0, 3))
    size = size or (0.0, 0.0, 0.0)
    area = float(surface(shape, size).areas.sum())
    outside = surface(shape, size, min(math.ceil(area / _SPACING**2), _MOST) or 1)
    turn = where.matrix[:3, :3]
    below = (outside.normals @ turn.T)[:, 2] < _FACING
    return np.asarray(outside.points[below] @ turn.T + where.translation)


def _depth(solids: Solids, points: Array) -> float:
    """How far (m) points can move down until the first one meets a solid that it is not in already."""
    way = np.array([0.0, 0.0, -_DEEPEST])
    start = solids.into(points)
    enters, leaves = crossings(solids.kinds, solids.half, start, (way @ solids.turn)[:, None])
    met = (enters < leaves) & (enters >= 0.0) & (enters < 1.0)
    return float(np.where(met, enters, 1.0).min(initial=1.0)) * _DEEPEST
