"""Oriented bounding boxes: their extents, their footprints on the ground, and how these overlap; pure, z is up."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from dsr.math3d import polygons
from dsr.math3d.polygons import Point, hull
from dsr.math3d.quaternions import Rows3, Vector3, to_matrix
from dsr.math3d.transforms import Pose


@dataclass(frozen=True)
class Box:
    """A box somewhere in the world."""

    pose: Pose
    """world_from_box, the frame at its centre."""
    size: Vector3
    """Edge lengths along its axes, m."""

    @cached_property
    def _axes(self) -> Rows3:
        """The matrix world_from_box; column k is axis k."""
        return to_matrix(self.pose.q)

    def extent(self, direction: Vector3) -> tuple[float, float]:
        """Least and greatest coordinate (m) along a unit vector in the world."""
        middle = sum(a * b for a, b in zip(direction, self.pose.t, strict=True))
        rows = self._axes
        half = 0.5 * sum(
            edge * abs(sum(direction[i] * rows[i][k] for i in range(3))) for k, edge in enumerate(self.size)
        )
        return middle - half, middle + half

    @cached_property
    def height(self) -> tuple[float, float]:
        """Height (z) of its lowest and its highest point, m."""
        return self.extent((0.0, 0.0, 1.0))

    @property
    def bottom(self) -> float:
        """Height (z) of its lowest point, m."""
        return self.height[0]

    @property
    def top(self) -> float:
        """Height (z) of its highest point, m."""
        return self.height[1]

    @cached_property
    def diagonal(self) -> float:
        """Length, m."""
        return math.hypot(*self.size)

    @cached_property
    def footprint(self) -> tuple[Point, ...]:
        """Corners of its vertical projection onto the ground (m), a convex polygon, counter-clockwise."""
        (x, y, _), rows = self.pose.t, self._axes
        corners = []
        for signs in range(8):
            half = [0.5 * edge * (1.0 if signs >> k & 1 else -1.0) for k, edge in enumerate(self.size)]
            corners.append(
                (x + sum(a * h for a, h in zip(rows[0], half, strict=True)),
                 y + sum(a * h for a, h in zip(rows[1], half, strict=True)))
            )  # fmt: skip
        return tuple(hull(corners))

    @cached_property
    def width(self) -> float:
        """The greatest distance between two corners of its footprint, m."""
        return max(math.dist(a, b) for a in self.footprint for b in self.footprint)


def overlap(a: Box, b: Box) -> float:
    """How far the footprints reach into each other (m): how far one must be moved until they only touch.

    Negative if they are apart (then no more than the distance).
    """
    (ax, ay, _), (bx, by, _) = a.pose.t, b.pose.t
    apart = math.hypot(ax - bx, ay - by) - 0.5 * (a.diagonal + b.diagonal)
    if apart > 0.0:
        return -apart
    return polygons.overlap(a.footprint, b.footprint)[0]


def inclusion(a: Box, b: Box) -> float:
    """How far the footprint of `a` stays within that of `b` (m); negative: how far it sticks out."""
    return polygons.inclusion(a.footprint, b.footprint)


def gap(a: Box, b: Box) -> float:
    """Distance between the footprints, m; negative, as deep as they overlap, if they do."""
    return polygons.gap(a.footprint, b.footprint)
