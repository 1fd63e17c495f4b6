"""Boxes around collision meshes: the smallest box around each of a few slices across the longest edge.

Whatever the mesh encloses is within the boxes, so a path that is free for them is free for the mesh. What is in a slice
of a closed surface has surface of that slice on all sides, and is in the box around it. Convex decompositions have no
such proof. CoACD left vertices of coarse links outside of its parts, and took 20 s and more for fine ones.
"""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from agents.arm_controller.model.shapes import LinkBox
from dsr.geometry import Model, load_model
from dsr.math3d.boxes import Array
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

_MOST_SLICES = 4
"""Each box more is checked at every point of a path; from here on slices no longer save 5 % of the volume."""
_WORTH_IT = 0.9
"""Share of the volume: more slices are taken if less than this remains. Few boxes keep planning fast."""
_THINNEST = 0.001
"""m, edge of a box around something flat: boxes without volume would meet nothing."""
_SUBDIVISIONS = 2
"""Of an icosahedron: its 162 corners are the directions in which outermost points are sought, one in 15 degrees."""

Triangles = NDArray[np.int64]


def boxes_around(file: Path, scale: Vector3) -> tuple[LinkBox, ...]:
    """Boxes around all that the mesh in `file` encloses, in its frame.

    Args:
        file: OBJ, STL, GLB or COLLADA. Its axes are taken as they are, as ROS does, whatever it says of `up`.
        scale: factors along the axes; a negative one mirrors.

    Raises:
        ConfigError: for a file that cannot be read, or holds no triangles.
    """
    points, triangles = _surface(load_model(file, up="z"))
    points *= scale
    best = [whole := _box(points)]
    for count in range(2, _MOST_SLICES + 1):
        sliced = _sliced(points, triangles, whole, count)
        if _volume(sliced) < _WORTH_IT * _volume(best):
            best = sliced
    return tuple(best)


def _surface(model: Model) -> tuple[Array, Triangles]:
    """Vertices (n, 3) and triangles (m, 3) of all meshes of a file, in its frame."""
    frames: dict[str, Pose] = {}
    points, triangles, first = [], [], 0
    for node in model.nodes:
        frames[node.name] = node.pose if node.parent is None else frames[node.parent] @ node.pose
        for mesh in node.meshes:
            points.append(frames[node.name].apply(mesh.vertices.astype(np.float64)))
            triangles.append(mesh.triangles.astype(np.int64) + first)
            first += len(mesh.vertices)
    corners, places = np.unique(np.concatenate(triangles), return_inverse=True)  # without points of no triangle
    return np.concatenate(points)[corners], places.reshape(-1, 3)


def _sliced(points: Array, triangles: Triangles, whole: LinkBox, count: int) -> list[LinkBox]:
    """The box around each of `count` slices of the same thickness, across the longest edge of the box around all.

    What is left of a triangle in a slice is spanned by its corners there, and by where its edges leave the slice.
    """
    axis = int(np.argmax(whole.half))
    local = whole.pose.inverse().apply(points)
    heights = local[:, axis]
    cuts = np.linspace(-whole.half[axis], whole.half[axis], count + 1)
    cuts[0], cuts[-1] = min(cuts[0], heights.min()), max(cuts[-1], heights.max())  # rounding loses nothing
    crossings = [_crossings(local, triangles, axis, cut) for cut in cuts[1:-1]]
    ends = [local[:0], *crossings, local[:0]]
    boxes = []
    for (low, high), below, above in zip(itertools.pairwise(cuts), ends[:-1], ends[1:], strict=True):
        kept = np.concatenate([local[(heights >= low) & (heights <= high)], below, above])
        if len(kept):
            boxes.append(_box(kept).seen_from(whole.pose))
    return boxes


def _crossings(local: Array, triangles: Triangles, axis: int, cut: float) -> Array:
    """(k, 3) m, where edges of triangles (m, 3) of points (n, 3) go through the plane at `cut` m along an axis."""
    above = local[:, axis] > cut
    sides = above[triangles]
    cutting = triangles[sides.any(axis=1) & ~sides.all(axis=1)]
    edges = np.concatenate([cutting[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    begins, ends = local[edges[above[edges[:, 0]] != above[edges[:, 1]]].T]
    share = (cut - begins[:, axis]) / (ends[:, axis] - begins[:, axis])
    return np.asarray(begins + share[:, None] * (ends - begins))


def _box(points: Array) -> LinkBox:
    """The smallest box around points (n, 3)."""
    points = _outermost(points)  # a mesh may have millions
    pose = Pose.from_matrix(_turned(points)).inverse()
    local = pose.inverse().apply(points)
    low, high = local.min(axis=0), local.max(axis=0)
    x, y, z = (np.maximum(high - low, _THINNEST) / 2).tolist()
    at_x, at_y, at_z = ((low + high) / 2).tolist()
    return LinkBox(pose @ Pose((at_x, at_y, at_z)), (x, y, z), local - (at_x, at_y, at_z))


def _outermost(points: Array) -> Array:
    """The corners (k, 3) of the convex hull of points (n, 3); all of them if they are flat."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return points[ConvexHull(points).vertices]
    except QhullError:
        return points


def _turned(points: Array) -> Array:
    """(4, 4) rigid motion that lays the edges of the smallest box around points (n, 3) along the axes."""
    from scipy.spatial import ConvexHull, QhullError
    from trimesh import Trimesh
    from trimesh.bounds import oriented_bounds
    from trimesh.creation import icosphere

    directions = icosphere(subdivisions=_SUBDIVISIONS).vertices
    outermost = points[np.unique((directions @ points.T).argmax(axis=1))]  # the search takes their square in time
    try:
        hull = ConvexHull(outermost)  # of the one that trimesh makes itself it would turn all normals, by a library
        surface = SimpleNamespace(convex_hull=Trimesh(outermost[hull.vertices], _renumbered(hull), process=False))
        matrix = oriented_bounds(surface, ordered=False)[0]  # type: ignore[no-untyped-call]
    except (QhullError, ValueError):  # flat, or too thin for trimesh: its principal axes
        matrix = np.eye(4)
        spread = np.linalg.qr(points - points.mean(axis=0), mode="r")  # (3, 3) at most, however many points there are
        matrix[:3, :3] = np.linalg.svd(spread, full_matrices=True)[2]
    matrix[2, :3] *= np.sign(np.linalg.det(matrix[:3, :3]))  # it may be mirrored
    return np.asarray(matrix)


def _renumbered(hull: ConvexHull) -> Triangles:
    """The triangles of a hull as places in the list of its own vertices."""
    place = np.zeros(len(hull.points), dtype=np.int64)
    place[hull.vertices] = np.arange(len(hull.vertices))
    return np.asarray(place[hull.simplices])


def _volume(boxes: list[LinkBox]) -> float:
    return sum(math.prod(box.size) for box in boxes)
