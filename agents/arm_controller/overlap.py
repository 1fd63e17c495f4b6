"""How far oriented boxes are apart, many pairs at once, by the separating axis theorem.

S. Gottschalk, M. Lin, D. Manocha, "OBBTree: A Hierarchical Structure for Rapid Interference Detection",
SIGGRAPH 1996. The gap along the best of the 15 axes is a lower bound of the distance.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

Array = NDArray[np.float64]
_PARALLEL = 1e-6  # below which the cross product of two edges gives no axis


class Boxes(NamedTuple):
    """Boxes as arrays over any leading shape."""

    centers: Array
    """Centres (..., 3) of the boxes, m."""
    axes: Array
    """(..., 3, 3) rotation matrices"""
    halves: Array
    """(..., 3) m, half their edges"""

    def at(self, index: NDArray[np.intp]) -> Boxes:
        """Select the boxes at `index` along the first axis."""
        return Boxes(self.centers[index], self.axes[index], self.halves[index])

    @property
    def radii(self) -> Array:
        """(...) m, of the spheres around them."""
        radii: Array = np.linalg.norm(self.halves, axis=-1)
        return radii


def stacked(things: Iterable[tuple[Pose, Vector3]]) -> Boxes:
    """(k) boxes at poses (frame_from_box, at their centres) with edges of m."""
    listed = list(things)
    matrices = np.array([pose.matrix for pose, _ in listed]).reshape(-1, 4, 4)
    halves = np.array([size for _, size in listed]).reshape(-1, 3) / 2
    return Boxes(matrices[:, :3, 3], matrices[:, :3, :3], halves)


def room(parts: Boxes, things: Boxes, margins: Array, checked: NDArray[np.bool_] | None = None) -> Array:
    """(m, k) m that is left between m sets of parts and each of k things beyond the margins; inf where there is plenty.

    Args:
        parts: (m, p) boxes.
        things: (k) boxes.
        margins: (m, p) m that each part keeps away.
        checked: (m, p, k) which pairs count; all if None.
    """
    away = np.linalg.norm(parts.centers[:, :, None] - things.centers, axis=-1)
    near = away < parts.radii[:, :, None] + things.radii + margins[:, :, None]
    if checked is not None:
        near &= checked
    row, part, thing = np.nonzero(near)
    left = np.full((len(margins), len(things.centers)), np.inf)
    pairs = Boxes(parts.centers[row, part], parts.axes[row, part], parts.halves[row, part])
    np.minimum.at(left, (row, thing), gaps(pairs, things.at(thing)) - margins[row, part])
    return left


def gaps(a: Boxes, b: Boxes) -> Array:
    """(n,) m between box pairs `a` (n) and `b` (n): positive is free space, negative how deep they overlap."""
    turn = np.swapaxes(a.axes, -1, -2) @ b.axes
    way = np.einsum("nji,nj->ni", a.axes, b.centers - a.centers)
    size = np.abs(turn)
    faces_a = np.abs(way) - a.halves - np.einsum("nij,nj->ni", size, b.halves)
    along_b = np.einsum("nij,ni->nj", turn, way)
    faces_b = np.abs(along_b) - b.halves - np.einsum("nij,ni->nj", size, a.halves)
    faces: Array = np.maximum(faces_a, faces_b).max(axis=1)
    return np.maximum(faces, _edge_gaps(a, b, turn, size, way))


def _edge_gaps(a: Boxes, b: Boxes, turn: Array, size: Array, way: Array) -> Array:
    """(n,) m, the greatest gap along the cross products of the edges."""
    best = np.full(len(way), -np.inf)
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            length = np.sqrt(np.maximum(1.0 - turn[:, i, j] ** 2, 0.0))
            reach_a = a.halves[:, i1] * size[:, i2, j] + a.halves[:, i2] * size[:, i1, j]
            reach_b = b.halves[:, j1] * size[:, i, j2] + b.halves[:, j2] * size[:, i, j1]
            apart = np.abs(way[:, i2] * turn[:, i1, j] - way[:, i1] * turn[:, i2, j]) - reach_a - reach_b
            usable = length > _PARALLEL
            best = np.maximum(best, np.where(usable, apart / np.where(usable, length, 1.0), -np.inf))
    return best
