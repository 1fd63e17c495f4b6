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

BlockKind = Literal["box", "cube", "cylinder"]
"""A cube is a box of which one edge tells all"""

_ROUND = np.linspace(0.0, 2.0 * math.pi, 32, endpoint=False)  # rad, corners of a prism around a cylinder
_OUT = 1.0 / math.cos(math.pi / len(_ROUND)) ** 0.5  # so that the prism has the area of the cylinder, nearly
_PRISM = np.array([[_OUT * math.cos(a), _OUT * math.sin(a), z] for z in (-1.0, 1.0) for a in _ROUND])


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

    def turned(self, quarters: int) -> Block:
        """The same box with its x axis along another of its edges."""
        x, y, z = self.size
        return self._replace(yaw=self.yaw + 0.5 * math.pi * quarters, size=(y, x, z) if quarters % 2 else self.size)

    def outline(self, view: FrameView) -> Array:
        """(n, 2) px, corners of its image, which is convex, in order."""
        corners = (_PRISM if self.is_round else CORNERS) * (0.5 * np.array(self.size))
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        world = corners @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + self.centre
        local = view.world_from_camera.inverse().apply(world)
        local[:, 2] = np.maximum(local[:, 2], 1e-3)
        pixels = view.intrinsics.project(local)
        return np.asarray(cv2.convexHull(pixels.astype(np.float32)).reshape(-1, 2), np.float64)

    def distances(self, points: Array) -> tuple[Array, Array]:
        """How far (n,) m points (n, 3) of the world are outside its faces, negative within, and the normals (n, 3).

        The bottom, which nobody sees, is no face.
        """
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        away = points - self.centre
        along, across = c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]
        half_x, half_y, half_z = (0.5 * edge for edge in self.size)
        zero = np.zeros(len(points))
        top = away[:, 2] - half_z, np.column_stack([zero, zero, zero + 1.0])
        if self.is_round:
            radius = np.hypot(along, across)
            out = away[:, :2] / np.maximum(radius, 1e-9)[:, None]
            faces = [(radius - half_x, np.column_stack([out, zero])), top]
        else:
            by_x, by_y = np.sign(along), np.sign(across)
            faces = [
                (np.abs(along) - half_x, np.column_stack([c * by_x, s * by_x, zero])),
                (np.abs(across) - half_y, np.column_stack([-s * by_y, c * by_y, zero])),
                top,
            ]
        beyond = np.stack([distance for distance, _ in faces])
        nearest = beyond.argmax(axis=0)
        index = np.arange(len(points))
        return beyond[nearest, index], np.stack([normal for _, normal in faces])[nearest, index]


def inside(outline: Array, pixels: Array) -> NDArray[np.float64]:
    """How far (n,) px pixels (n, 2) are within a convex outline (m, 2), negative outside."""
    edges = np.roll(outline, -1, axis=0) - outline
    lengths = np.maximum(np.hypot(edges[:, 0], edges[:, 1]), 1e-9)
    offsets = pixels[:, None, :] - outline
    side = (edges[:, 0] * offsets[..., 1] - edges[:, 1] * offsets[..., 0]) / lengths
    turn = np.sign(np.sum(outline[:, 0] * np.roll(outline[:, 1], -1) - np.roll(outline[:, 0], -1) * outline[:, 1]))
    return np.asarray((turn * side)[:, lengths > 1e-3].min(axis=1))
