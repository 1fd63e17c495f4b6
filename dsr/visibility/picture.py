"""A segmented picture of convex parts and triangles, drawn with numpy: which body is seen in which pixel, and how near.

A ray goes through the middle of each pixel. Where it meets a flat face, 1 / depth and the four conditions of being
within the face are linear in the pixel's coordinates, so that a face is drawn row by row from one bound to another, and
the outcome is that of casting each ray. Cylinders and spheres are cut with each ray of the window around them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr.math3d.boxes import CORNERS
from dsr.math3d.surfaces import Solids, crossings
from dsr.math3d.transforms import Pose
from dsr.visibility.triangles import draw_triangles
from dsr.vocabulary.intrinsics import Intrinsics

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

NEAREST = 1e-3
"""m along the axis; nearer points are not drawn"""
_MARGIN = 0.005  # m around a part within which an eye counts as in it: it hides nothing from that eye
_LEVEL = 1e-12  # stands for the slope of a bound that does not depend on the column
_ROUNDING = 1e-9  # 1, share of an inverse depth, by which a body that touches another is no less near


class Body(NamedTuple):
    """A body that can be seen, and hides others."""

    name: str
    solids: Solids
    """Convex parts of the body, in the world."""
    triangles: Array | None = None
    """(m, 3, 3) m, corners of triangles in the world, for what is no union of convex parts"""


class VisibleFraction(NamedTuple):
    """The visibility of one body in a picture."""

    share: float
    """Share (0 to 1) of the body's pixels that show it; the whole are those that it would have alone."""
    pixels: int
    """Number of pixels that show the body."""
    alone: int
    """Number of pixels that would show the body if nothing else were there, also half a picture beyond the edges."""
    hidden_by: str
    """Name of the body that hides most of this one; empty if nothing does."""


class PixelWindow(NamedTuple):
    """Columns and rows of a picture, the last ones not included; they may be beyond its edges."""

    left: int
    top: int
    right: int
    bottom: int

    def common(self, other: PixelWindow) -> PixelWindow:
        """The intersection of both windows."""
        return PixelWindow(
            max(self.left, other.left), max(self.top, other.top),
            min(self.right, other.right), min(self.bottom, other.bottom),
        )  # fmt: skip

    @property
    def is_empty(self) -> bool:
        """Whether the window has no pixel."""
        return self.left >= self.right or self.top >= self.bottom

    def slices(self, within: PixelWindow) -> tuple[slice, slice]:
        """The slices of this window in an array that covers `within`."""
        return (
            slice(self.top - within.top, self.bottom - within.top),
            slice(self.left - within.left, self.right - within.left),
        )


class Shot(NamedTuple):
    """A body in a picture, alone."""

    window: PixelWindow
    inverse_depth: Array
    """(rows, columns) 1/m, one over the depth along the axis; 0 where the body is not"""


class Picture:
    """A segmented picture: which body each pixel shows, seen from one pose.

    Args:
        world_from_view: of the optical frame: z forward, x right, y down.
        intrinsics: of the camera; of one whose lens distorts the picture is that of `Intrinsics.pinhole`.
        bodies: all that is there.
        wanted: names of those whose visible fraction will be asked.
    """

    def __init__(
        self, world_from_view: Pose, intrinsics: Intrinsics, bodies: Sequence[Body], wanted: Collection[str]
    ) -> None:
        intrinsics = intrinsics.pinhole()
        self.names = [body.name for body in bodies]
        self.frame = PixelWindow(0, 0, intrinsics.width, intrinsics.height)
        self._intrinsics = intrinsics
        self._eye = world_from_view.translation
        self._rotation = world_from_view.rotation_matrix
        self.inverse_depth: Array = np.zeros((intrinsics.height, intrinsics.width))
        """(h, w) 1/m, one over the depth along the axis; 0 where nothing is"""
        self.bodies: NDArray[np.int32] = np.full((intrinsics.height, intrinsics.width), -1, dtype=np.int32)
        """(h, w) index of the body that is seen in each pixel; -1 for none"""
        self._shots: dict[str, tuple[int, Shot]] = {}
        beyond = (intrinsics.width // 2, intrinsics.height // 2)
        self._around = PixelWindow(-beyond[0], -beyond[1], intrinsics.width + beyond[0], intrinsics.height + beyond[1])
        limits = [self._around if body.name in wanted else self.frame for body in bodies]
        for index, (body, shot) in enumerate(zip(bodies, self._shoot(bodies, limits), strict=True)):
            if shot is not None:
                self._draw(index, shot)
                if body.name in wanted:
                    self._shots[body.name] = (index, shot)

    def visible(self, name: str) -> VisibleFraction:
        """Tell how much of one of the wanted bodies is seen."""
        if name not in self._shots:
            return VisibleFraction(0.0, 0, 0, "")
        index, shot = self._shots[name]
        inside = shot.window.common(self.frame)
        if inside.is_empty:
            return VisibleFraction(0.0, 0, int(np.count_nonzero(shot.inverse_depth)), "")
        there = self.bodies[inside.slices(self.frame)]
        return self._judge(shot, inside, there == index, there)

    def would_show(self, body: Body) -> VisibleFraction:
        """Tell how much would be seen of a body that is not in the picture, if it were there and all else as it is."""
        [shot] = self._shoot([body], [self._around])
        if shot is None:
            return VisibleFraction(0.0, 0, 0, "")
        inside = shot.window.common(self.frame)
        if inside.is_empty:
            return VisibleFraction(0.0, 0, int(np.count_nonzero(shot.inverse_depth)), "")
        mine = shot.inverse_depth[inside.slices(shot.window)]
        free = (mine > 0.0) & (mine >= self.inverse_depth[inside.slices(self.frame)] * (1.0 - _ROUNDING))
        return self._judge(shot, inside, free, self.bodies[inside.slices(self.frame)])

    def shows(self, point: Array) -> bool:
        """Whether a point (3,) m in the world is in the picture with nothing in front of it."""
        x, y, z = ((point - self._eye) @ self._rotation).tolist()
        if z <= NEAREST:
            return False
        intrinsics = self._intrinsics
        column, row = round(x / z * intrinsics.fx + intrinsics.cx), round(y / z * intrinsics.fy + intrinsics.cy)
        inside = 0 <= column < intrinsics.width and 0 <= row < intrinsics.height
        return bool(inside) and 1.0 / z >= float(self.inverse_depth[row, column])

    def _judge(self, shot: Shot, inside: PixelWindow, seen: Flags, there: NDArray[np.int32]) -> VisibleFraction:
        alone, pixels = int(np.count_nonzero(shot.inverse_depth)), int(np.count_nonzero(seen))
        hiding = there[(shot.inverse_depth[inside.slices(shot.window)] > 0.0) & ~seen]
        hiding = hiding[hiding >= 0]
        hidden_by = self.names[int(np.bincount(hiding).argmax())] if len(hiding) else ""
        return VisibleFraction(pixels / alone if alone else 0.0, pixels, alone, hidden_by)

    def _draw(self, index: int, shot: Shot) -> None:
        inside = shot.window.common(self.frame)
        if inside.is_empty:
            return
        near, buffer = shot.inverse_depth[inside.slices(shot.window)], self.inverse_depth[inside.slices(self.frame)]
        nearer = near > buffer
        buffer[nearer] = near[nearer]
        self.bodies[inside.slices(self.frame)][nearer] = index

    def _shoot(self, bodies: Sequence[Body], limits: Sequence[PixelWindow]) -> list[Shot | None]:
        """Each body alone, within its limits."""
        counts = [len(body.solids.kinds) for body in bodies]
        if not bodies:
            return []
        kinds = np.concatenate([body.solids.kinds for body in bodies])
        half = np.concatenate([body.solids.half for body in bodies])
        centres = (np.concatenate([body.solids.centre for body in bodies]) - self._eye) @ self._rotation
        axes = self._rotation.T @ np.concatenate([body.solids.rotation for body in bodies])
        parts = _Parts(kinds, centres, axes, half)
        windows = parts.windows(self._intrinsics)
        found, first = [], 0
        for body, count, limit in zip(bodies, counts, limits, strict=True):
            own = range(first, first + count)
            first += count
            found.append(self._shoot_one(body, parts, own, windows, limit))
        return found

    def _shoot_one(
        self, body: Body, parts: _Parts, own: range, windows: Mapping[int, PixelWindow], limit: PixelWindow
    ) -> Shot | None:
        shown = {
            part: window for part in own if part in windows and not (window := windows[part].common(limit)).is_empty
        }
        shots = [Shot(window, self._inverse_depth(parts, part, window)) for part, window in shown.items()]
        if body.triangles is not None:
            corners = (body.triangles - self._eye) @ self._rotation
            drawn = draw_triangles(corners, self._intrinsics, limit, NEAREST)
            if drawn is not None:
                shots.append(Shot(PixelWindow(*drawn[0]), drawn[1]))
        return _joined(shots)

    def _inverse_depth(self, parts: _Parts, part: int, window: PixelWindow) -> Array:
        intrinsics = self._intrinsics
        x: Array = (np.arange(window.left, window.right, dtype=np.float64) - intrinsics.cx) / intrinsics.fx
        y: Array = (np.arange(window.top, window.bottom, dtype=np.float64) - intrinsics.cy) / intrinsics.fy
        if parts.kinds[part] == 0:
            return _box_inverse_depth(parts.centres[part], parts.axes[part], parts.half[part], x, y)
        return _round_inverse_depth(parts, part, x, y)


class _Parts(NamedTuple):
    """n convex parts in the frame of the view."""

    kinds: NDArray[np.int64]
    centres: Array
    """(n, 3) m"""
    axes: Array
    """(n, 3, 3) view_from_part"""
    half: Array
    """(n, 3) m"""

    def windows(self, intrinsics: Intrinsics) -> dict[int, PixelWindow]:
        """Around each part that may be seen."""
        corners = self.centres[:, None] + (CORNERS * self.half[:, None]) @ self.axes.transpose(0, 2, 1)
        depth = corners[..., 2]
        ahead: Flags = np.greater(depth, NEAREST)
        safe = np.where(ahead, depth, 1.0)
        u = corners[..., 0] / safe * intrinsics.fx + intrinsics.cx
        v = corners[..., 1] / safe * intrinsics.fy + intrinsics.cy
        whole: Flags = np.all(ahead, axis=1, keepdims=True)
        limit = 4.0 * max(intrinsics.width, intrinsics.height)  # of what crosses the plane of the eye all may be seen
        low = np.where(whole, np.stack([u.min(axis=1), v.min(axis=1)], axis=1), -limit)
        high = np.where(whole, np.stack([u.max(axis=1), v.max(axis=1)], axis=1), limit)
        low, high = np.clip(np.ceil(low), -limit, limit), np.clip(np.floor(high) + 1.0, -limit, limit)
        eye = -np.einsum("nj,njk->nk", self.centres, self.axes)
        outside = (np.abs(eye) > self.half + _MARGIN).any(axis=1)
        shown = np.flatnonzero(np.any(ahead, axis=1) & outside)
        edges = np.concatenate([low, high], axis=1).astype(np.int64)
        return {part: PixelWindow(*edges[part].tolist()) for part in shown.tolist()}


def _box_inverse_depth(centre: Array, axes: Array, half: Array, x: Array, y: Array) -> Array:
    """(rows, columns) 1 / depth of a box along rays (x, y, 1); 0 where they miss it.

    Args:
        centre: (3,) m, in the frame of the view.
        axes: (3, 3), its axes there as columns.
        half: (3,) m.
        x: (columns,)
        y: (rows,)
    """
    along = centre @ axes
    found = np.zeros((len(y), len(x)))
    for axis in range(3):
        side = -np.sign(along[axis])
        distance = abs(along[axis]) - half[axis]  # from the eye to the plane of the nearer face
        if distance <= 0.0:
            continue
        plane = -side * axes[:, axis] / distance  # times a ray: 1 / depth where it meets the plane
        bounds = [plane]
        for other in range(3):
            if other != axis:
                bounds.append(axes[:, other] + (half[other] - along[other]) * plane)
                bounds.append(-axes[:, other] + (half[other] + along[other]) * plane)
        low, high = _spans(np.array(bounds), y)
        near = plane[0] * x + (plane[1] * y + plane[2])[:, None]
        within = (x >= low[:, None]) & (x <= high[:, None])
        np.maximum(found, near, out=found, where=within)
    return np.asarray(np.where(found < 1.0 / NEAREST, found, 0.0))


def _spans(bounds: Array, y: Array) -> tuple[Array, Array]:
    """Least and greatest x (rows,) of rays (x, y, 1) whose product with each of the bounds (n, 3) is not negative."""
    slope = bounds[:, :1]
    slope = np.where(np.abs(slope) < _LEVEL, _LEVEL, slope)
    edge = -(bounds[:, 1:2] * y + bounds[:, 2:]) / slope
    low = np.where(slope > 0.0, edge, -np.inf).max(axis=0)
    high = np.where(slope < 0.0, edge, np.inf).min(axis=0)
    return low, high


def _round_inverse_depth(parts: _Parts, part: int, x: Array, y: Array) -> Array:
    """The same of a cylinder or a sphere."""
    rays = np.empty((len(y), len(x), 3))
    rays[..., 0], rays[..., 1], rays[..., 2] = x, y[:, None], 1.0
    axes = parts.axes[part]
    way = (rays.reshape(-1, 3) @ axes)[None]
    start = -(parts.centres[part] @ axes)[None, None]
    enters, leaves = crossings(parts.kinds[part : part + 1], parts.half[part : part + 1], start, way)
    met: Flags = np.less(enters[0], leaves[0]) & np.greater(enters[0], NEAREST)
    return np.asarray(np.where(met, 1.0 / np.where(met, enters[0], 1.0), 0.0).reshape(len(y), len(x)))


def _joined(shots: Sequence[Shot]) -> Shot | None:
    """One body of all its parts."""
    if len(shots) <= 1:
        return shots[0] if shots and shots[0].inverse_depth.any() else None
    edges = np.array([shot.window for shot in shots])
    window = PixelWindow(*edges[:, :2].min(axis=0).tolist(), *edges[:, 2:].max(axis=0).tolist())
    inverse_depth = np.zeros((window.bottom - window.top, window.right - window.left))
    for shot in shots:
        place = inverse_depth[shot.window.slices(window)]
        np.maximum(place, shot.inverse_depth, out=place)
    return Shot(window, inverse_depth) if inverse_depth.any() else None
