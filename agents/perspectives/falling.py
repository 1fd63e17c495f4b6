"""Computes where a thing that falls straight down comes to rest, by the forms of the bodies believed below."""

from __future__ import annotations

import math

import numpy as np

from dsr.graph.elements import Node
from dsr.math3d.surfaces import room_below, underside
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.visibility import bodies_of, read_posed, shape_of_thing


def fallen(world: Memory, thing: Node, where: Pose) -> Pose | None:
    """Compute the pose at which a thing comes to lie that falls straight down, without turning;

    None if nothing is below.

    Args:
        world: what somebody believes to be around, and where.
        thing: a node of that world with a shape or a size.
        where: world_from_thing before it falls.

    Returns:
        world_from_thing at the first contact, or None if nothing is beneath or nothing tells the form of the thing.
    """
    shape, size = shape_of_thing(thing), thing.get("size", (0.0, 0.0, 0.0))
    points = underside(shape, size, where.matrix) if shape else np.empty((0, 3))
    posed = [one for one in read_posed(world) if one.name != thing.name]
    if not len(points) or not posed:
        return None
    depth = min(room_below(points, body.solids) for body in bodies_of(world, posed))
    return Pose(tuple(where.translation - (0.0, 0.0, depth)), where.q) if math.isfinite(depth) else None
