"""Where a shape of known rotation lies on the pixels that show it: its visible surface is put where it is seen.

The middle of what is seen is compared with the middle of what should be seen of the shape at a supposed place, which is
then moved by the difference, and so on: an iterated closest point method (Besl and McKay, PAMI 1992) with all points
matched at once. What something nearer hides, or lies outside the image, should not be seen, so that it does not pull
the place to one side. The same is so of pixels without depth. They are at edges before something far, so at an upper
edge more than at one on a table. Where most is hidden that may end at a wrong place; each point's distance from the
surface then leads on.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.scene_estimator.segmentation import Mask
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Shape
from dsr.math3d.surfaces import distances, seen_alone
from dsr.math3d.transforms import Array, Pose
from dsr.vocabulary.intrinsics import Intrinsics

SMALLEST = 8
"""px, the width of the smallest spot that is used"""
ROUGH = 4
"""Iterations, and"""
ROUGH_POINTS = 200
"""points of a shape, enough to tell rotations apart"""

BEHIND, BEFORE = 0.3, -0.3
"""Of the shortest edge: how far the centre is behind what is seen of the outside; of the inside of something hollow"""

_MOST_PIXELS = 1500
_MODEL_POINTS = 1500  # all around the shape: some 4 mm apart on a cup
_ITERATIONS = 12
_SETTLED = 1e-4  # m
_STEPS = 8
_POINTS_OF_A_STEP = 400
_DIFFERENCE = 1e-4  # m, for derivatives
_FAR_OFF = 0.004  # m from the surface, beyond which a point counts less and less
_HELD = 0.02  # of the points' weight: what keeps the place where they do not tell it
_LONGEST_STEP = 0.02  # m
_IN_FRONT = 0.015  # m, by which something must be nearer to hide a point


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


class ExpectedPoints(NamedTuple):
    """Which of some points of a surface should be seen."""

    free: NDArray[np.bool_]
    """(n,) whether nothing hides it"""
    measured: NDArray[np.bool_]
    """(n,) those of them whose pixel has a depth: at an edge before something far away, most have none"""
    colored: NDArray[np.bool_]
    """(n,) whether its pixel has the colour"""


class ImagePart:
    """The visible points and their camera, in the world frame."""

    def __init__(self, view: FrameView, mask: Mask, points: Array, weights: Array) -> None:
        self._view = view
        self._mask = mask
        self.eye = view.world_from_camera.translation
        self.points = view.world_from_camera.apply(points)
        self.weights = weights
        self._camera_from_world = view.world_from_camera.inverse()

    def expected(self, points: Array) -> ExpectedPoints:
        """Which points (n, 3) of the world should be seen."""
        local = self._camera_from_world.apply(points)
        depth = np.maximum(local[:, 2], 1e-6)
        height, width = self._mask.shape
        column, row = np.rint(self._view.intrinsics.project(np.column_stack([local[:, :2], depth]))).T
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height) & (local[:, 2] > 0.0)
        place = np.where(inside, row, 0).astype(int), np.where(inside, column, 0).astype(int)
        colored = self._mask[place] & inside
        measured = self._view.depth[place]
        free = inside & (colored | (measured > depth - _IN_FRONT))
        return ExpectedPoints(free, free & (measured > 0.0) & np.isfinite(measured), colored)

    def around(self, position: Array, size: Vector3) -> NDArray[np.bool_]:
        """Which points are near what is at a position (3,) and has a bounding box of that size."""
        near: NDArray[np.bool_] = np.linalg.norm(self.points - position, axis=1) < math.hypot(*size) + 2.0 * _IN_FRONT
        return near


def cloud(view: FrameView, mask: Mask) -> tuple[Array, Array]:
    """Points (n, 3) of the mask's pixels with known depth, in the camera frame, and their solid angles (n,)."""
    rows, columns = np.nonzero(mask & (view.depth > 0.0) & np.isfinite(view.depth))
    step = max(1, math.ceil(len(rows) / _MOST_PIXELS))
    rows, columns = rows[::step], columns[::step]
    if len(rows) == 0 or min(np.ptp(rows), np.ptp(columns)) < SMALLEST:
        return np.empty((0, 3)), np.empty(0)
    rays = view.intrinsics.rays(np.column_stack([columns, rows]).astype(np.float64))
    return rays * view.depth[rows, columns, None].astype(np.float64), (rays * rays).sum(axis=1) ** -1.5


def fit(
    scene: ImagePart,
    shape: Shape,
    size: Vector3,
    rotation: Array,
    iterations: int = _ITERATIONS,
    count: int = _MODEL_POINTS,
    start: float = BEHIND,
) -> Fit | None:
    """The place at which a shape with a rotation (3, 3) lies on the points; None if none of it could be seen there.

    It is looked for from where its centre is as far behind what is seen as `start` times its shortest edge.
    """
    centre = _middle(scene.points, scene.weights)
    ahead = (centre - scene.eye) / np.linalg.norm(centre - scene.eye)
    position = centre + start * min(size) * ahead
    for iteration in range(iterations):
        if iteration in (0, 2, 5):
            surface, weights = seen_alone(shape, size, rotation.T @ (scene.eye - position), count)
            surface = surface @ rotation.T
        compared = scene.expected(surface + position).measured
        near = scene.around(position, size)
        if not compared.any() or not near.any():
            return None
        seen, expected = (scene.points[near], scene.weights[near]), (surface[compared], weights[compared])
        difference = _middle(*seen) - _middle(*expected) - position
        position = position + difference
        if np.linalg.norm(difference) < _SETTLED:
            break
    return judged(scene, shape, size, rotation, position, count)


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
    scene: ImagePart, shape: Shape, size: Vector3, rotation: Array, position: Array, count: int = _MODEL_POINTS
) -> Fit:
    """How a shape at a place (3,) with a rotation (3, 3) lies on the points."""
    surface, weights = seen_alone(shape, size, rotation.T @ (scene.eye - position), count)
    free, _, colored = scene.expected(surface @ rotation.T + position)
    share = float(weights[free].sum())
    near = scene.points[scene.around(position, size)]
    misfit = float(distances(shape, size, (near - position) @ rotation).mean()) if len(near) else math.inf
    return Fit(position, rotation, share, float(weights[colored].sum()) / max(share, 1e-9), misfit)


def _middle(points: Array, weights: Array) -> Array:
    return np.asarray(weights @ points / weights.sum())
