"""Where a shape of known rotation lies on the pixels that show it: its visible surface is put where it is seen.

What is seen is compared with what should be seen of the shape at a supposed place, which is then moved by the
difference, and so on: an iterated closest point method (Besl and McKay, PAMI 1992) with all points matched at once. All
pixels of the colour tell where it is across the view, by the middle of their rays. Those with a depth tell how far away
it is, each by the difference from the depth that it should have. What should be seen is where the rays of pixels meet
the shape. A straight edge along a row of pixels is rounded to whole pixels in the image. It is rounded alike in what
should be seen: rays between pixels would place it up to half a pixel off, alike in each frame. Points that are spread
over the surface would be denser in one place than in another, and pull the place to one side. Of large images rays that
are spread evenly tell as much.

What something nearer hides, or lies outside the image, should not be seen. What stands on a shape touches it, so it is
hardly nearer there than what it hides. What carries a shape touches it as well, and is nearer than a shape that is
supposed too low. But what carries a shape hides nothing, as nothing is sunk in what carries it. So a pixel that shows
something above the shape's centre hides what is not clearly nearer, and one beneath the centre only what is clearly
farther. A pixel without depth, of another colour, is hidden if what is beside it is. Where most is hidden the middle
may lead to a wrong place. Each point's distance from the surface then leads on.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.scene_estimator.segmentation import Mask
from dsr.math3d.boxes import CORNERS
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Shape, box
from dsr.math3d.surfaces import GAP, Solids, distances
from dsr.math3d.transforms import Array, Pose
from dsr.vocabulary.intrinsics import Intrinsics

SMALLEST = 8
"""px, the width of the smallest spot that is used"""
ROUGH = 4
"""Iterations, and"""
ROUGH_RAYS = 400
"""rays about a shape, enough to tell rotations apart"""

BEHIND, BEFORE = 0.3, -0.3
"""Of the shortest edge: how far the centre is behind what is seen of the outside; of the inside of something hollow"""

_MOST_POINTS = 1500
_RAYS = 3000  # about a shape: the middle of what they meet is known to a thousandth of its extent
NO_SHARE = 1e-9
"""1, share of an image that stands for none, so that nothing is divided by 0"""
_ITERATIONS = 12
_SETTLED = 1e-4  # m
_STEPS = 8
_POINTS_OF_A_STEP = 400
_DIFFERENCE = 1e-4  # m, for derivatives
_FAR_OFF = 0.004  # m from the surface, beyond which a point counts less and less
_HELD = 0.02  # of the points' weight: what keeps the place where they do not tell it
_LONGEST_STEP = 0.02  # m
_IN_FRONT = 0.015  # m, by which what carries a thing must be nearer to hide it, and what stands on it seems farther
_PLASTIC = 1.324717957244746  # the real root of x^3 = x + 1


class FrameView(NamedTuple):
    """One exposure."""

    depth: NDArray[np.float32]
    """(h, w) m along the optical axis; 0 where unknown"""
    intrinsics: Intrinsics
    world_from_camera: Pose


class Fit(NamedTuple):
    """How well a shape lies on the points seen."""

    position: Array
    """(3,) m, its centre in the world"""
    rotation: Array
    """(3, 3) world_from_object"""
    share: float
    """Visible share of the object's image."""
    agreement: float
    """Share of that which has its colour."""
    misfit: float
    """m, mean distance of the points from the surface"""


class Rays(NamedTuple):
    """Viewing rays of some pixels, and what is at their ends."""

    directions: Array
    """(n, 3) in the world, as long as they go 1 m along the optical axis"""
    weights: Array
    """(n,) sr, or another unit, solid angles"""
    depths: Array
    """(n,) m along the optical axis; 0 where unknown"""

    def only(self, which: NDArray[np.bool_]) -> Rays:
        """Some of them."""
        return Rays(self.directions[which], self.weights[which], self.depths[which])


class ExpectedPixels(NamedTuple):
    """Which of some pixels should show what their rays meet."""

    free: NDArray[np.bool_]
    """(n,) whether nothing hides it"""
    colored: NDArray[np.bool_]
    """(n,) whether it has the colour"""
    depths: Array
    """(n,) m along the optical axis, as measured; 0 where unknown: at an edge before something far, most are"""


class ImagePart:
    """The pixels of one colour, and what they and those around them show.

    Args:
        view: depth and camera.
        mask: (h, w) those pixels.
        tagged: whether the upper side (+z) of the shape carries a tag: it is white and black then, and shows no colour.
    """

    def __init__(self, view: FrameView, mask: Mask, *, tagged: bool = False) -> None:
        self._view = view
        self._tagged = tagged
        self._mask = mask
        self._around_holes = _filled(view.depth)
        self._camera_from_world = view.world_from_camera.inverse()
        self.eye = view.world_from_camera.translation
        rows, columns = np.nonzero(mask)
        directions, weights = self._looks(np.column_stack([columns, rows]).astype(np.float64))
        colored = Rays(directions, weights, _known(view.depth[rows, columns]))
        self._colored = colored.only(np.isfinite(weights))
        measured = self._colored.only(self._colored.depths > 0.0)
        directions, self.weights, depths = (each[:: max(1, math.ceil(len(each) / _MOST_POINTS))] for each in measured)
        self.points = self.eye + directions * depths[:, None]
        """(n, 3) m, world, of some of those whose depth is known; with solid angles `weights` (n,)"""
        self.is_large = len(self.points) > 0 and min(np.ptp(rows), np.ptp(columns)) >= SMALLEST
        """Whether the spot is large enough to be used"""
        self.squared_depth = float((depths**2).mean()) if self.is_large else 0.0
        """m^2, mean of these points"""

    def _looks(self, pixels: Array) -> tuple[Array, Array]:
        """Directions (n, 3) and solid angles (n,) of pixels (n, 2), as of `Rays`."""
        rays = self._view.intrinsics.rays(pixels)
        return rays @ self._view.world_from_camera.rotation_matrix.T, (rays * rays).sum(axis=1) ** -1.5

    def shown(self, shape: Shape, size: Vector3, rotation: Array, position: Array, rays: int = _RAYS) -> Rays:
        """Rays over the image of a shape, as it would be with nothing else there: of its pixels, or spread evenly.

        Args:
            shape: without parts, a box of `size` m.
            size: edge lengths of its bounding box, m.
            rotation: (3, 3) world_from_object.
            position: (3,) m, of its centre in the world.
            rays: no more are cast about it: one for each pixel there, or as many where there are more pixels.

        Returns:
            Those that meet the shape where it has its colour, none if its bounding box reaches behind the camera. Their
            weights are 1 together.
        """
        corners = self._camera_from_world.apply(position + (0.5 * CORNERS * size) @ rotation.T)
        if corners[:, 2].min() <= 0.0:
            return Rays(np.empty((0, 3)), np.empty(0), np.empty(0))
        outline = self._view.intrinsics.project(corners)
        first, last = np.nanmin(outline, axis=0), np.nanmax(outline, axis=0)
        directions, weights = self._looks(_spread(first, last, rays))
        solids = Solids.of(shape or box(size))
        eye, local = rotation.T @ (self.eye - position), directions @ rotation
        depths = solids.first_met(eye, local)
        found = Rays(directions, weights, depths).only(_has_color(eye, local, depths, size, tagged=self._tagged))
        return found._replace(weights=found.weights / max(float(found.weights.sum()), NO_SHARE))

    def expected(self, shown: Rays, position: Array) -> ExpectedPixels:
        """Which of the pixels of some rays should show what these meet: a shape with its centre at a position (3,)."""
        local = shown.directions @ self._view.world_from_camera.rotation_matrix
        height, width = self._mask.shape
        column, row = np.rint(self._view.intrinsics.project(local)).T
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        place = np.where(inside, row, 0).astype(int), np.where(inside, column, 0).astype(int)
        colored = self._mask[place] & inside
        depths, around = _known(self._view.depth[place]), self._around_holes[place]
        is_above = self.eye[2] + shown.directions[:, 2] * around > position[2]
        nearer = np.where(is_above, -_IN_FRONT, _IN_FRONT)
        free = inside & (colored | (around > shown.depths - nearer))
        return ExpectedPixels(free, colored, depths)

    def around(self, position: Array, size: Vector3) -> NDArray[np.bool_]:
        """Which points are near what is at a position (3,) and has a bounding box of that size."""
        return _are_near(self.points, position, size)

    def colored_around(self, position: Array, size: Vector3) -> Rays:
        """The rays of the pixels of the colour that may show what is at a position (3,) and has a box of that size."""
        usual = float(self._camera_from_world.apply(position)[2])
        colored = self._colored
        places = self.eye + colored.directions * np.where(colored.depths > 0.0, colored.depths, usual)[:, None]
        return colored.only(_are_near(places, position, size))


def _has_color(eye: Array, rays: Array, depths: Array, size: Vector3, *, tagged: bool) -> NDArray[np.bool_]:
    """(n,) which rays (n, 3) from an eye (3,), in the frame of a shape, meet it where it has its colour.

    It is met at finite depths (n,).
    """
    met = np.isfinite(depths)
    if tagged:
        met[met] = eye[2] + rays[met, 2] * depths[met] < 0.5 * size[2] - GAP
    return met


def _are_near(points: Array, position: Array, size: Vector3) -> NDArray[np.bool_]:
    near: NDArray[np.bool_] = np.linalg.norm(points - position, axis=1) < math.hypot(*size) + 2.0 * _IN_FRONT
    return near


def _known(depths: NDArray[np.float32]) -> Array:
    """Depths (n,) m; 0 where unknown."""
    return np.where(np.isfinite(depths), depths, 0.0).astype(np.float64)


def _filled(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Depths (h, w) m, 0 where unknown; a pixel without one has the least of those beside it.

    At an edge many have none, on both sides. What is before the edge hides what is behind it up to there.
    """
    is_known = (depth > 0.0) & np.isfinite(depth)
    least = cv2.erode(np.where(is_known, depth, np.float32(np.inf)), np.ones((3, 3), np.uint8))
    return np.where(is_known, depth, np.where(np.isfinite(least), least, np.float32(0.0)))


def _spread(first: Array, last: Array, count: int) -> Array:
    """(n, 2) the pixels of a rectangle from one corner (2,) to the other; `count` places in it, if it has more."""
    begin, end = np.floor(first), np.ceil(last) + 1.0
    if np.prod(end - begin) > count:
        return np.asarray(first + (last - first) * _evenly(count))
    columns, rows = (np.arange(*ends) for ends in zip(begin.tolist(), end.tolist(), strict=True))
    return np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)


@functools.cache
def _evenly(count: int) -> Array:
    """(count, 2) spread evenly over the unit square, and in no rows: Kronecker's sequence of the plastic number."""
    return np.asarray((0.5 + np.outer(np.arange(count), (_PLASTIC**-1, _PLASTIC**-2))) % 1.0)


def fit(
    scene: ImagePart,
    shape: Shape,
    size: Vector3,
    rotation: Array,
    iterations: int = _ITERATIONS,
    rays: int = _RAYS,
    start: float = BEHIND,
) -> Fit | None:
    """The place at which a shape with a rotation (3, 3) lies on the points; None if none of it could be seen there.

    It is looked for from where its centre is as far behind what is seen as `start` times its shortest edge.
    """
    centre = _middle(scene.points, scene.weights)
    ahead = (centre - scene.eye) / np.linalg.norm(centre - scene.eye)
    position = centre + start * min(size) * ahead
    for _ in range(iterations):
        shown = scene.shown(shape, size, rotation, position, rays)
        expected = scene.expected(shown, position)
        compared, seen = shown.only(expected.free), scene.colored_around(position, size)
        common = expected.colored & (expected.depths > 0.0)
        if not common.any() or not len(seen.weights):
            return None
        towards = _middle(seen.directions, seen.weights)
        aside = _middle(compared.depths, compared.weights) * (towards - _middle(compared.directions, compared.weights))
        farther = _middle(expected.depths[common] - shown.depths[common], shown.weights[common])
        difference = aside + farther * towards
        position = position + difference
        if np.linalg.norm(difference) < _SETTLED:
            break
    return judged(scene, shape, size, rotation, position, rays)


def settled(scene: ImagePart, shape: Shape, size: Vector3, found: Fit) -> Fit:
    """A fit moved, not turned, to where the points near it lie on the surface: Gauss-Newton steps, Cauchy's weights."""
    position = found.position
    for _ in range(_STEPS):
        points = scene.points[scene.around(position, size)]
        points = points[:: max(1, len(points) // _POINTS_OF_A_STEP)]
        if not len(points):
            break
        step = _step(points, shape, size, found.rotation, position)
        position = position + step
        if np.linalg.norm(step) < _SETTLED:
            break
    return judged(scene, shape, size, found.rotation, position)


def _step(points: Array, shape: Shape, size: Vector3, rotation: Array, position: Array) -> Array:
    places = (position, *(position + _DIFFERENCE * np.eye(3)))
    off, *shifted = (distances(shape, size, (points - place) @ rotation) for place in places)
    slope = (np.column_stack(shifted) - off[:, None]) / _DIFFERENCE
    weights = 1.0 / (1.0 + (off / _FAR_OFF) ** 2)
    normal = slope.T @ (weights[:, None] * slope) + _HELD * weights.sum() * np.eye(3)
    step = -np.linalg.solve(normal, slope.T @ (weights * off))
    return np.asarray(step * min(1.0, _LONGEST_STEP / max(float(np.linalg.norm(step)), _SETTLED)))


def judged(
    scene: ImagePart, shape: Shape, size: Vector3, rotation: Array, position: Array, rays: int = _RAYS
) -> Fit:
    """How a shape at a place (3,) with a rotation (3, 3) lies on the points."""
    shown = scene.shown(shape, size, rotation, position, rays)
    free, colored, _ = scene.expected(shown, position)
    share = float(shown.weights[free].sum())
    near = scene.points[scene.around(position, size)]
    misfit = float(distances(shape, size, (near - position) @ rotation).mean()) if len(near) else math.inf
    return Fit(position, rotation, share, float(shown.weights[colored].sum()) / max(share, NO_SHARE), misfit)


def _middle(points: Array, weights: Array) -> Array:
    return np.asarray(weights @ points / weights.sum())
