"""Oriented boxes, balls and bodies: how deep two overlap, and how far one is above what lies below it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import msgspec
import numpy as np

from dsr.math3d import quaternions
from dsr.math3d.boxes import Array, Boxes, gaps
from dsr.math3d.polygons import Polygon, hull
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Shape, box
from dsr.math3d.surfaces import Solids, room_below, signed_distances, underside
from dsr.math3d.transforms import Pose

_FACE = 0.4  # of an object's shorter side, from the middle of its upper face: as far as a tag reaches
_SKIN = 1e-4  # m, below the upper face
_STEEPEST = math.sqrt(2.0)
"""Lift for each metre of depth that frees what sank through a face: faces steeper than 45 degrees are sides."""
_ROUNDING = 1e-9
"""Of a depth, that is left by rounding when it was lifted."""


class ScenarioBox(msgspec.Struct, frozen=True):
    """An oriented box."""

    center: Array
    """(3,) m, centre of the box in the world"""
    rotation: Array
    """(3, 3) world_from_box; its columns are the axes of the box"""
    size: Array
    """(3,) m, along its own axes"""

    @property
    def as_boxes(self) -> Boxes:
        """It alone, (1)."""
        return Boxes(self.center[None], self.rotation[None], 0.5 * self.size[None])

    @property
    def corners(self) -> Array:
        """(8, 3) m, world."""
        corners: Array = self.as_boxes.corners[0]
        return corners

    @property
    def footprint(self) -> Polygon:
        """Its outline seen from above, m."""
        return hull([(x, y) for x, y, _ in self.corners.tolist()])

    @property
    def bottom(self) -> float:
        """World z of the lowest corner, m."""
        return float(self.corners[:, 2].min())

    @property
    def top(self) -> float:
        """World z of the highest corner, m."""
        return float(self.corners[:, 2].max())


class PlacedShape(NamedTuple):
    """A thing somewhere."""

    shape: Shape
    """Parts of the shape, in the body's frame; none: it is the box of `size`."""
    size: Vector3
    """m, edge lengths of the bounding box"""
    pose: Pose
    """world_from_body"""


class Ball(msgspec.Struct, frozen=True):
    """A ball."""

    center: Array
    """(3,) m, centre of the ball in the world"""
    radius: float
    """m, radius of the ball"""


def pieces(shape: Shape, body: ScenarioBox) -> list[ScenarioBox | Ball]:
    """List the pieces of a body with the bounding box `body`, in the world; a cylinder counts as the box around it."""
    found: list[ScenarioBox | Ball] = []
    for part in shape or box(_vector(body.size)):
        center = body.center + body.rotation @ np.array(part.position)
        if part.kind == "sphere":
            found.append(Ball(center, 0.5 * part.size[0]))
        else:
            turn = np.array(quaternions.to_matrix(part.rotation))
            found.append(ScenarioBox(center, body.rotation @ turn, np.array(part.size)))
    return found


def has_face(shape: Shape, size: Vector3) -> bool:
    """Whether the upper face of a body's bounding box is closed where a tag would be."""
    reach, height = _FACE * min(size[:2]), 0.5 * size[2] - _SKIN
    steps = (-reach, 0.0, reach)
    return not shape or all(any(part.contains((x, y, height)) for part in shape) for x in steps for y in steps)


def overlap(a: ScenarioBox | Ball, b: ScenarioBox | Ball) -> float:
    """Least distance (m) by which `a` must be moved to be free of `b`; negative: how far they are apart, at least."""
    if isinstance(a, ScenarioBox) and isinstance(b, ScenarioBox):
        return penetration(a, b)
    if isinstance(a, Ball) and isinstance(b, Ball):
        return a.radius + b.radius - float(np.linalg.norm(a.center - b.center))
    ball, block = (a, b) if isinstance(a, Ball) else (b, a)
    assert isinstance(ball, Ball) and isinstance(block, ScenarioBox)
    inside = block.rotation.T @ (ball.center - block.center)
    return ball.radius - float(signed_distances((), _vector(block.size), inside[None])[0])


def upright_box(position: Iterable[float], yaw: float, size: Iterable[float]) -> ScenarioBox:
    """A box centred at `position` (m) that is only turned by `yaw` (rad) about world z."""
    c, s = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return ScenarioBox(np.array(tuple(position)), rotation, np.array(tuple(size)))


def penetration(a: ScenarioBox, b: ScenarioBox) -> float:
    """Least distance (m) by which `a` must be moved to be free of `b`; negative: a gap along the best axis."""
    return -float(gaps(a.as_boxes, b.as_boxes)[0])


def gap_below(body: PlacedShape, others: Iterable[PlacedShape]) -> float:
    """How far (m) a body can fall straight down until it meets another; negative: how deep it sank into one below.

    What it only touches or overlaps with its sides holds nothing up. Infinite if nothing is below.
    """
    points = underside(body.shape, body.size, body.pose.matrix)
    around = [Solids.of(other.shape or box(other.size)).moved(other.pose.matrix) for other in others]
    sunk = max((_sunk(points, solids) for solids in around), default=0.0)
    return -sunk if sunk > 0.0 else min((room_below(points, solids) for solids in around), default=math.inf)


def _sunk(points: Array, solids: Solids) -> float:
    """How deep (m) the deepest of some points (n, 3) is below a face of solids that it could have come through."""
    found = 0.0
    depths = np.maximum(-solids.signed_distances(points), 0.0)
    for index, depth in enumerate(depths):
        inside = depth > 0.0
        raised = points[inside] + np.outer(_STEEPEST * depth[inside], (0.0, 0.0, 1.0))
        freed = solids.signed_distances(raised)[index] >= -_ROUNDING * depth[inside]
        found = max(found, float(depth[inside][freed].max(initial=0.0)))
    return found


def _vector(size: Array) -> Vector3:
    x, y, z = size.tolist()
    return x, y, z
