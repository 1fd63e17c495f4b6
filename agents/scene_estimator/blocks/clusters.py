"""Connected pieces of what stands on a support, in one image: by height, jumps of the depth, and colour."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.colors import DARKEST, TOLERANCE
from agents.scene_estimator.fitting import FrameView
from agents.scene_estimator.segmentation import Mask
from dsr.math3d.transforms import Array, Pose

HIGHEST = 0.4
"""m above the support up to which something is looked for"""

SMALLEST = 60
"""Pixels of a piece, at least."""

TOP = 0.97
"""Quantile of the heights of a piece that is at its upper side."""

NEAR_CUT = 4
"""px from where something else hides it, or touches it, in which a piece tells nothing of an edge there"""

LEVEL = 0.002
"""m, standard deviation of the height of a support: tables are not flat, cameras not quite where they seem"""

_LEAST_RISE = 0.008  # m above the support, from which something is not the support itself
_NOISE = 3.0  # standard deviations of the depth: the same
_JUMP = 0.015  # m between the depths of neighbours that do not belong together, beside noise: steep faces have less
_NEARER = 0.01  # m by which something must be nearer to hide what is behind it
_BEYOND = 3  # px at an edge of which depth is missing
_BY_COLOR = 0.5  # px, standard deviation of an edge that colours tell
_BY_COLOR_ALIKE = 0.2  # px, standard deviation of what is wrong in all of it alike: lenses blur
_BY_DEPTH = 1.5  # px, of an edge that depth alone tells: it is missing in up to `_BEYOND` pixels, more on some sides
_BY_DEPTH_ALIKE = 1.0  # px, what is missing on average, and the standard deviation of that
_SIDES = 6  # of a box in an image, at most: what is missing at one side is missing all along it
_STEEP = 5  # times that: steep faces have no depth, so that colour alone tells how far they go
_FARTHEST_EDGE = 12  # px from what is surely raised, up to which its edge is looked for
_NEAR_SUPPORT = 0.03  # m around the believed height in which the support is looked for
_SPARSE = 3  # px apart, and
_ENOUGH_SUPPORT = 100  # count of pixels that tell its height
_SMALL = np.ones((3, 3), np.uint8)


class Support(NamedTuple):
    """A level surface on which things stand."""

    name: str
    """Of its node."""
    pose: Pose
    """world_from_support at the middle of its upper side"""
    length: float
    """m, along its own x axis"""
    width: float
    """m, along its own y axis"""

    def covers(self, points: Array) -> NDArray[np.bool_]:
        """Which points (n, 3) of the world are above or below it."""
        local = np.abs(self.pose.inverse().apply(points))
        return np.asarray((local[:, 0] < 0.5 * self.length) & (local[:, 1] < 0.5 * self.width))


class PieceEdge(NamedTuple):
    """How well the outermost pixels of a piece tell where the thing ends that it is an image of."""

    std: float
    """px, standard deviation of each pixel by itself"""
    inset: float
    """px, by which all are within the thing"""
    inset_std: float
    """px, standard deviation of that"""
    independent: float
    """How many of them are wrong independently, at most"""
    rise: float
    """m above the support, up to which nothing of the thing is in the piece"""


_EDGE_BY_COLOR = PieceEdge(_BY_COLOR, 0.0, _BY_COLOR_ALIKE, math.inf, 0.0)


class Cluster(NamedTuple):
    """A connected piece of the image that stands on the support."""

    points: Array
    """(n, 3) m, in the world"""
    rays: Array
    """(n, 3) in the world, from the camera to the points, of length 1 along the optical axis"""
    depths: Array
    """(n,) m, along the optical axis"""
    color: Array
    """(3,) median red, green, blue, 0 to 1"""
    contour: Array
    """(m, 2) px, outermost pixels of the piece where the thing ends: not where something hides it"""
    contour_sigma: Array
    """(m,) px, standard deviation of how far from there it ends, beside that of `edge`: 0 where it meets nothing"""
    hidden: float
    """Share of its outermost pixels where something hides it or meets it, or the image ends."""
    base: float
    """m, height in the world of the support"""
    edge: PieceEdge
    """How well its contour tells where the thing ends."""


class _Silhouette(NamedTuple):
    """The image of a piece, as far as its colour tells it."""

    image: Mask
    taken: Mask
    """What has its colour, too, but is nearer to another piece of that colour"""


class _Beside(NamedTuple):
    """What stands next to the pixels of a piece, or of its edge."""

    covered: Mask
    """Where something else stands that is not behind"""
    slack: Array
    """(h, w) px, standard deviation of how far the piece goes on behind that: infinite if nothing tells.

    Two things that meet with their upper sides at one height end where they meet: none can be in the other. The
    farther one is hidden only as far as the ray is slanted over the difference of their depths, of which the errors
    that all depths of a thing share are most. Two of one colour that are apart in depth end where no depth is between
    them: the nearer one as surely as depth tells that, and nothing tells where the farther one does.
    """


class Relief:
    """One exposure as points of the world above a support.

    Args:
        view: depth and camera.
        color: (h, w, 3) RGB image, 0 to 255.
        support: on which things stand.
        noise: 1/m, standard deviation of the inverse depth of a pixel.
        bias: m, standard deviation of the error that all depths of a thing share.
    """

    def __init__(self, view: FrameView, color: NDArray[np.uint8], support: Support, noise: float, bias: float) -> None:
        self._view, self._color, self._noise, self._bias = view, color, noise, bias
        self._depth = np.where(np.isfinite(view.depth) & (view.depth > 0.0), view.depth, np.float32(0.0))
        self._turn = view.world_from_camera.rotation_matrix.astype(np.float32)
        self._eye = view.world_from_camera.translation
        z = self._heights()
        self._base = self._level(support, z)
        rise = np.maximum(np.float32(_LEAST_RISE), np.float32(_NOISE * noise) * self._depth**2)
        above = z - np.float32(self._base)
        self._above = above
        standing = ((above > rise) & (self._depth > 0.0)).astype(np.uint8)
        self._standing = cv2.morphologyEx(standing, cv2.MORPH_OPEN, _SMALL) > 0
        raised = self._standing & (above < HIGHEST)
        rows, columns = np.nonzero(raised)
        world = self._rays(rows, columns) * self._depth[rows, columns, None] + self._eye
        raised[rows, columns] = support.covers(world)
        self._raised = raised
        self._reach = self._edge_reach()

    def _heights(self) -> NDArray[np.float32]:
        """(h, w) m, of each pixel in the world; of no meaning without depth."""
        x, y = self._view.intrinsics.slopes()
        slope = x * self._turn[2, 0] + (y * self._turn[2, 1] + self._turn[2, 2])
        return np.asarray(slope * self._depth + np.float32(self._eye[2]), np.float32)

    def _rays(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Array:
        """(n, 3) in the world, from the camera through pixels, of length 1 along the optical axis."""
        x, y = self._view.intrinsics.slopes()
        shape = self._depth.shape
        x, y = np.broadcast_to(x, shape)[rows, columns], np.broadcast_to(y, shape)[rows, columns]
        return np.column_stack([x, y, np.ones(len(x), np.float32)]).astype(np.float64) @ self._turn.T

    def _level(self, support: Support, z: NDArray[np.float32]) -> float:
        """m, height of the support: in the middle of most of its points near the believed height."""
        believed = support.pose.t[2]
        sparse = np.s_[::_SPARSE, ::_SPARSE]
        near = (np.abs(z[sparse] - np.float32(believed)) < _NEAR_SUPPORT) & (self._depth[sparse] > 0.0)
        rows, columns = (index * _SPARSE for index in np.nonzero(near))
        on = support.covers(self._rays(rows, columns) * self._depth[rows, columns, None] + self._eye)
        heights = z[rows, columns][on]
        if len(heights) < _ENOUGH_SUPPORT:
            return believed
        middle = np.median(heights)
        return float(np.median(heights[np.abs(heights - middle) < 0.5 * _NEAR_SUPPORT]))

    def _edge_reach(self) -> int:
        """How many px around a piece its edge may be: depth is missing at edges, and the foot is not raised."""
        if not self._raised.any():
            return _BEYOND
        depths = self._depth[self._raised]
        foot = self._rise(depths) / float(np.median(depths)) * self._view.intrinsics.fx
        return min(_BEYOND + math.ceil(foot), _FARTHEST_EDGE)

    def _rise(self, depths: NDArray[np.float32]) -> float:
        """From how many m above the support something at these depths is not the support itself."""
        return max(_LEAST_RISE, _NOISE * self._noise * float(np.median(depths)) ** 2)

    def _edge_by_depth(self, depths: NDArray[np.float32]) -> PieceEdge:
        """Of a piece at these depths (m) whose colour does not tell where it ends."""
        return PieceEdge(_BY_DEPTH, _BY_DEPTH_ALIKE, _BY_DEPTH_ALIKE, _SIDES, self._rise(depths))

    def clusters(self) -> list[Cluster]:
        """The pieces, but for those that are too small."""
        if not self._raised.any():
            return []
        labels = self._labels()
        sizes = np.bincount(labels.ravel())
        labels[sizes[labels] < SMALLEST] = 0  # specks, most of them of a larger piece
        found = (self._cluster(labels, label) for label in range(1, len(sizes)) if sizes[label] >= SMALLEST)
        return [cluster for cluster in found if cluster is not None]

    def _labels(self) -> NDArray[np.int32]:
        """(h, w) number of the piece of each pixel, 0 for none."""
        inner = self._raised.astype(np.uint8)
        left, top, width, height = cv2.boundingRect(inner)
        part = np.s_[top : top + height, left : left + width]
        depth, raised, directions = self._depth[part], inner[part] > 0, _directions(self._color[part])
        for now, before in ((np.s_[:, 1:], np.s_[:, :-1]), (np.s_[1:, :], np.s_[:-1, :])):
            alike = np.einsum("hwc,hwc->hw", directions[now], directions[before]) > np.cos(TOLERANCE)
            most = np.float32(_JUMP) + np.float32(_NOISE * self._noise) * depth[now] ** 2
            jumps = np.abs(depth[now] - depth[before]) > most
            inner[part][now] &= ~(raised[now] & raised[before] & (jumps | ~alike))
        _, labels = cv2.connectedComponents(inner, connectivity=4)
        return np.asarray(labels, np.int32)

    def _cluster(self, labels: NDArray[np.int32], label: int) -> Cluster | None:
        rows, columns = np.nonzero(labels == label)
        color = np.median(self._color[rows, columns], axis=0)
        height, width = labels.shape
        margin = (_STEEP + 1) * self._reach
        top, left = max(int(rows.min()) - margin, 0), max(int(columns.min()) - margin, 0)
        part = np.s_[top : int(rows.max()) + margin + 1, left : int(columns.max()) + margin + 1]
        own = labels[part] == label
        told = self._silhouette(own, labels[part] > 0, part, color)
        edge = self._edge_by_depth(self._depth[part][own]) if told is None else _EDGE_BY_COLOR
        image, taken = (own, np.zeros_like(own)) if told is None else told
        pixels = _outermost(image)
        if len(pixels) == 0:
            return None
        row, column = pixels[:, 1] + top, pixels[:, 0] + left
        at_border = (row <= 1) | (column <= 1) | (row >= height - 2) | (column >= width - 2)
        beside = self._beside(labels, part, own, image, taken)
        covered, slack = beside.covered[pixels[:, 1], pixels[:, 0]], beside.slack[pixels[:, 1], pixels[:, 0]]
        cut = np.zeros(own.shape, np.uint8)
        hides = at_border | np.isinf(slack)
        cut[pixels[hides, 1], pixels[hides, 0]] = 1
        near_cut = cv2.dilate(cut, _square(NEAR_CUT)) > 0
        kept = np.nonzero((cv2.erode(own.astype(np.uint8), _SMALL) > 0) & ~near_cut)
        if len(kept[0]) < SMALLEST // 4:
            return None
        ends = ~near_cut[pixels[:, 1], pixels[:, 0]]
        contour = np.column_stack([column, row]).astype(np.float64)[ends]
        slack = slack[ends]
        slack *= math.sqrt(max(int((slack > 0.0).sum()), 1))  # what is wrong at one is wrong at all
        rays = self._rays(kept[0] + top, kept[1] + left)
        depths = self._depth[part][kept].astype(np.float64)
        points = rays * depths[:, None] + self._eye
        hidden = float((at_border | covered).mean())
        return Cluster(points, rays, depths, color / 255.0, contour, slack, hidden, self._base, edge)

    def _silhouette(self, own: Mask, pieces: Mask, part: tuple[slice, slice], color: Array) -> _Silhouette | None:
        """The pixels of a piece with those at its edge that have its colour; None if what is around has it, too.

        A pixel at the edges of several pieces of this colour is one of the piece that is nearest in the image.
        """
        reaches = (_STEEP * self._reach, (_STEEP + 1) * self._reach)
        near, far = (cv2.dilate(own.astype(np.uint8), _square(reach)) > 0 for reach in reaches)
        image = self._color[part]
        ground = image[far & ~near].astype(np.float64)
        if len(ground) == 0 or np.linalg.norm(color) < 255.0 * DARKEST:
            return None
        direction = color / np.linalg.norm(color)
        around = np.median(ground, axis=0)
        if direction @ around > np.cos(2.0 * TOLERANCE) * max(float(np.linalg.norm(around)), 1.0):
            return None
        alike = _directions(image) @ direction.astype(np.float32) > np.cos(TOLERANCE)
        before = self._standing[part] & ~own & (self._depth[part] < self._far(part, own))
        free = near & alike & ~before & ~pieces
        taken = free & _nearer_to(pieces & ~own & alike, own)
        grown = own | (free & ~taken)
        closed = cv2.morphologyEx(grown.astype(np.uint8), cv2.MORPH_CLOSE, _SMALL)
        _, joined = cv2.connectedComponents(closed, connectivity=4)
        return _Silhouette(np.asarray(np.isin(joined, np.unique(joined[own])) & (closed > 0)), taken)

    def _far(self, part: tuple[slice, slice], own: Mask) -> float:
        """m, the depth of the nearest pixel of a piece, less what a thing before it must be nearer by."""
        return float(self._depth[part][own].min()) - _NEARER

    def _beside(
        self, labels: NDArray[np.int32], part: tuple[slice, slice], own: Mask, image: Mask, taken: Mask
    ) -> _Beside:
        """What stands next to the pixels of a piece, of which others have taken some."""
        beside = (self._standing[part] & ~own & ~image).astype(np.uint8)
        other = cv2.morphologyEx(beside, cv2.MORPH_OPEN, _SMALL) > 0  # specks beside an edge are its own
        depths, upper = self._depth[part], self._below_top(labels, part) < _NEARER
        nearest, farthest = _least(depths, other, self._reach), -_least(-depths, own, self._reach)
        covered = nearest < farthest + np.float32(_NEARER)
        top_before, own_top = _least(depths, other & upper, self._reach), -_least(-depths, own & upper, self._reach)
        meet = np.isfinite(own_top) & np.isfinite(top_before) & (own_top - top_before < 2.0 * self._bias)
        rows, columns = np.nonzero(covered & meet)
        rays = self._rays(rows + part[0].start, columns + part[1].start)
        sine = np.hypot(rays[:, 0], rays[:, 1]) / np.linalg.norm(rays, axis=1)
        at_taken, close = cv2.dilate(taken.astype(np.uint8), _SMALL) > 0, _least(depths, other, _BEYOND)
        covered |= at_taken & ~((farthest + np.float32(_NEARER) <= close) & np.isfinite(close))
        slack = np.where(covered, np.inf, np.where(at_taken, _BY_DEPTH, 0.0))
        nearer = np.maximum(own_top[rows, columns] - top_before[rows, columns], 0.0)
        behind = np.hypot(nearer, math.sqrt(2.0) * self._bias)
        slack[rows, columns] = behind * sine * self._view.intrinsics.fx / own_top[rows, columns]
        return _Beside(covered, slack)

    def _below_top(self, labels: NDArray[np.int32], part: tuple[slice, slice]) -> NDArray[np.float32]:
        """(h, w) m, how far each pixel of a part of the image is under the upper side of its piece."""
        here, above = labels[part], self._above[part]
        below = np.full(here.shape, np.inf, np.float32)
        for label in np.unique(here[here > 0]):
            mine = here == label
            below[mine] = np.quantile(above[mine], TOP) - above[mine]
        return below


def _directions(color: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(h, w, 3) unit vectors of the colours."""
    values = cv2.medianBlur(color, 3).astype(np.float32)
    length = np.sqrt(np.einsum("hwc,hwc->hw", values, values))
    return np.asarray(values / np.maximum(length, 1.0)[..., None], np.float32)


def _nearer_to(others: Mask, own: Mask) -> Mask:
    """Which pixels are nearer to those of others than to own ones."""
    if not others.any():
        return np.zeros_like(own)
    away = [cv2.distanceTransform((~which).astype(np.uint8), cv2.DIST_L2, 3) for which in (others, own)]
    return np.asarray(away[0] < away[1])


def _least(values: NDArray[np.float32], which: Mask, reach: int) -> NDArray[np.float32]:
    """(h, w) least of the values of some pixels, of those up to `reach` px away: infinite where there is none."""
    some = np.where(which, values, np.float32(np.inf))
    return np.asarray(cv2.erode(some, _square(reach), borderType=cv2.BORDER_REPLICATE))


def _square(reach: int) -> NDArray[np.uint8]:
    return np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)


def _outermost(image: Mask) -> NDArray[np.int32]:
    """(n, 2) px (u, v) of the outer border of the largest piece of an image."""
    contours, _ = cv2.findContours(image.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return np.empty((0, 2), np.int32)
    return np.asarray(max(contours, key=cv2.contourArea).reshape(-1, 2), np.int32)
