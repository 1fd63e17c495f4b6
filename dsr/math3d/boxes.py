"""Oriented boxes, many at once: their corners, and how far pairs of them are apart.

Both follow from the separating axis theorem: two boxes are apart if they are along a face normal of either, or along
the cross product of two edges. S. Gottschalk, M. Lin, D. Manocha, "OBBTree: A Hierarchical Structure for Rapid
Interference Detection", SIGGRAPH 1996.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

Array = NDArray[np.float64]

CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
"""(8, 3) where the corners of a box are, in halves of its edges from its centre."""

_PARALLEL = 1e-6  # sine of an angle, or cosine, from which two directions count as parallel, or as perpendicular
_NEXT, _LAST = [1, 2, 0], [2, 0, 1]  # the axes after each one, in cyclic order


class Boxes(NamedTuple):
    """Boxes as arrays over any leading shape."""

    centers: Array
    """(..., 3) m"""
    axes: Array
    """(..., 3, 3) rotation matrices frame_from_box"""
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

    @property
    def corners(self) -> Array:
        """(..., 8, 3) m, in the order of `CORNERS`."""
        local = CORNERS * self.halves[..., None, :]
        corners: Array = self.centers[..., None, :] + local @ np.swapaxes(self.axes, -1, -2)
        return corners


def stacked(things: Iterable[tuple[Pose, Vector3]]) -> Boxes:
    """(k) boxes at poses (frame_from_box, at their centres) with edges of m."""
    listed = list(things)
    matrices = np.array([pose.matrix for pose, _ in listed]).reshape(-1, 4, 4)
    halves = np.array([size for _, size in listed]).reshape(-1, 3) / 2
    return Boxes(matrices[:, :3, 3], matrices[:, :3, :3], halves)


def gaps(a: Boxes, b: Boxes) -> Array:
    """(n,) m between box pairs `a` (n) and `b` (n), along the best axis: a lower bound of their distance.

    Negative is how far one must at least be moved to be free of the other.
    """
    pairs = _Pairs(a, b)
    gaps: Array = (np.abs(pairs.along_axes(b.centers - a.centers)) - pairs.reach()).max(axis=0)
    return gaps


def depths_along(a: Boxes, b: Boxes, direction: Array) -> Array:
    """(n,) m that boxes `a` (n) must go along a unit vector (3,) to leave boxes `b` (n); 0 for pairs that are apart.

    On its way out, a box leaves along the first of the axes.
    """
    pairs = _Pairs(a, b)
    reach, apart = pairs.reach(), pairs.along_axes(a.centers - b.centers)
    speed = pairs.along_axes(np.broadcast_to(direction, a.centers.shape))
    leaving = np.abs(speed) > _PARALLEL
    ways = (reach - np.sign(speed) * apart) / np.where(leaving, np.abs(speed), 1.0)
    met = (np.abs(apart) < reach).all(axis=0)
    return np.asarray(np.where(met, np.where(leaving, ways, np.inf).min(axis=0), 0.0))


class _Pairs:
    """n pairs of boxes, with the 15 axes that may separate each; the pairs are along the last axis of its arrays.

    The axes are the face normals of the one, those of the other, and the cross products of their edges. Two edges that
    are parallel give none: everything along it is 0, and the boxes reach infinitely far.
    """

    def __init__(self, a: Boxes, b: Boxes) -> None:
        self._frame = a.axes
        self._halves = a.halves.T, b.halves.T
        self._rotation = np.ascontiguousarray(np.moveaxis(np.swapaxes(a.axes, -1, -2) @ b.axes, 0, -1))  # (3, 3, n)
        lengths = np.sqrt(np.maximum(1.0 - self._rotation**2, 0.0))  # (3, 3, n) of the cross products
        usable = lengths > _PARALLEL
        self._scale = np.where(usable, 1.0 / np.where(usable, lengths, 1.0), 0.0)

    def along_axes(self, vectors: Array) -> Array:
        """(15, n) components of vectors (n, 3) along the axes."""
        rotation, way = self._rotation, np.einsum("nji,nj->in", self._frame, vectors)
        crossed = (way[_LAST, None] * rotation[_NEXT] - way[_NEXT, None] * rotation[_LAST]) * self._scale
        return np.concatenate([way, np.einsum("ijn,in->jn", rotation, way), crossed.reshape(9, -1)])

    def reach(self) -> Array:
        """(15, n) m from centre to centre along each axis, from which on the boxes are apart."""
        size, (one, other) = np.abs(self._rotation), self._halves
        faces_a = one + np.einsum("ijn,jn->in", size, other)
        faces_b = other + np.einsum("ijn,in->jn", size, one)
        edges = one[_NEXT, None] * size[_LAST] + one[_LAST, None] * size[_NEXT]
        edges += other[None, _NEXT] * size[:, _LAST] + other[None, _LAST] * size[:, _NEXT]
        edges = np.where(self._scale > 0.0, edges * self._scale, np.inf)
        return np.concatenate([faces_a, faces_b, edges.reshape(9, -1)])
