"""How much of a thing a camera sees at many places where it may be, at one time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Part
from dsr.math3d.surfaces import Solids
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics

Array = NDArray[np.float64]

_TINY = 1e-12  # stands for what must not be divided by
_THIRD = 2.0 / 3.0  # of half an edge, where the middle of the outer third of a side is
_SIDES = [(axis, sign) for axis in range(3) for sign in (-1.0, 1.0)]
_NORMALS = np.array([[sign * (axis == part) for part in range(3)] for axis, sign in _SIDES for _ in range(9)])
"""(54, 3) outward normals of the points on a box"""
_GRID = _NORMALS + np.array(
    [np.insert(spread, axis, 0.0) for axis, _ in _SIDES for spread in product((-_THIRD, 0.0, _THIRD), repeat=2)]
)
"""(54, 3) points on a box, in half edges"""


@dataclass(frozen=True)
class CameraSight:
    """A camera and what stands in its way, at one time."""

    world_from_camera: Pose
    intrinsics: Intrinsics
    obstacles: tuple[Part, ...] = ()
    """Solids in the world that hide what is behind them."""
    names: tuple[str, ...] = ()
    """Name of each obstacle; something does not hide itself"""

    def shares(self, name: str, size: Vector3, position: Array, rotation: Array) -> Array:
        """(n,) visible share of a box at n places.

        Args:
            name: of the thing; an obstacle of that name is left out.
            size: (3,) m.
            position: (n, 3) m in the world.
            rotation: (n, 3, 3) world_from_body.
        """
        if not len(position):
            return np.zeros(0)
        half, eye = 0.5 * np.array(size), np.array(self.world_from_camera.t)
        points = position[:, None] + (_GRID * half) @ rotation.transpose(0, 2, 1)
        ray = eye - points
        areas = (np.prod(half) / half) @ np.abs(_NORMALS).T
        facing = (ray * (_NORMALS @ rotation.transpose(0, 2, 1))).sum(axis=2) * areas
        distance = np.sqrt((ray * ray).sum(axis=2))
        weights = np.maximum(facing, 0.0) / distance**2 / distance
        shown = self._shown(points.reshape(-1, 3), name, (weights > 0.0).reshape(-1)).reshape(weights.shape)
        return np.asarray((weights * shown).sum(axis=1) / np.maximum(weights.sum(axis=1), _TINY))

    def _shown(self, points: Array, name: str, asked: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which of the points (n, 3) that are asked for are in the image and not hidden by anything but `name`."""
        seen = asked & self._in_image(points)
        others = [part for part, other in zip(self.obstacles, self.names, strict=True) if other != name]
        if others and seen.any():
            hidden = Solids.of(others).cut_off(np.array(self.world_from_camera.t), points[seen]).any(axis=0)
            seen[seen] = ~hidden
        return seen

    def _in_image(self, points: Array) -> NDArray[np.bool_]:
        rotation = np.array(quaternions.to_matrix(self.world_from_camera.q))
        local = (points - self.world_from_camera.t) @ rotation
        depth = np.maximum(local[:, 2], _TINY)
        lens = self.intrinsics
        u = lens.fx * local[:, 0] / depth + lens.cx
        v = lens.fy * local[:, 1] / depth + lens.cy
        inside = (local[:, 2] > 0) & (u >= 0) & (v >= 0) & (u < lens.width) & (v < lens.height)
        return np.asarray(inside)


def matrices(rotations: Sequence[Sequence[float]] | Array) -> Array:
    """(n, 3, 3) of quaternions (n, 4)."""
    found = [quaternions.to_matrix((float(x), float(y), float(z), float(w))) for x, y, z, w in rotations]
    return np.array(found, dtype=np.float64).reshape(-1, 3, 3)
