"""An upright box or cylinder on a support: its outline in an image, and how far points are from its surface."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.scene_estimator.fitting import FrameView
from dsr.math3d.boxes import CORNERS
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Part, Shape
from dsr.math3d.transforms import Array

GRAZING = 1e-3
"""Cosine between a ray and the normal of a face, up to which the face looks away: it would be a line in the image."""

BlockKind = Literal["box", "cube", "cylinder"]
"""A cube is a box of which one edge tells all"""

_SLIVER = 1e-3  # m
_ROUND = np.linspace(0.0, 2.0 * math.pi, 32, endpoint=False)  # rad, corners of a prism around a cylinder
_OUT = 1.0 / math.cos(math.pi / len(_ROUND)) ** 0.5  # so that the prism has the area of the cylinder, nearly
_PRISM = np.array([[_OUT * math.cos(a), _OUT * math.sin(a), z] for z in (-1.0, 1.0) for a in _ROUND])


Faces = NDArray[np.intp]
"""(n,) on which face of a block each of n points is: the upper side, then the sides"""


class OnFaces(NamedTuple):
    """How points lie on a block."""

    distances: Array
    """(n,) m, outside their faces"""
    normals: Array
    """(n, 3) of the faces"""
    faces: Faces


class Block(NamedTuple):
    """An upright box or cylinder in the world frame."""

    kind: BlockKind
    x: float
    """m, of its centre"""
    y: float
    """m, of its centre"""
    yaw: float
    """rad, of its own x axis; 0 for a cylinder"""
    size: Vector3
    """m, extent along its own x, y, z; x and y are the diameter of a cylinder"""
    base: float
    """m, height in the world on which it stands"""

    @property
    def centre(self) -> Vector3:
        """Its middle, m."""
        return self.x, self.y, self.base + 0.5 * self.size[2]

    @property
    def is_round(self) -> bool:
        """Whether it is a cylinder."""
        return self.kind == "cylinder"

    @property
    def shape(self) -> Shape:
        """Its parts, as a node's attribute `shape` has them; none for a box."""
        return (Part("cylinder", self.size),) if self.is_round else ()

    def above(self, height: float) -> Block:
        """What of it is above a height of the world, m; if nothing is, its uppermost sliver."""
        top = self.base + self.size[2]
        base = min(max(self.base, height), top - _SLIVER)
        return self._replace(base=base, size=(*self.size[:2], top - base))

    def turned(self, quarters: int) -> Block:
        """The same box with its x axis along another of its edges."""
        x, y, z = self.size
        return self._replace(yaw=self.yaw + 0.5 * math.pi * quarters, size=(y, x, z) if quarters % 2 else self.size)

    def gap(self, other: Block) -> float:
        """Distance in m between the sides of two blocks seen from above, negative by how far one is in the other.

        It is the largest over the directions of their sides, and for round ones that from middle to middle: the theorem
        of separating axes. Between two corners it is less than their distance.
        """
        apart = np.array([other.x - self.x, other.y - self.y])
        angles = [one.yaw + turn for one in (self, other) if not one.is_round for turn in (0.0, 0.5 * math.pi)]
        if self.is_round or other.is_round:
            angles.append(math.atan2(apart[1], apart[0]))
        return max(
            abs(float(apart @ (math.cos(angle), math.sin(angle)))) - self._reach(angle) - other._reach(angle)
            for angle in angles
        )

    def _reach(self, angle: float) -> float:
        """How far its farthest side is from its middle, m, in a direction of the world (rad)."""
        half_x, half_y = 0.5 * self.size[0], 0.5 * self.size[1]
        if self.is_round:
            return half_x
        return half_x * abs(math.cos(angle - self.yaw)) + half_y * abs(math.sin(angle - self.yaw))

    def outline(self, view: FrameView) -> Array:
        """(n, 2) px, corners of its image, which is convex, in order."""
        corners = (_PRISM if self.is_round else CORNERS) * (0.5 * np.array(self.size))
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        world = corners @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + self.centre
        local = view.world_from_camera.inverse().apply(world)
        local[:, 2] = np.maximum(local[:, 2], 1e-3)
        pixels = view.intrinsics.project(local)
        return np.asarray(cv2.convexHull(pixels.astype(np.float32)).reshape(-1, 2), np.float64)

    def distances(self, points: Array, rays: Array, held: Faces | None = None) -> OnFaces:
        """How far points are outside the faces on which their rays end, negative within.

        The ray, not the point, tells the face: a point of the upper side with a wrong depth is none of a side. What is
        beyond a face that looks away is outside that one. The bottom, which nobody sees, is no face.

        Args:
            points: (n, 3) m, in the world.
            rays: (n, 3) unit vectors in the world, from the camera to the points.
            held: the faces that count instead; None for those on which the rays end.
        """
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        away = points - self.centre
        half_x, half_y, half_z = (0.5 * edge for edge in self.size)
        zero = np.zeros(len(points))
        faces = [(away[:, 2] - half_z, np.column_stack([zero, zero, zero + 1.0]))]
        if self.is_round:
            radius = np.hypot(away[:, 0], away[:, 1])
            out = away[:, :2] / np.maximum(radius, 1e-9)[:, None]
            faces.append((radius - half_x, np.column_stack([out, zero])))
        else:
            for x, y, half in ((c, s, half_x), (-s, c, half_y)):
                along = x * away[:, 0] + y * away[:, 1]
                normal = np.column_stack([x + zero, y + zero, zero])
                faces += [(along - half, normal), (-along - half, -normal)]
        beyond, normals = np.stack([face[0] for face in faces]), np.stack([face[1] for face in faces])
        face = _on_which(beyond, normals, rays) if held is None else held
        index = np.arange(len(points))
        return OnFaces(beyond[face, index], normals[face, index], face)


def _on_which(beyond: Array, normals: Array, rays: Array) -> Faces:
    """On which face rays (n, 3) end, of faces beyond which points are by (f, n) m, with normals (f, n, 3)."""
    facing = -np.einsum("fij,ij->fi", normals, rays)
    entered = np.where(facing > GRAZING, beyond / np.maximum(facing, GRAZING), -np.inf)
    behind = np.where((facing <= GRAZING) & (beyond > 0.0), beyond, -np.inf)
    return np.asarray(np.where(np.isfinite(behind.max(axis=0)), behind.argmax(axis=0), entered.argmax(axis=0)))


def inside(outline: Array, pixels: Array) -> NDArray[np.float64]:
    """How far (n,) px pixels (n, 2) are within a convex outline (m, 2), negative outside."""
    edges = np.roll(outline, -1, axis=0) - outline
    lengths = np.maximum(np.hypot(edges[:, 0], edges[:, 1]), 1e-9)
    offsets = pixels[:, None, :] - outline
    side = (edges[:, 0] * offsets[..., 1] - edges[:, 1] * offsets[..., 0]) / lengths
    turn = np.sign(np.sum(outline[:, 0] * np.roll(outline[:, 1], -1) - np.roll(outline[:, 0], -1) * outline[:, 1]))
    return np.asarray((turn * side)[:, lengths > 1e-3].min(axis=1))
